"""Diagnostic statuses."""

from __future__ import annotations

from typing import TYPE_CHECKING

from diagnostic_msgs.msg import DiagnosticStatus, KeyValue

from cmpsp_ros.guidance.messages.exact_repr import written

if TYPE_CHECKING:
    from collections.abc import Mapping

    from rclpy.node import Node


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
        values=[KeyValue(key=key, value=written(value)) for key, value in values.items()],
    )
