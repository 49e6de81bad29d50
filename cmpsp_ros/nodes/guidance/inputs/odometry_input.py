"""Odometry as it arrives, and who publishes it: two sources contradict each other."""

from __future__ import annotations

from typing import TYPE_CHECKING

from cmpsp_ros.guidance import NANOSECONDS
from cmpsp_ros.nodes.common.topic import publisher_names
from cmpsp_ros.nodes.common.topics import GUIDANCE_ODOM
from cmpsp_ros.nodes.guidance.inputs.odometry_bytes import read_odometry
from cmpsp_ros.nodes.timing.drain_queue import drain_queue, take_newest

if TYPE_CHECKING:
    from collections.abc import Callable

    from rclpy.lifecycle import LifecycleNode

    from cmpsp_ros.guidance.messages import OdometryReading


class OdometryInput:
    """Listens to odometry."""

    def __init__(self, node: LifecycleNode, hear: Callable[[bytes], None]) -> None:
        """Open the topic.

        Args:
            node: The node.
            hear: Called with the bytes of each message.
        """
        self._node = node
        self._subscription = GUIDANCE_ODOM.listen_on(node, hear, raw=True)

    def close(self) -> None:
        """Close the topic."""
        self._node.destroy_subscription(self._subscription)

    def drain(self) -> None:
        """Hear all messages that wait."""
        drain_queue(self._subscription)

    def newest(
        self, data: bytes, now: int, period: float, is_due: Callable[[int], bool]
    ) -> tuple[OdometryReading, bytes]:
        """Odometry, and its bytes: of the newest that waits, where this has grown old.

        Args:
            data: What has come.
            now: Present time [ns].
            period: Age from which on it is old [s].
            is_due: Whether odometry of a time [ns] is one to decide on.

        Raises:
            OdometryError: It cannot be read.
        """
        reading = read_odometry(data)
        if (now - reading.stamp) / NANOSECONDS <= period or not is_due(reading.stamp):
            return reading, data
        newest = take_newest(self._subscription) or data
        return read_odometry(newest), newest

    @property
    def publishers(self) -> int:
        """Number of publishers that are heard."""
        return int(self._subscription.get_publisher_count())

    def warning(self) -> str:
        """Names of the publishers where there are several, in a sentence; else empty."""
        if self.publishers < 2:
            return ''
        topic = self._subscription.topic_name
        names = publisher_names(self._node, topic)
        return f'{len(names)} publishers on {topic}: {", ".join(names)}.'
