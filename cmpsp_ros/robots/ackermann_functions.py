"""Kinematics of a car for compiled code: exact arcs at constant speed and steering angle."""

from __future__ import annotations

import math

from cmpsp_ros.arrays import Array
from cmpsp_ros.mpsp.jit import allocation_free
from cmpsp_ros.robots.differential_drive_functions import sinc_and_slope


@allocation_free
def drive(
    poses: Array, controls: Array, k: int, duration: float, wheel_radius: float, wheel_base: float
) -> None:
    """Pose ``k + 1`` from pose ``k``, of the middle of the rear axle: one exact arc.

    Args:
        poses: Shape ``(N + 1, 3)`` [m, m, rad].
        controls: Speed of the rear wheels and steering angle, ``(N + 1, 2)`` [rad/s, rad].
        k: Number of the step.
        duration: Of the step [s].
        wheel_radius: Of the robot [m].
        wheel_base: Of the robot [m].
    """
    length = controls[k, 0] * wheel_radius * duration
    turn = length * math.tan(controls[k, 1]) / wheel_base
    chord = length * sinc_and_slope(turn / 2.0)[0]
    course = poses[k, 2] + turn / 2.0
    poses[k + 1, 0] = poses[k, 0] + chord * math.cos(course)
    poses[k + 1, 1] = poses[k, 1] + chord * math.sin(course)
    poses[k + 1, 2] = poses[k, 2] + turn


@allocation_free
def put_gradients(
    A: Array,
    B: Array,
    heading: float,
    controls: Array,
    k: int,
    duration: float,
    wheel_radius: float,
    wheel_base: float,
) -> None:
    """Fill derivatives of `drive`, those that are neither always 0 nor 1; arguments as there.

    Args:
        A: By the pose, shape ``(3, 3)`` or larger.
        B: By the control, shape ``(3, 2)`` or larger.
        heading: At the beginning [rad].
        controls: See `drive`.
        k: See `drive`.
        duration: See `drive`.
        wheel_radius: See `drive`.
        wheel_base: See `drive`.
    """
    length_per_wheel, bend = wheel_radius * duration, math.tan(controls[k, 1]) / wheel_base
    length = controls[k, 0] * length_per_wheel
    half = length * bend / 2.0
    sinc, slope = sinc_and_slope(half)
    cosine, sine = math.cos(heading + half), math.sin(heading + half)
    x_turn = length * (slope * cosine - sinc * sine) / 2.0
    y_turn = length * (slope * sine + sinc * cosine) / 2.0
    by_wheel = length_per_wheel * bend
    by_steering = length * (1.0 / wheel_base + wheel_base * bend * bend)
    A[0, 2], A[1, 2] = -length * sinc * sine, length * sinc * cosine
    B[0, 0] = sinc * cosine * length_per_wheel + x_turn * by_wheel
    B[1, 0] = sinc * sine * length_per_wheel + y_turn * by_wheel
    B[0, 1], B[1, 1] = x_turn * by_steering, y_turn * by_steering
    B[2, 0], B[2, 1] = by_wheel, by_steering
