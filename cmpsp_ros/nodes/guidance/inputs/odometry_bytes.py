"""Odometry read from the bytes in which it came, but for what nobody looks at.

rclpy makes a Python object of each part of a message, covariances and twist too, which takes as
long as deciding on it. So the subscription is asked for the bytes: a message in CDR (OMG DDS-RTPS
2.5, section 10, with the alignment of XCDR version 1).
"""

from __future__ import annotations

import struct

from cmpsp_ros.guidance import NANOSECONDS
from cmpsp_ros.guidance.messages import OdometryError, OdometryReading

_HEADER = 4
"""Bytes of the encapsulation header; alignment counts from its end."""
_LITTLE_ENDIAN, _BIG_ENDIAN = (
    (struct.Struct(f'{order}iI'), struct.Struct(f'{order}I'), struct.Struct(f'{order}7d'))
    for order in '<>'
)
"""Of a stamp, of the length of a string, of a pose."""

_UNREADABLE = 'Odometry cannot be read: found {} bytes that are no nav_msgs/Odometry in CDR.'


def read_odometry(data: bytes) -> OdometryReading:
    """Read a serialised `nav_msgs/Odometry`.

    Raises:
        OdometryError: It is none.
    """
    try:
        stamp, length, numbers = _LITTLE_ENDIAN if data[1] & 1 else _BIG_ENDIAN
        sec, nanosec = stamp.unpack_from(data, _HEADER)
        frame_id, at = _string(data, _HEADER + stamp.size, length)
        child_frame_id, at = _string(data, _align(at, length.size), length)
        x, y, _, *rotation = numbers.unpack_from(data, _align(at, 8))
    except (IndexError, struct.error, UnicodeDecodeError) as error:
        raise OdometryError(_UNREADABLE.format(len(data))) from error
    stamp_ns = sec * NANOSECONDS + nanosec
    qx, qy, qz, qw = rotation
    return OdometryReading(stamp_ns, frame_id, child_frame_id, (x, y), (qx, qy, qz, qw))


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
