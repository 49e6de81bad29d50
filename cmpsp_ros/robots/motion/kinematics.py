"""Motion of every robot for compiled code: exact arcs under a control that is held.

A model is three functions that are called by their addresses, so that nothing but them is compiled
for it. They get numbers and write to the robot's scratch: in its first row how far the robot moves
forward and to the left of its path, and turns, in a time [m, m, rad]; in the next three rows the
derivatives of these, a column for each control.
"""

import math
from collections.abc import Callable
from functools import cache
from typing import Any, Final, NamedTuple

import numpy as np

from cmpsp_ros.arrays import Array, IntArray
from cmpsp_ros.mpsp.jit import address_of, allocation_free, call, inner
from cmpsp_ros.robots.motion.arcs import Arc, arc_from

_DISPLACE, _DIFFERENTIATE, _STEER = range(3)

# Imaginary difference, from which no digits are lost; a power of two scales without rounding.
_STEP: Final = 2.0**-333


class Kinematics(NamedTuple):
    """A robot for compiled code, of one type for all models."""

    functions: IntArray  # addresses of the model's functions, see `addresses`
    values: Array  # numbers that they are given
    scratch: Array  # written by them, shape ``(4, 3)``
    # Wheel speeds of a control, as a matrix, shape ``(W, r)``. Wheels that are controls come first.
    wheels: Array
    bounds: Array  # largest magnitudes of the controls, shape ``(r,)``
    n_speeds: int  # how many of the controls, the first, are 0 at rest; the others are angles
    max_wheel_speed: float  # limit of each wheel [rad/s]
    max_speed: float  # largest speed along the path [m/s]
    max_lateral_acceleration: float  # limit of `lateral_acceleration` [m/s^2]; infinite for none
    max_curvature: float  # largest curvature of its path; infinite if it turns on the spot [1/m]
    drives_sideways: bool  # whether it moves in every direction without turning first


@allocation_free
def drive(poses: Array, controls: Array, k: int, duration: float, robot: Kinematics) -> None:
    """Pose ``k + 1`` from pose ``k``: one exact arc."""
    _displace(robot, _DISPLACE, controls, k, duration)
    forward, left, turn = robot.scratch[0, 0], robot.scratch[0, 1], robot.scratch[0, 2]
    sinc, course = sinc_and_slope(turn / 2.0)[0], poses[k, 2] + turn / 2.0
    ahead, aside, cosine, sine = forward * sinc, left * sinc, math.cos(course), math.sin(course)
    poses[k + 1, 0] = poses[k, 0] + (ahead * cosine - aside * sine)
    poses[k + 1, 1] = poses[k, 1] + (ahead * sine + aside * cosine)
    poses[k + 1, 2] = poses[k, 2] + turn


@allocation_free
def put_gradients(
    A: Array, B: Array, heading: float, controls: Array, k: int, duration: float, robot: Kinematics
) -> None:
    """Fill the derivatives of `drive` by pose and control, those that are not always 0."""
    for i in range(3):
        A[i, i] = 1.0
    _displace(robot, _DIFFERENTIATE, controls, k, duration)
    moved = robot.scratch
    forward, left, half = moved[0, 0], moved[0, 1], moved[0, 2] / 2.0
    sinc, slope = sinc_and_slope(half)
    cosine, sine = math.cos(heading + half), math.sin(heading + half)
    along_x, along_y = slope * cosine - sinc * sine, slope * sine + sinc * cosine
    x_turn = (forward * along_x - left * along_y) / 2.0
    y_turn = (forward * along_y + left * along_x) / 2.0
    A[0, 2] = -forward * sinc * sine - left * sinc * cosine
    A[1, 2] = forward * sinc * cosine - left * sinc * sine
    for a in range(controls.shape[1]):
        ahead, aside, turning = moved[1, a], moved[2, a], moved[3, a]
        B[0, a] = sinc * cosine * ahead - sinc * sine * aside + x_turn * turning
        B[1, a] = sinc * sine * ahead + sinc * cosine * aside + y_turn * turning
        B[2, a] = turning


@allocation_free
def arc_of(
    x: float, y: float, heading: float, controls: Array, k: int, duration: float, robot: Kinematics
) -> Arc:
    """The arc that a control leads along from a pose."""
    _displace(robot, _DISPLACE, controls, k, duration)
    forward, left, turn = robot.scratch[0, 0], robot.scratch[0, 1], robot.scratch[0, 2]
    if left == 0.0:
        return arc_from(x, y, heading, forward, turn)
    return arc_from(x, y, heading + math.atan2(left, forward), math.hypot(forward, left), turn)


@allocation_free
def steer(
    controls: Array,
    k: int,
    forward: float,
    left: float,
    turn_rate: float,
    curvature: float,
    robot: Kinematics,
) -> None:
    """Fill control ``k`` with that of a twist and a curvature [m/s, m/s, rad/s, 1/m]."""
    given = robot.values, robot.scratch, forward, left, turn_rate, curvature
    call(robot.functions[_STEER], given)
    for a in range(controls.shape[1]):
        controls[k, a] = robot.scratch[0, a]


@allocation_free
def within_limits(controls: Array, k: int, robot: Kinematics) -> None:
    """Limit the angles of control ``k``, and slow all its wheels alike to the other limits."""
    for a in range(robot.n_speeds, controls.shape[1]):
        controls[k, a] = min(max(controls[k, a], -robot.bounds[a]), robot.bounds[a])
    slowed = min(1.0, robot.max_wheel_speed / max(fastest_wheel(controls, k, robot), 1e-12))
    for a in range(robot.n_speeds):
        controls[k, a] *= slowed
    if robot.max_lateral_acceleration < math.inf:
        across = abs(lateral_acceleration(controls, k, robot))
        slowed = math.sqrt(min(1.0, robot.max_lateral_acceleration / max(across, 1e-12)))
        for a in range(robot.n_speeds):
            controls[k, a] *= slowed


@allocation_free
def fastest_wheel(controls: Array, k: int, robot: Kinematics) -> float:
    """Speed of the wheel that a control turns fastest [rad/s]."""
    fastest = 0.0
    for i in range(robot.wheels.shape[0]):
        speed = 0.0
        for a in range(controls.shape[1]):
            speed += robot.wheels[i, a] * controls[k, a]
        # `max` drops NaN, a sum propagates it.
        fastest = max(fastest, abs(speed)) + 0.0 * speed
    return fastest


@allocation_free
def lateral_acceleration(controls: Array, k: int, robot: Kinematics) -> float:
    """Speed along the path times turn rate under control ``k`` [m/s^2], of the sign of both."""
    _displace(robot, _DISPLACE, controls, k, 1.0)
    across: float = _signed_speed(robot) * robot.scratch[0, 2]
    return across


@allocation_free
def put_lateral_gradient(
    gradient: Array, sign: float, controls: Array, k: int, robot: Kinematics
) -> None:
    """Fill the gradient ``(r,)`` of `lateral_acceleration` by control ``k``, times a sign."""
    _displace(robot, _DIFFERENTIATE, controls, k, 1.0)
    moved, speed = robot.scratch, _signed_speed(robot)
    for a in range(controls.shape[1]):
        faster = moved[1, a]
        if speed != 0.0:
            faster = (moved[0, 0] * moved[1, a] + moved[0, 1] * moved[2, a]) / speed
        gradient[a] = sign * (faster * moved[0, 2] + speed * moved[3, a])


@allocation_free
def _signed_speed(robot: Kinematics) -> float:
    """Speed along the path of the displacement in the robot's scratch, negative backward."""
    forward, left = robot.scratch[0, 0], robot.scratch[0, 1]
    speed = math.hypot(forward, left)
    return speed if robot.drives_sideways else math.copysign(speed, forward)


@allocation_free
def roll_out(poses: Array, controls: Array, durations: Array, robot: Kinematics) -> None:
    """Fill the poses after the first."""
    for k in range(durations.shape[0]):
        drive(poses, controls, k, durations[k], robot)


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
def _displace(robot: Kinematics, function: int, controls: Array, k: int, duration: float) -> None:
    """Fill the robot's scratch from control ``k``."""
    third = controls[k, 2] if controls.shape[1] > 2 else 0.0
    given = robot.values, robot.scratch, controls[k, 0], controls[k, 1], third, duration
    call(robot.functions[function], given)


@cache
def addresses(*functions: Any) -> IntArray:
    """Addresses of a model's functions, compiled: displacement, its derivatives, and steering."""
    _kept.append(functions)
    given = np.zeros(1), np.zeros((1, 1)), 0.0, 0.0, 0.0, 0.0
    return np.array([address_of(None, each, *given) for each in functions])


_kept: Final[list[Any]] = []  # functions whose machine code is called by its address


@cache
def displacement(motion: Callable[..., Any], count: int) -> tuple[Any, Any]:
    """Displacement and its derivatives, compiled from the motion of a model with so many controls.

    ``motion(constants, *controls)`` is the twist for a wheel radius of 1, also of complex numbers.
    """
    twist_of: Any = inner(motion)

    @inner
    def displace(values: Array, out: Array, u: float, v: float, w: float, time: float) -> None:
        twist, scale = twist_of(values[1:], *(u, v, w)[:count]), values[0] * time
        out[0, 0], out[0, 1], out[0, 2] = scale * twist[0], scale * twist[1], scale * twist[2]

    @inner
    def differentiate(values: Array, out: Array, u: float, v: float, w: float, time: float) -> None:
        displace(values, out, u, v, w, time)
        scale = values[0] * time / _STEP
        for a in range(count):
            x, y = complex(u, _STEP * (a == 0)), complex(v, _STEP * (a == 1))
            twist = twist_of(values[1:], *(x, y, complex(w, _STEP * (a == 2)))[:count])
            out[1, a], out[2, a] = scale * twist[0].imag, scale * twist[1].imag
            out[3, a] = scale * twist[2].imag

    return displace, differentiate


@cache
def steering(steer: Callable[..., Any], count: int) -> Any:
    """Control of a twist, compiled from ``steer(constants, forward, left, turn_rate)``."""
    controls_of: Any = inner(steer)

    @inner
    def put_controls(
        values: Array, out: Array, forward: float, left: float, turn_rate: float, _curvature: float
    ) -> None:
        found = controls_of(
            values[1:], forward / values[0], left / values[0], turn_rate / values[0]
        )
        out[0, 0], out[0, 1] = found[0], found[1]
        if count > 2:
            out[0, 2] = found[len(found) - 1]

    return put_controls
