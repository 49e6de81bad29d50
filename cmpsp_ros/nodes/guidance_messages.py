"""Odometry to pose and decisions to messages."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from diagnostic_msgs.msg import DiagnosticStatus, KeyValue
from geometry_msgs.msg import PoseStamped, Twist, TwistStamped
from nav_msgs.msg import Path
from rclpy.time import Time
from sensor_msgs.msg import JointState

from cmpsp_ros.guidance.decision import Rung

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from builtin_interfaces.msg import Time as Stamp
    from nav_msgs.msg import Odometry
    from numpy.typing import NDArray

    from cmpsp_ros.guidance.decision import Decision, Plan

    Array = NDArray[np.float64]

_LEVELS = {
    Rung.NOMINAL: DiagnosticStatus.OK,
    Rung.ELASTIC: DiagnosticStatus.WARN,
    Rung.SHIFTED: DiagnosticStatus.WARN,
    Rung.STOP: DiagnosticStatus.ERROR,
}


class OdometryError(ValueError):
    """Odometry that nothing may be decided on; the message says why."""


def pose_of(message: Odometry, frame_id: str) -> Array:
    """Planar pose ``(x, y, heading)`` [m, m, rad] of an odometry message (REP-105).

    Raises:
        OdometryError: It is in another frame, is not finite or has no orientation.
    """
    if message.header.frame_id != frame_id:
        raise OdometryError(
            f'Odometry is in frame {message.header.frame_id!r}, wanted {frame_id!r} (frame_id).'
        )
    position, q = message.pose.pose.position, message.pose.pose.orientation
    length = math.sqrt(q.x * q.x + q.y * q.y + q.z * q.z + q.w * q.w)
    if abs(length - 1.0) > 0.01:
        raise OdometryError(f'Odometry has an orientation of length {length:.3g}, wanted 1.')
    # Exact for a quaternion of any length.
    heading = math.atan2(
        2.0 * (q.w * q.z + q.x * q.y), q.w * q.w + q.x * q.x - q.y * q.y - q.z * q.z
    )
    pose = np.array([position.x, position.y, heading])
    if not np.isfinite(pose).all():
        raise OdometryError(f'Odometry has a pose that is not finite: {pose.tolist()}.')
    return pose


def twist_message(decision: Decision) -> Twist:
    """The command of a decision."""
    twist = Twist()
    twist.linear.x, twist.angular.z = decision.twist.tolist()
    return twist


def stamped_twist_message(decision: Decision, stamp: Stamp) -> TwistStamped:
    """The command of a decision, stamped as the odometry that it answers."""
    message = TwistStamped(twist=twist_message(decision))
    message.header.stamp = stamp
    message.header.frame_id = 'base_link'
    return message


def joint_state_message(decision: Decision, names: Sequence[str], stamp: Stamp) -> JointState:
    """Commanded wheel speeds [rad/s]."""
    message = JointState(name=list(names), velocity=decision.wheel_speeds.tolist())
    message.header.stamp = stamp
    return message


def level_of(decision: Decision) -> bytes:
    """Diagnostic level of a decision: having arrived is no error."""
    return DiagnosticStatus.OK if decision.finished else _LEVELS[decision.rung]


def decision_message(decision: Decision, name: str) -> DiagnosticStatus:
    """Everything about a decision but its plan; numbers read back exactly."""
    values = {
        'step': decision.step,
        'stamp': decision.stamp,
        'rung': decision.rung.name.lower(),
        'time_left': decision.time_left,
        'wheel_speed_right': float(decision.wheel_speeds[0]),
        'wheel_speed_left': float(decision.wheel_speeds[1]),
        'miss': decision.miss,
        'margin': decision.margin,
        'worst_margin': decision.worst_margin,
        'slack': decision.slack,
        'iterations': decision.iterations,
        'qp_iterations': decision.qp_iterations,
        'active_rows': decision.active_rows,
        'failures': decision.failures,
        'finished': 'true' if decision.finished else 'false',
    }
    values |= {f'{phase}_ms': time for phase, time in decision.phases.items()}
    return status_message(level_of(decision), name, decision.reason, values)


def status_message(
    level: bytes, name: str, message: str, values: Mapping[str, object]
) -> DiagnosticStatus:
    """A diagnostic status; floats are written so that they read back bit for bit."""
    return DiagnosticStatus(
        level=level,
        name=name,
        message=message,
        values=[KeyValue(key=key, value=_written(value)) for key, value in values.items()],
    )


def path_message(plan: Plan, frame_id: str, stamp_ns: int) -> Path:
    """The predicted path, each pose at the time when the robot should be there."""
    path = Path()
    path.header.frame_id = frame_id
    path.header.stamp = Time(nanoseconds=stamp_ns).to_msg()
    begin = int(plan.horizon.edges[0])
    path.poses = list(_poses(plan.poses, (stamp_ns + plan.horizon.edges - begin), frame_id))
    return path


def _poses(poses: Array, stamps: NDArray[np.int64], frame_id: str) -> Iterable[PoseStamped]:
    for (x, y, heading), stamp in zip(poses.tolist(), stamps.tolist(), strict=True):
        message = PoseStamped()
        message.header.frame_id = frame_id
        message.header.stamp = Time(nanoseconds=stamp).to_msg()
        message.pose.position.x, message.pose.position.y = x, y
        message.pose.orientation.z = math.sin(heading / 2.0)
        message.pose.orientation.w = math.cos(heading / 2.0)
        yield message


def _written(value: object) -> str:
    return repr(float(value)) if isinstance(value, float) else str(value)
