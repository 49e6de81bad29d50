"""Odometry messages: the pose in them, and what makes them unusable."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from cmpsp_ros.arrays import Array
from cmpsp_ros.guidance.horizon import NANOSECONDS
from cmpsp_ros.guidance.messages import checks
from cmpsp_ros.guidance.messages.checks import check_frame, is_place


class OdometryError(ValueError):
    """Odometry that is unusable; the message says why."""


def stamp_of(message: Any) -> int:
    """Time stamp of a message with a header [ns]."""
    stamp = message.header.stamp
    return int(stamp.sec * NANOSECONDS + stamp.nanosec)


def pose_of(message: Any, frame_id: str) -> Array:
    """Planar pose ``(x, y, heading)`` [m, m, rad] of an odometry message (REP-105).

    Raises:
        OdometryError: It is in another frame, is not finite, has no orientation, or is farther
            from the origin than any place on Earth.
    """
    check_frame('Odometry is', message, frame_id, OdometryError)
    position, q = message.pose.pose.position, message.pose.pose.orientation
    x, y, z, w = q.x, q.y, q.z, q.w
    length = math.sqrt(x * x + y * y + z * z + w * w)
    if abs(length - 1.0) > 0.01:
        raise OdometryError(f'Odometry has an orientation of length {length:.3g}, wanted 1.')
    pose = (position.x, position.y, heading_of(q))
    if not all(map(math.isfinite, pose)):
        raise OdometryError(f'Odometry has a pose that is not finite: {list(pose)}.')
    if not is_place(position.x, position.y):
        raise OdometryError(
            f'Odometry has a position of {position.x:.3g}, {position.y:.3g} m, wanted one on Earth.'
        )
    return np.array(pose)


def heading_of(orientation: Any) -> float:
    """Heading of a quaternion of any length but 0 [rad]."""
    x, y, z, w = orientation.x, orientation.y, orientation.z, orientation.w
    return math.atan2(2.0 * (w * z + x * y), w * w + x * x - y * y - z * z)


def check_age(stamp: int, now: int, timeout: float) -> None:
    """Refuse odometry that does not fit the clock.

    Args:
        stamp: Its time stamp [ns].
        now: Present time [ns].
        timeout: `odom_timeout` [s].

    Raises:
        OdometryError: It is too old, or as far ahead.
    """
    checks.check_age('Odometry is', 'odom_timeout', stamp, now, timeout, OdometryError)
