"""Kinematics (91) for compiled code: exact arcs under constant wheel speeds."""

from __future__ import annotations

import math
from typing import Any

from cmpsp_ros.arrays import Array
from cmpsp_ros.mpsp.jit import allocation_free


@allocation_free
def sinc_and_slope(a: float) -> Any:
    """``sin(a)/a`` and its derivative, by series where the quotient would lose digits."""
    if abs(a) < 1e-2:
        a2 = a * a
        value = 1.0 - a2 / 6.0 * (1.0 - a2 / 20.0 * (1.0 - a2 / 42.0))
        slope = -a / 3.0 * (1.0 - a2 / 10.0 * (1.0 - a2 / 28.0 * (1.0 - a2 / 54.0)))
        return value, slope
    sine = math.sin(a)
    return sine / a, (a * math.cos(a) - sine) / (a * a)


@allocation_free
def drive(
    poses: Array,
    wheel_speeds: Array,
    k: int,
    duration: float,
    wheel_radius: float,
    half_track: float,
) -> None:
    """Pose ``k + 1`` from pose ``k``: one exact arc."""
    right, left = wheel_speeds[k, 0], wheel_speeds[k, 1]
    length = (right + left) * wheel_radius / 2.0 * duration
    turn = (right - left) * wheel_radius / (2.0 * half_track) * duration
    chord = length * sinc_and_slope(turn / 2.0)[0]
    course = poses[k, 2] + turn / 2.0
    poses[k + 1, 0] = poses[k, 0] + chord * math.cos(course)
    poses[k + 1, 1] = poses[k, 1] + chord * math.sin(course)
    poses[k + 1, 2] = poses[k, 2] + turn


@allocation_free
def gradients(
    heading: float,
    right: float,
    left: float,
    duration: float,
    wheel_radius: float,
    half_track: float,
) -> Any:
    """Derivatives of `drive`, those that are neither 0 nor 1 and not those of another twice.

    Returns:
        Of x and of y by the heading [m/rad]; of x by the right and the left wheel, and of y, all
        [m s/rad]; of the heading by the right wheel, and by the left one the same negative [s].
    """
    length_per_wheel = wheel_radius / 2.0 * duration
    turn_per_wheel = wheel_radius / (2.0 * half_track) * duration
    length = (right + left) * length_per_wheel
    turn = (right - left) * turn_per_wheel
    sinc, slope = sinc_and_slope(turn / 2.0)
    course = heading + turn / 2.0
    cosine, sine = math.cos(course), math.sin(course)
    x_turn = length * (slope * cosine - sinc * sine) / 2.0
    y_turn = length * (slope * sine + sinc * cosine) / 2.0
    return (
        -length * sinc * sine,
        length * sinc * cosine,
        sinc * cosine * length_per_wheel + x_turn * turn_per_wheel,
        sinc * cosine * length_per_wheel - x_turn * turn_per_wheel,
        sinc * sine * length_per_wheel + y_turn * turn_per_wheel,
        sinc * sine * length_per_wheel - y_turn * turn_per_wheel,
        turn_per_wheel,
    )
