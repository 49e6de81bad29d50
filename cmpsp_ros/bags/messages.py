"""Decisions as messages in a bag, without ROS."""

from __future__ import annotations

from typing import Any

from cmpsp_ros.bags.definitions import jazzy
from cmpsp_ros.guidance import (
    NANOSECONDS,
    Decision,
    Plan,
    decision_to_key_values,
    severity,
    waypoints,
)
from cmpsp_ros.robots.motion import with_side

DECISION = 'diagnostic_msgs/msg/DiagnosticArray'
TWIST = 'geometry_msgs/msg/Twist'
PATH = 'nav_msgs/msg/Path'

_LATEST = (2**31 - 1) * NANOSECONDS


def decision_message(decision: Decision, name: str) -> bytes:
    """Everything about a decision but its plan, serialised as a `DECISION`."""
    pairs = [
        _make('diagnostic_msgs/msg/KeyValue', *item)
        for item in decision_to_key_values(decision).items()
    ]
    status = _make(
        'diagnostic_msgs/msg/DiagnosticStatus', severity(decision), name, decision.reason, '', pairs
    )
    # A stamp that no header can hold is in the entries alone.
    stamp = min(decision.stamp, _LATEST)
    return _raw(_make(DECISION, _header('', stamp), [status]), DECISION)


def command_message(decision: Decision) -> bytes:
    """The command of a decision, serialised as a `TWIST`."""
    forward, left, rate = with_side(decision.twist).tolist()
    vector = jazzy().types['geometry_msgs/msg/Vector3']
    return _raw(_make(TWIST, vector(forward, left, 0.0), vector(0.0, 0.0, rate)), TWIST)


def path_message(plan: Plan, frame_id: str, stamp: int) -> bytes:
    """A plan that was made at a time [ns], serialised as a `PATH`."""
    poses = [
        _make(
            'geometry_msgs/msg/PoseStamped',
            _header(frame_id, when),
            _make(
                'geometry_msgs/msg/Pose',
                _make('geometry_msgs/msg/Point', x, y, 0.0),
                _make('geometry_msgs/msg/Quaternion', 0.0, 0.0, z, w),
            ),
        )
        for (x, y, z, w), when in zip(waypoints(plan), plan.stamps(stamp), strict=True)
    ]
    return _raw(_make(PATH, _header(frame_id, stamp), poses), PATH)


def _header(frame_id: str, stamp: int) -> Any:
    time = _make('builtin_interfaces/msg/Time', *divmod(stamp, NANOSECONDS))
    return _make('std_msgs/msg/Header', time, frame_id)


def _make(name: str, *fields: Any) -> Any:
    return jazzy().types[name](*fields)


def _raw(message: Any, name: str) -> bytes:
    return bytes(jazzy().serialize_cdr(message, name))
