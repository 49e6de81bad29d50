"""Kinematics (91) of the two-wheeled robot: exact arcs under constant wheel speeds."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cmpsp_ros.mpsp.jit.compiled import allocation_free
from cmpsp_ros.robots.twist_limits import TwistLimits

Array = NDArray[np.float64]

RIGHT, LEFT = 0, 1
"""Places of the two wheels in a control vector ``U = [w_r, w_l]``."""


@dataclass(frozen=True)
class DifferentialDrive:
    """A robot on two driven wheels, steered by their difference in speed.

    Attributes:
        wheel_radius: The paper's ``r`` [m].
        half_track: Distance from a wheel to the robot's centre, the paper's ``L`` [m].
        max_wheel_speed: Limit (94) of either wheel [rad/s]; infinite when there is none.
        max_wheel_acceleration: Limit of either wheel [rad/s^2]; infinite when there is none.
    """

    wheel_radius: float = 0.035
    half_track: float = 0.055
    max_wheel_speed: float = math.inf
    max_wheel_acceleration: float = math.inf

    @property
    def max_speed(self) -> float:
        """Largest speed along the path [m/s], with both wheels at their limit."""
        return self.wheel_radius * self.max_wheel_speed

    def slipping(self, slip: float) -> DifferentialDrive:
        """The same robot with wheels that move it by a fraction ``1 - slip`` of their turning."""
        return replace(self, wheel_radius=(1.0 - slip) * self.wheel_radius) if slip else self

    def twist_limits(self) -> TwistLimits:
        """Twists that the wheel-speed limit allows.

        Raises:
            ValueError: There is no wheel-speed limit.
        """
        return TwistLimits(self.max_speed, self.max_speed / self.half_track, self.half_track)

    def twist(self, wheel_speeds: Array) -> Array:
        """Body twists ``(..., 2)`` [m/s, rad/s] of wheel speeds ``(..., 2)`` [rad/s], by (91)."""
        if wheel_speeds.ndim == 1:
            # The same operations on numbers take a fraction of the time.
            right, left = wheel_speeds.tolist()
            speed = (right + left) * (self.wheel_radius / 2.0)
            return np.array([speed, (right - left) * (self.wheel_radius / (2.0 * self.half_track))])
        right, left = wheel_speeds[..., RIGHT], wheel_speeds[..., LEFT]
        twist = np.empty_like(wheel_speeds, dtype=float)
        twist[..., 0] = (right + left) * (self.wheel_radius / 2.0)
        twist[..., 1] = (right - left) * (self.wheel_radius / (2.0 * self.half_track))
        return twist

    def wheel_speeds(self, twist: Array) -> Array:
        """Wheel speeds ``(..., 2)`` [rad/s] of body twists ``(..., 2)`` [m/s, rad/s]."""
        speed, rim = twist[..., 0], twist[..., 1] * self.half_track
        return np.stack([speed + rim, speed - rim], axis=-1) / self.wheel_radius

    def roll_out(self, pose: Array, wheel_speeds: Array, durations: Array) -> Array:
        """Poses along the path driven, exactly, each wheel-speed pair held for its duration.

        Args:
            pose: First pose, shape ``(3,)`` [m, m, rad].
            wheel_speeds: Shape ``(N, 2)`` [rad/s].
            durations: Shape ``(N,)`` [s].

        Returns:
            Poses ``(N + 1, 3)`` [m, m, rad]; the heading is not wrapped.
        """
        poses = np.empty((len(durations) + 1, 3))
        poses[0] = pose
        _roll_out(poses, wheel_speeds, durations, self.wheel_radius, self.half_track)
        return poses

    def jacobians(self, poses: Array, wheel_speeds: Array, durations: Array) -> tuple[Array, Array]:
        """Derivatives of every step of `roll_out` by its pose and by its wheel speeds.

        Args:
            poses: Shape ``(N + 1, 3)``, as returned by `roll_out`.
            wheel_speeds: Shape ``(N, 2)`` [rad/s].
            durations: Shape ``(N,)`` [s].

        Returns:
            ``A (N, 3, 3)`` and ``B (N, 3, 2)``: the transposes of the paper's
            ``dF_k/dX_k`` and ``dF_k/dU_k``, which it writes with the derivative along rows.
        """
        steps = len(durations)
        A = np.zeros((steps, 3, 3))
        B = np.empty((steps, 3, 2))
        _jacobians(A, B, poses, wheel_speeds, durations, self.wheel_radius, self.half_track)
        return A, B


@allocation_free
def _sinc_and_slope(a: float) -> Any:
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
    chord = length * _sinc_and_slope(turn / 2.0)[0]
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
    sinc, slope = _sinc_and_slope(turn / 2.0)
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


@allocation_free
def _roll_out(
    poses: Array, wheel_speeds: Array, durations: Array, wheel_radius: float, half_track: float
) -> None:
    for k in range(durations.shape[0]):
        drive(poses, wheel_speeds, k, durations[k], wheel_radius, half_track)


@allocation_free
def _jacobians(
    A: Array,
    B: Array,
    poses: Array,
    wheel_speeds: Array,
    durations: Array,
    wheel_radius: float,
    half_track: float,
) -> None:
    for k in range(durations.shape[0]):
        A[k, 0, 2], A[k, 1, 2], B[k, 0, 0], B[k, 0, 1], B[k, 1, 0], B[k, 1, 1], turn = gradients(
            poses[k, 2],
            wheel_speeds[k, 0],
            wheel_speeds[k, 1],
            durations[k],
            wheel_radius,
            half_track,
        )
        for i in range(3):
            A[k, i, i] = 1.0
        B[k, 2, 0], B[k, 2, 1] = turn, -turn
