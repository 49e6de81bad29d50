"""Kinematics of an omnidirectional robot for compiled code: exact arcs under wheel speeds."""

from __future__ import annotations

import math
from typing import Any

from cmpsp_ros.arrays import Array
from cmpsp_ros.mpsp.jit import allocation_free
from cmpsp_ros.robots.differential_drive_functions import sinc_and_slope


@allocation_free
def twist_of(controls: Array, k: int, twists: Array) -> Any:
    """Forward speed, speed to the left and turn rate of a control [m/s, m/s, rad/s].

    Args:
        controls: Speeds of three wheels, shape ``(N + 1, 3)`` [rad/s].
        k: Which of them.
        twists: Twist of a control, as a matrix, shape ``(3, 3)``.
    """
    first, second, third = controls[k, 0], controls[k, 1], controls[k, 2]
    return (
        twists[0, 0] * first + twists[0, 1] * second + twists[0, 2] * third,
        twists[1, 0] * first + twists[1, 1] * second + twists[1, 2] * third,
        twists[2, 0] * first + twists[2, 1] * second + twists[2, 2] * third,
    )


@allocation_free
def drive(poses: Array, controls: Array, k: int, duration: float, twists: Array) -> None:
    """Pose ``k + 1`` from pose ``k``: one exact arc.

    Args:
        poses: Shape ``(N + 1, 3)`` [m, m, rad].
        controls: As in `twist_of`, and so is `twists`.
        k: Number of the step.
        duration: Of the step [s].
        twists: See `controls`.
    """
    drive_twist(poses, k, duration, *twist_of(controls, k, twists))


@allocation_free
def drive_twist(
    poses: Array, k: int, duration: float, forward: float, left: float, turn_rate: float
) -> None:
    """The same under a twist [m/s, m/s, rad/s]."""
    turn = turn_rate * duration
    chord = sinc_and_slope(turn / 2.0)[0] * duration
    x, y = _turned(forward, left, poses[k, 2] + turn / 2.0)
    poses[k + 1, 0] = poses[k, 0] + chord * x
    poses[k + 1, 1] = poses[k, 1] + chord * y
    poses[k + 1, 2] = poses[k, 2] + turn


@allocation_free
def put_gradients(
    A: Array, B: Array, heading: float, controls: Array, k: int, duration: float, twists: Array
) -> None:
    """Fill derivatives of `drive`, those that are neither always 0 nor 1.

    Args:
        A: By the pose, shape ``(3, 3)`` or larger.
        B: By the control, shape ``(3, 3)`` or larger.
        heading: At the beginning [rad].
        controls: As in `twist_of`, and so is `twists`.
        k: Number of the step.
        duration: Of the step [s].
        twists: See `controls`.
    """
    forward, left, turn_rate = twist_of(controls, k, twists)
    put_slopes(A, B, heading, forward, left, turn_rate, duration, twists, controls.shape[1])


@allocation_free
def put_slopes(
    A: Array,
    B: Array,
    heading: float,
    forward: float,
    left: float,
    turn_rate: float,
    duration: float,
    slopes: Array,
    count: int,
) -> None:
    """The same of `drive_twist`, by so many controls with these derivatives of the twist."""
    half = turn_rate * duration / 2.0
    sinc, slope = sinc_and_slope(half)
    cosine, sine = math.cos(heading + half) * duration, math.sin(heading + half) * duration
    x, y = forward * cosine - left * sine, forward * sine + left * cosine
    A[0, 2], A[1, 2] = -sinc * y, sinc * x
    turned_x, turned_y = (slope * x - sinc * y) / 2.0, (slope * y + sinc * x) / 2.0
    for a in range(count):
        ahead, aside, turning = slopes[0, a], slopes[1, a], slopes[2, a] * duration
        B[0, a] = sinc * (cosine * ahead - sine * aside) + turned_x * turning
        B[1, a] = sinc * (sine * ahead + cosine * aside) + turned_y * turning
        B[2, a] = turning


@allocation_free
def _turned(x: float, y: float, angle: float) -> Any:
    cosine, sine = math.cos(angle), math.sin(angle)
    return cosine * x - sine * y, sine * x + cosine * y
