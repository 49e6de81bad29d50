"""Decisions to messages."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from geometry_msgs.msg import Point32, PolygonStamped, PoseStamped
from nav_msgs.msg import Path
from std_msgs.msg import Header

from cmpsp_ros.arrays import Array
from cmpsp_ros.guidance import decision_to_key_values, severity, waypoints

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sensor_msgs.msg import JointState

    from cmpsp_ros.guidance import Decision, Plan


def set_stamp(header: Header, stamp_ns: int) -> None:
    """Stamp a message [ns]."""
    header.stamp.sec, header.stamp.nanosec = divmod(stamp_ns, 1_000_000_000)


def fill_wheels(message: JointState, decision: Decision) -> None:
    """Commanded wheel speeds [rad/s]."""
    message.velocity = decision.wheel_speeds.tolist()


def level_of(decision: Decision) -> bytes:
    """Diagnostic level of a decision: having arrived is no error."""
    return bytes([severity(decision)])


class DecisionMessage:
    """Everything about a decision but its plan; numbers read back exactly.

    One message is filled again and again: making its parts anew takes longer than to fill them.
    """

    def __init__(self, name: str, hardware_id: str, frame_id: str) -> None:
        """Make the message.

        Args:
            name: Of the node, in diagnostics.
            hardware_id: Of the robot.
            frame_id: Of the odometry.
        """
        self._message = DiagnosticStatus(name=name, hardware_id=hardware_id)
        self._array = DiagnosticArray(status=[self._message])
        self._array.header.frame_id = frame_id
        self._values: dict[str, KeyValue] = {}

    def fill(self, decision: Decision) -> DiagnosticArray:
        """The message of a decision, good until the next; stamped as what it answers."""
        set_stamp(self._array.header, decision.stamp)
        self._message.level = level_of(decision)
        self._message.message = decision.reason
        self._message.values = [
            self._value(*item) for item in decision_to_key_values(decision).items()
        ]
        return self._array

    def _value(self, key: str, value: str) -> KeyValue:
        found = self._values.get(key) or self._values.setdefault(key, KeyValue(key=key))
        found.value = value
        return found


def polygon_message(corners: Array, frame_id: str, stamp_ns: int) -> PolygonStamped:
    """The message of a polygon ``(C, 2)`` [m] in a frame."""
    message = PolygonStamped(header=Header(frame_id=frame_id))
    set_stamp(message.header, stamp_ns)
    message.polygon.points = [Point32(x=x, y=y) for x, y in corners.tolist()]
    return message


class PathMessage:
    """The predicted path, each pose at the time when the robot should be there."""

    def __init__(self, frame_id: str) -> None:
        """Make the message, in a frame."""
        self._path = Path()
        self._path.header.frame_id = frame_id
        self._poses: list[PoseStamped] = []

    def fill(self, plan: Plan, stamp_ns: int) -> Path:
        """The message of a plan that was made at a time [ns], good until the next."""
        set_stamp(self._path.header, stamp_ns)
        stamps = plan.stamps(stamp_ns)
        while len(self._poses) < len(stamps):
            self._poses.append(PoseStamped(header=Header(frame_id=self._path.header.frame_id)))
        poses = self._poses[: len(stamps)]
        for message, (x, y, z, w), stamp in zip(poses, waypoints(plan), stamps, strict=True):
            set_stamp(message.header, stamp)
            message.pose.position.x, message.pose.position.y = x, y
            message.pose.orientation.z, message.pose.orientation.w = z, w
        self._path.poses = poses
        return self._path

    def stand(self, pose: Sequence[float], stamp_ns: int) -> Path:
        """The message of a robot that stands at a pose (x, y, heading) [m, m, rad]."""
        x, y, heading = pose
        there = PoseStamped(header=Header(frame_id=self._path.header.frame_id))
        there.pose.position.x, there.pose.position.y = x, y
        there.pose.orientation.z = math.sin(heading / 2.0)
        there.pose.orientation.w = math.cos(heading / 2.0)
        for each in (self._path.header, there.header):
            set_stamp(each, stamp_ns)
        self._path.poses = [there]
        return self._path
