"""Kinematics of an omnidirectional robot for compiled code: exact arcs under constant twists."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cmpsp_ros.mpsp.jit.compiled import allocation_free
from cmpsp_ros.robots.differential_drive_functions import sinc_and_slope

Array = NDArray[np.float64]


@allocation_free
def drive(poses: Array, twists: Array, k: int, duration: float, grip: float) -> None:
    """Pose ``k + 1`` from pose ``k``: one exact arc.

    Args:
        poses: Shape ``(N + 1, 3)`` [m, m, rad].
        twists: Forward, to the left and turning, shape ``(N + 1, 3)`` [m/s, m/s, rad/s].
        k: Number of the step.
        duration: Of the step [s].
        grip: Fraction of the twist that slip leaves.
    """
    turn = twists[k, 2] * grip * duration
    chord = sinc_and_slope(turn / 2.0)[0] * grip * duration
    x, y = _turned(twists[k, 0], twists[k, 1], poses[k, 2] + turn / 2.0)
    poses[k + 1, 0] = poses[k, 0] + chord * x
    poses[k + 1, 1] = poses[k, 1] + chord * y
    poses[k + 1, 2] = poses[k, 2] + turn


@allocation_free
def put_gradients(
    A: Array, B: Array, heading: float, twists: Array, k: int, duration: float, grip: float
) -> None:
    """Fill derivatives of `drive`, those that are neither always 0 nor 1.

    Args:
        A: By the pose, shape ``(3, 3)`` or larger.
        B: By the twist, shape ``(3, 3)`` or larger.
        heading: At the beginning [rad].
        twists: As in `drive`.
        k: See `twists`.
        duration: See `twists`.
        grip: See `twists`.
    """
    held = grip * duration
    half = twists[k, 2] * held / 2.0
    sinc, slope = sinc_and_slope(half)
    cosine, sine = math.cos(heading + half), math.sin(heading + half)
    x, y = _turned(twists[k, 0] * held, twists[k, 1] * held, heading + half)
    A[0, 2], A[1, 2] = -sinc * y, sinc * x
    B[0, 0], B[0, 1] = sinc * cosine * held, -sinc * sine * held
    B[1, 0], B[1, 1] = sinc * sine * held, sinc * cosine * held
    B[0, 2] = (slope * x - sinc * y) / 2.0 * held
    B[1, 2] = (slope * y + sinc * x) / 2.0 * held
    B[2, 2] = held


@allocation_free
def _turned(x: float, y: float, angle: float) -> Any:
    cosine, sine = math.cos(angle), math.sin(angle)
    return cosine * x - sine * y, sine * x + cosine * y
