"""Replay: recorded odometry through the guidance law again, unchanged or changed."""

from cmpsp_ros.bags.replay.what_if import Change, what_if
from cmpsp_ros.bags.replay.what_if_picture import draw_what_if
