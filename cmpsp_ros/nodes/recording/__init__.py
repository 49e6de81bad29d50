"""The recorder: topics of the graph into one bag."""

from cmpsp_ros.nodes.recording.written import Written
