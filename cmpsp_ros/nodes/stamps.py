"""ROS time stamps as whole nanoseconds and back."""

from __future__ import annotations

from builtin_interfaces.msg import Time


def stamp_ns(stamp: Time) -> int:
    """A time stamp as nanoseconds."""
    return int(stamp.sec) * 10**9 + int(stamp.nanosec)


def stamp_message(nanoseconds: int) -> Time:
    """Nanoseconds as a time stamp."""
    seconds, rest = divmod(int(nanoseconds), 10**9)
    return Time(sec=seconds, nanosec=rest)
