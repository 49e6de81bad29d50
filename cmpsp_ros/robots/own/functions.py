"""Kinematics of a model of one's own for compiled code: exact arcs under the twist of a control.

Its functions are called by their addresses, so that nothing but them is compiled for it. They get
numbers, and leave what they find in the robot's scratch: the twist in its first row, and in the
next ones the derivatives of its parts, a column for each control.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any, Final

import numpy as np

from cmpsp_ros.arrays import Array, IntArray
from cmpsp_ros.mpsp.jit import address_of, allocation_free, call
from cmpsp_ros.robots.kinematics import Kinematics
from cmpsp_ros.robots.omnidirectional_functions import drive_twist, put_slopes

MOTION, SLOPES, STEER = 0, 1, 2

_STEP: Final = 1e-100
"""Imaginary difference, from which no digits are lost."""


@allocation_free
def drive(poses: Array, controls: Array, k: int, duration: float, robot: Kinematics) -> None:
    """Pose ``k + 1`` from pose ``k``: one exact arc."""
    find(robot, MOTION, controls, k)
    twist = robot.scratch[0]
    drive_twist(poses, k, duration, twist[0], twist[1], twist[2])


@allocation_free
def put_gradients(
    A: Array, B: Array, heading: float, controls: Array, k: int, duration: float, robot: Kinematics
) -> None:
    """Fill derivatives of `drive`, those that are neither always 0 nor 1.

    Args:
        A: By the pose, shape ``(3, 3)`` or larger.
        B: By the control, shape ``(3, r)`` or larger.
        heading: At the beginning [rad].
        controls: Shape ``(N + 1, r)``.
        k: Number of the step.
        duration: Of the step [s].
        robot: The robot.
    """
    find(robot, MOTION, controls, k)
    find(robot, SLOPES, controls, k)
    twist, slopes, count = robot.scratch[0], robot.scratch[1:], controls.shape[1]
    put_slopes(A, B, heading, twist[0], twist[1], twist[2], duration, slopes, count)


@allocation_free
def find(robot: Kinematics, function: int, controls: Array, k: int) -> None:
    """Fill the robot's scratch from control ``k``."""
    third = controls[k, 2] if controls.shape[1] > 2 else 0.0
    given = robot.values, robot.scratch, controls[k, 0], controls[k, 1], third
    call(robot.functions[function], given)


@allocation_free
def steer(
    controls: Array, k: int, forward: float, left: float, turn_rate: float, robot: Kinematics
) -> None:
    """Fill control ``k`` with that of a twist."""
    call(robot.functions[STEER], (robot.values, robot.scratch, forward, left, turn_rate))
    for a in range(controls.shape[1]):
        controls[k, a] = robot.scratch[0, a]


@cache
def addresses(motion: Callable[..., Any], steering: Callable[..., Any], count: int) -> IntArray:
    """Where the machine code of a model's functions is, by `MOTION`, `SLOPES` and `STEER`.

    Args:
        motion: ``motion(constants, *controls)``: twist forward, to the left, turning.
        steering: ``steer(constants, forward, left, turn_rate)``: controls.
        count: Number of controls.
    """
    given = np.zeros(1), np.zeros((1, 1)), 0.0, 0.0, 0.0
    made = _of_two(motion) if count == 2 else _of_three(motion)
    functions = (*made, _steering(steering, count))
    _kept.append(functions)
    return np.array([address_of(None, each, *given) for each in functions])


_kept: Final[list[Any]] = []
"""Functions whose machine code is called by its address."""


def _of_two(function: Callable[..., Any]) -> tuple[Any, Any]:
    motion: Any = allocation_free(function)

    @allocation_free
    def put_twist(values: Array, out: Array, u: float, v: float, _w: float) -> None:
        _put(out, values[0], motion(values[1:], u, v))

    @allocation_free
    def put_derivatives(values: Array, out: Array, u: float, v: float, _w: float) -> None:
        _put_slope(out, 0, values[0], motion(values[1:], complex(u, _STEP), complex(v, 0.0)))
        _put_slope(out, 1, values[0], motion(values[1:], complex(u, 0.0), complex(v, _STEP)))

    return put_twist, put_derivatives


def _of_three(function: Callable[..., Any]) -> tuple[Any, Any]:
    motion: Any = allocation_free(function)

    @allocation_free
    def put_twist(values: Array, out: Array, u: float, v: float, w: float) -> None:
        _put(out, values[0], motion(values[1:], u, v, w))

    @allocation_free
    def put_derivatives(values: Array, out: Array, u: float, v: float, w: float) -> None:
        a, b, c = complex(u, 0.0), complex(v, 0.0), complex(w, 0.0)
        _put_slope(out, 0, values[0], motion(values[1:], complex(u, _STEP), b, c))
        _put_slope(out, 1, values[0], motion(values[1:], a, complex(v, _STEP), c))
        _put_slope(out, 2, values[0], motion(values[1:], a, b, complex(w, _STEP)))

    return put_twist, put_derivatives


def _steering(function: Callable[..., Any], count: int) -> Any:
    steering: Any = allocation_free(function)

    @allocation_free
    def put_controls(
        values: Array, out: Array, forward: float, left: float, turn_rate: float
    ) -> None:
        found = steering(values[1:], forward / values[0], left / values[0], turn_rate / values[0])
        out[0, 0], out[0, 1] = found[0], found[1]
        if count > 2:
            out[0, 2] = found[len(found) - 1]

    return put_controls


@allocation_free
def _put(out: Array, grip: float, twist: Any) -> None:
    out[0, 0], out[0, 1], out[0, 2] = grip * twist[0], grip * twist[1], grip * twist[2]


@allocation_free
def _put_slope(out: Array, a: int, grip: float, twist: Any) -> None:
    scale = grip / _STEP
    out[1, a] = scale * twist[0].imag
    out[2, a], out[3, a] = scale * twist[1].imag, scale * twist[2].imag
