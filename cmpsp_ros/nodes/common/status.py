"""Diagnostic statuses."""

from __future__ import annotations

from typing import TYPE_CHECKING

from diagnostic_msgs.msg import DiagnosticStatus, KeyValue

from cmpsp_ros.guidance.key_values import exact_repr

if TYPE_CHECKING:
    from collections.abc import Mapping


def status_message(
    level: bytes, name: str, message: str, values: Mapping[str, object]
) -> DiagnosticStatus:
    """A diagnostic status; floats are written so that they read back bit for bit."""
    return DiagnosticStatus(
        level=level,
        name=name,
        message=message,
        values=[KeyValue(key=key, value=exact_repr(value)) for key, value in values.items()],
    )
