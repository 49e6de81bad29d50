"""Odometry read from the bytes in which it came, but for what nobody looks at.

rclpy makes a Python object of each part of a message, covariances and twist too, which takes as
long as deciding on it. So the subscription is asked for the bytes: a message in CDR (OMG DDS-RTPS
2.5, section 10, with the alignment of XCDR version 1).
"""

from __future__ import annotations

import struct
from typing import NamedTuple

from cmpsp_ros.guidance.messages import OdometryError

_HEADER = 4
"""Bytes of the encapsulation header; alignment counts from its end."""
_LITTLE_ENDIAN, _BIG_ENDIAN = (
    (struct.Struct(f'{order}iI'), struct.Struct(f'{order}I'), struct.Struct(f'{order}7d'))
    for order in '<>'
)
"""Of a stamp, of the length of a string, of a pose."""

_UNREADABLE = 'Odometry cannot be read: found {} bytes that are no nav_msgs/Odometry in CDR.'


class _Stamp(NamedTuple):
    sec: int
    nanosec: int


class _Header(NamedTuple):
    stamp: _Stamp
    frame_id: str


class _Point(NamedTuple):
    x: float
    y: float
    z: float


class _Quaternion(NamedTuple):
    x: float
    y: float
    z: float
    w: float


class _Pose(NamedTuple):
    position: _Point
    orientation: _Quaternion


class _PoseWithCovariance(NamedTuple):
    pose: _Pose


class Odometry(NamedTuple):
    """What is read of a `nav_msgs/Odometry`, by the names that it has there."""

    header: _Header
    child_frame_id: str
    pose: _PoseWithCovariance


def read_odometry(data: bytes) -> Odometry:
    """Read a serialised message.

    Raises:
        OdometryError: It is none.
    """
    try:
        stamp, length, numbers = _LITTLE_ENDIAN if data[1] & 1 else _BIG_ENDIAN
        sec, nanosec = stamp.unpack_from(data, _HEADER)
        frame_id, at = _string(data, _HEADER + stamp.size, length)
        child_frame_id, at = _string(data, _align(at, length.size), length)
        x, y, z, *rotation = numbers.unpack_from(data, _align(at, 8))
    except (IndexError, struct.error, UnicodeDecodeError) as error:
        raise OdometryError(_UNREADABLE.format(len(data))) from error
    pose = _Pose(_Point(x, y, z), _Quaternion(*rotation))
    header = _Header(_Stamp(sec, nanosec), frame_id)
    return Odometry(header, child_frame_id, _PoseWithCovariance(pose))


def _string(data: bytes, at: int, length: struct.Struct) -> tuple[str, int]:
    """A string and where it ends; its length counts the zero byte behind it."""
    (size,) = length.unpack_from(data, at)
    begin, end = at + length.size, at + length.size + size
    # Of a string that ends beyond the data Python would take what there is.
    if size == 0 or data[end - 1]:
        raise IndexError
    return data[begin : end - 1].decode(), end


def _align(at: int, size: int) -> int:
    return _HEADER + -(-(at - _HEADER) // size) * size
