"""Moving obstacles as the guidance node receives them, though it may decide nothing."""

from types import SimpleNamespace

from rclpy.time import Time

from cmpsp_ros.guidance.messages import Track
from cmpsp_ros.nodes.common.messages import cloud_of
from cmpsp_ros.nodes.guidance.inputs.surroundings import TrackInput
from cmpsp_ros.nodes.guidance.inputs.transforms import TransformInput
from cmpsp_ros.parameters import TABLE, guidance_settings, load_parameter_file

PERIOD = 50_000_000
BEGIN = 10**18


class HandDriven:
    """A node without a middleware: its clock is set, and its callbacks are called, by hand."""

    def __init__(self):
        self.now, self.callbacks = BEGIN, {}

    def get_namespace(self):
        return '/'

    def get_clock(self):
        return SimpleNamespace(now=lambda: Time(nanoseconds=self.now))

    def create_publisher(self, *_):
        return None

    def create_subscription(self, _kind, topic, callback, *_, **_how):
        self.callbacks[topic] = callback
        return SimpleNamespace()


def test_reports_are_forgotten_while_no_step_decides():
    """As long as the node waits for a goal, or stands for a fault, trackers go on."""
    changes = {'moving_obstacles.capacity': 4, 'moving_obstacles.timeout': 1.0}
    settings = guidance_settings(TABLE.resolve({**load_parameter_file('case3'), **changes}))
    node = HandDriven()
    tracks = TrackInput(node, settings, TransformInput(node, '', settings))
    for step in range(1000):
        node.now = BEGIN + step * PERIOD
        # One is reported all the time, and each of the others once.
        seen = [Track(each, node.now, 0.3, 1.0, 2.0, 0.1, 0.0) for each in (0, step + 1)]
        node.callbacks['moving_obstacles'](cloud_of(seen, node.now, 'odom'))
    assert not tracks.refusals
    # Those of the time-out twice, and of the time by which odometry may be late.
    kept = sum(map(len, tracks._obstacles._known.values()))
    assert kept < 2 * (2.0 + settings.odom_timeout) * 1e9 / PERIOD + 5
