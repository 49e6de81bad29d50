"""Replay: recorded odometry through the guidance law again, unchanged or changed."""

from typing import TYPE_CHECKING

from cmpsp_ros.front_door import lazy_exports

if TYPE_CHECKING:
    from cmpsp_ros.bags.replay.changed_law import Change, draw_what_if, what_if

__getattr__, __all__ = lazy_exports(__name__, __file__)
