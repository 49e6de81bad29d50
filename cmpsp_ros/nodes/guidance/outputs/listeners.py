"""Subscribers that a run waits for: the robot, and a recorder if requested.

A robot that listens for another type of command, or has not found this node yet, would stand while
the time of its task runs; a recorder that comes late has a bag that cannot be replayed.
"""

from __future__ import annotations

import time

from rclpy.lifecycle import LifecycleNode
from rclpy.publisher import Publisher

from cmpsp_ros.nodes.common.topics import GUIDANCE_ODOM

RECORDERS = frozenset({'recorder', 'rosbag2_recorder'})
"""Names of nodes that record: ours, and that of `ros2 bag`."""

ONLOOKERS = RECORDERS | {'viewer', 'foxglove_bridge'}
"""Names of nodes that hear commands and obey none; those of the command line begin with `_`."""

_UNKNOWN = '_NODE_NAME_UNKNOWN_'
_SETTLING_TIME = 0.5
"""Time in which a recorder that is known here finds the publishers of odometry, too [s]."""


class Listeners:
    """Looks into the graph until a run may begin."""

    def __init__(
        self,
        node: LifecycleNode,
        command: Publisher,
        reports: tuple[Publisher, ...],
        recorder_timeout: float,
    ) -> None:
        """Wait for the robot, and for a recorder that hears commands and reports.

        The time to wait for a recorder is in seconds; 0 for none.
        """
        self._node, self._command, self._reports = node, command, reports
        self._recorder_timeout = recorder_timeout
        self.begin()

    def begin(self) -> None:
        """Another run is to begin."""
        self._since: float | None = None
        self._recorded_since: float | None = None
        self._is_alone = False

    def lacking(self) -> str:
        """Sentence on the listeners a run still waits for; '' if none."""
        return self._robot() or self._recorder()

    def warnings(self) -> list[str]:
        """Warnings about missing listeners while the robot is guided, in sentences."""
        if self._command.get_subscription_count():
            return []
        return [f'Nobody listens to {self._command.topic_name}.']

    def _robot(self) -> str:
        topic, kind = self._command.topic_name, _name_of(self._command.msg_type)
        found = self._node.get_subscriptions_info_by_topic(topic)
        alike = [each for each in found if each.topic_type == kind]
        onlookers = sum(_only_looks_on(each.node_name) for each in alike)
        if len(alike) > onlookers and self._command.get_subscription_count() > onlookers:
            return ''
        others = [
            f'Another listener wants {each.topic_type}: enable_stamped_cmd_vel.'
            for each in found
            if each.topic_type != kind
        ]
        return ' '.join([f'Waiting for a listener to {topic} ({kind}).', *others[:1]])

    def _recorder(self) -> str:
        now = time.monotonic()
        if not self._recorder_timeout or self._is_alone or self._is_recorded(now):
            return ''
        self._since = now if self._since is None else self._since
        if now - self._since > self._recorder_timeout:
            self._is_alone = True
            self._node.get_logger().warning(
                'no recorder within recorder_timeout: the run begins without'
            )
            return ''
        return 'Waiting for a recorder (recorder_timeout).'

    def _is_recorded(self, now: float) -> bool:
        """True if a recorder has matched all topics of the run, and had time to be discovered."""
        heard = self._node.get_subscriptions_info_by_topic
        publishers = (self._command, *self._reports)
        topics = [each.topic_name for each in publishers]
        topics.append(self._node.resolve_topic_name(GUIDANCE_ODOM.name))
        complete = all(
            any(each.node_name in RECORDERS for each in heard(topic)) for topic in topics
        ) and all(
            each.get_subscription_count() >= len(heard(each.topic_name)) for each in self._reports
        )
        if not complete:
            self._recorded_since = None
            return False
        self._recorded_since = self._recorded_since or now
        return now - self._recorded_since > _SETTLING_TIME


def _only_looks_on(name: str) -> bool:
    return name in ONLOOKERS or (name.startswith('_') and name != _UNKNOWN)


def _name_of(kind: type) -> str:
    return f'{kind.__module__.partition(".")[0]}/msg/{kind.__name__}'
