"""The recorder: topics of the graph into one bag."""

from cmpsp_ros.nodes.recording.received import Written, from_values
