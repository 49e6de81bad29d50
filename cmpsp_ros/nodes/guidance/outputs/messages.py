"""Decisions as messages, each made once and reused, and commands as bytes.

Making the parts of a message anew takes longer than to fill them, and to have rclpy serialise a
command as long as a good part of deciding. So commands leave in CDR (OMG DDS-RTPS 2.5, section 10,
with the alignment of XCDR version 1).
"""

import struct
from collections.abc import Sequence

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from geometry_msgs.msg import Point32, PolygonStamped, PoseStamped
from nav_msgs.msg import Path
from std_msgs.msg import Header

from cmpsp_ros.arrays import Array
from cmpsp_ros.guidance import (
    NANOSECONDS,
    Decision,
    Plan,
    decision_to_key_values,
    severity,
    waypoints,
)
from cmpsp_ros.nodes.common.messages import set_pose, set_stamp
from cmpsp_ros.robots.motion import with_side

_LITTLE_ENDIAN = b'\x00\x01\x00\x00'
_TWIST = struct.Struct('<6d')
_STAMP = struct.Struct('<iI')
_ALIGNMENT = 8


def twist_bytes(decision: Decision) -> bytes:
    """The command of a decision as a `geometry_msgs/Twist`."""
    return _LITTLE_ENDIAN + _twist(decision)


def stamped_bytes(decision: Decision, frame: bytes) -> bytes:
    """The command as a `TwistStamped` with the stamp of its odometry, `frame` by `frame_bytes`."""
    stamp = _STAMP.pack(*divmod(decision.stamp, NANOSECONDS))
    return _LITTLE_ENDIAN + stamp + frame + _twist(decision)


def frame_bytes(frame_id: str) -> bytes:
    """A frame after a stamp, padded up to the twist."""
    name = frame_id.encode() + b'\0'
    text = struct.pack('<I', len(name)) + name
    return text + bytes(-(_STAMP.size + len(text)) % _ALIGNMENT)


def _twist(decision: Decision) -> bytes:
    forward, left, turn_rate = with_side(decision.twist).tolist()
    return _TWIST.pack(forward, left, 0.0, 0.0, 0.0, turn_rate)


def level_of(decision: Decision) -> bytes:
    """Diagnostic level of a decision: having arrived is no error."""
    return bytes([severity(decision)])


def polygon_message(corners: Array, frame_id: str, stamp_ns: int) -> PolygonStamped:
    """The message of a polygon ``(C, 2)`` [m] in a frame."""
    message = PolygonStamped(header=Header(frame_id=frame_id))
    set_stamp(message.header, stamp_ns)
    message.polygon.points = [Point32(x=x, y=y) for x, y in corners.tolist()]
    return message


class DecisionMessage:
    """Everything about a decision but its plan; numbers read back exactly."""

    def __init__(self, name: str, hardware_id: str, frame_id: str) -> None:
        self._message = DiagnosticStatus(name=name, hardware_id=hardware_id)
        self._array = DiagnosticArray(status=[self._message])
        self._array.header.frame_id = frame_id
        self._values: dict[str, KeyValue] = {}

    def fill(self, decision: Decision) -> DiagnosticArray:
        """The message of a decision, good until the next, with the stamp of its odometry."""
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


class PathMessage:
    """The predicted path, each pose at the time when the robot should be there."""

    def __init__(self, frame_id: str) -> None:
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
        """The message of a robot at rest at a pose (x, y, heading) [m, m, rad]."""
        there = PoseStamped(header=Header(frame_id=self._path.header.frame_id))
        set_pose(there.pose, pose)
        for each in (self._path.header, there.header):
            set_stamp(each, stamp_ns)
        self._path.poses = [there]
        return self._path
