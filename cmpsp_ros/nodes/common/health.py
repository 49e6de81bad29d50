"""A node's own state on /diagnostics."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.node import Node

from cmpsp_ros.guidance import exact_repr
from cmpsp_ros.nodes.common.topic import steady_timer
from cmpsp_ros.nodes.common.topics import HEALTH

_PERIOD = 1.0
_CHANGE_PERIOD = 0.1


@dataclass(frozen=True)
class Report:
    """State of a node: level of `diagnostic_msgs/DiagnosticStatus`, and a sentence."""

    level: bytes
    message: str
    marks: tuple[object, ...]  # a change of these is published at once
    values: Callable[[], Mapping[str, object]]  # computed only when they are published


class Health:
    """Publishes a node's state once a second and whenever it has changed."""

    def __init__(self, node: Node, look: Callable[[], Report]) -> None:
        self._node = node
        self._look = look
        self._shown: tuple[object, ...] | None = None
        self._publisher = HEALTH.publish_on(node)
        steady_timer(node, _PERIOD, self.publish)
        steady_timer(node, _CHANGE_PERIOD, self._publish_change)

    def publish(self) -> None:
        """Publish the state now."""
        report = self._look()
        self._shown = report.marks
        name = self._node.get_name()
        status = status_message(report.level, self._node, name, report.message, report.values())
        array = DiagnosticArray(status=[status])
        array.header.stamp = self._node.get_clock().now().to_msg()
        self._publisher.publish(array)

    def _publish_change(self) -> None:
        if self._look().marks != self._shown:
            self.publish()


def hardware_id(node: Node) -> str:
    """Name of the robot that a node belongs to: its namespace."""
    return str(node.get_namespace().strip('/')) or 'robot'


def status_message(
    level: bytes, node: Node, kind: str, message: str, values: Mapping[str, object]
) -> DiagnosticStatus:
    """A diagnostic status; floats are written so that they read back bit for bit."""
    return DiagnosticStatus(
        level=level,
        name=f'{node.get_fully_qualified_name()}: {kind}',
        hardware_id=hardware_id(node),
        message=message,
        values=[KeyValue(key=key, value=exact_repr(value)) for key, value in values.items()],
    )
