"""The heartbeat that Nav2's lifecycle manager wants of a node while it is active."""

from __future__ import annotations

from typing import TYPE_CHECKING
from uuid import uuid4

from rclpy.clock import Clock, ClockType

try:
    from bond.msg import Status
except ImportError:  # bond is not among the wheels
    Status = None

if TYPE_CHECKING:
    from rclpy.node import Node
    from rclpy.timer import Timer

_TOPIC, _DEPTH = 'bond', 10
_PERIOD, _TIMEOUT = 0.1, 4.0


class LifecycleBond:
    """This node's side of a bond; the manager's is not waited for, and may be missing."""

    def __init__(self, node: Node) -> None:
        """Open the topic, where `bond` is installed."""
        self._node = node
        self._timer: Timer | None = None
        if Status is not None:
            self._publisher = node.create_publisher(Status, _TOPIC, _DEPTH)
            self._message = Status(
                id=node.get_name(), heartbeat_period=_PERIOD, heartbeat_timeout=_TIMEOUT
            )

    def begin(self) -> None:
        """The node is active."""
        if Status is None:
            return
        # One that ends is over for good: each needs another name.
        self._message.instance_id, self._message.active = str(uuid4()), True
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self._timer = self._node.create_timer(_PERIOD, self._beat, clock=steady)
        self._beat()

    def end(self) -> None:
        """It is not any more; this is no failure."""
        if self._timer is not None:
            self._node.destroy_timer(self._timer)
            self._timer, self._message.active = None, False
            self._beat()

    def _beat(self) -> None:
        self._message.header.stamp = self._node.get_clock().now().to_msg()
        self._publisher.publish(self._message)
