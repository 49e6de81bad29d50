"""Velocity commands written as the bytes in which they leave.

Filling a message of rclpy and having it made into bytes takes as long as a good part of deciding.
So the publisher is given a message in CDR (OMG DDS-RTPS 2.5, section 10, with the alignment of
XCDR version 1).
"""

from __future__ import annotations

import struct
from typing import TYPE_CHECKING

from cmpsp_ros.guidance import NANOSECONDS
from cmpsp_ros.robots import with_side

if TYPE_CHECKING:
    from cmpsp_ros.guidance import Decision

_LITTLE_ENDIAN = b'\x00\x01\x00\x00'
_TWIST = struct.Struct('<6d')
_STAMP = struct.Struct('<iI')
_ALIGNMENT = 8


def twist_bytes(decision: Decision) -> bytes:
    """The command of a decision as a `geometry_msgs/Twist`."""
    return _LITTLE_ENDIAN + _twist(decision)


def stamped_bytes(decision: Decision, frame: bytes) -> bytes:
    """The same as a `geometry_msgs/TwistStamped`, stamped as the odometry that it answers.

    Args:
        decision: The decision.
        frame: What `frame_bytes` says of its frame.
    """
    stamp = _STAMP.pack(*divmod(decision.stamp, NANOSECONDS))
    return _LITTLE_ENDIAN + stamp + frame + _twist(decision)


def frame_bytes(frame_id: str) -> bytes:
    """A frame behind a stamp, with what is between it and the twist."""
    name = frame_id.encode() + b'\0'
    text = struct.pack('<I', len(name)) + name
    return text + bytes(-(_STAMP.size + len(text)) % _ALIGNMENT)


def _twist(decision: Decision) -> bytes:
    forward, left, turn_rate = with_side(decision.twist).tolist()
    return _TWIST.pack(forward, left, 0.0, 0.0, 0.0, turn_rate)
