"""Robots for the reference solver: one step of each model, and its limits as linear rows.

The robots' own kinematics are not used, so a fault there cannot recur here; but a model of one's
own is nothing else than its function.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from cmpsp_ros.arrays import Array
from cmpsp_ros.robots import Ackermann, CustomRobot, DifferentialDrive, Omnidirectional, Robot
from cmpsp_ros.studies.errors import StudyError


class Limits(NamedTuple):
    """Limits of a robot's controls.

    Attributes:
        rows: What is limited, as linear functions of the control, shape ``(q, r)``.
        largest: Largest magnitude of each, shape ``(q,)``; infinite for none.
        change: Largest change of each in a second, shape ``(q,)``; infinite for none.
    """

    rows: Array
    largest: Array
    change: Array


def limits_of(robot: Robot) -> Limits:
    """The limits of a robot: of its wheels, and of a car's steering."""
    speed, acceleration = robot.max_wheel_speed, robot.max_wheel_acceleration
    if isinstance(robot, Ackermann):
        largest = np.array([speed, robot.max_steering_angle])
        return Limits(np.eye(2), largest, np.array([acceleration, robot.max_steering_rate]))
    if isinstance(robot, CustomRobot):
        return Limits(np.eye(robot.n_controls), robot.bounds, np.array(robot.change_limits))
    rows = np.eye(2)
    if isinstance(robot, Omnidirectional):
        rims = np.array(robot.rims)
        rows = rims @ np.linalg.inv(rims[robot.driven])
    return Limits(rows, np.full(len(rows), speed), np.full(len(rows), acceleration))


def moved(casadi: Any, robot: Robot, heading: Any, control: Any, duration: float) -> Any:
    """By how much a control that is held changes the pose, as an expression ``(3,)``.

    Args:
        casadi: The module.
        robot: The robot.
        heading: Expression of the heading [rad].
        control: Expressions of the controls, shape ``(r,)``.
        duration: How long it is held [s].

    Raises:
        StudyError: The robot is of a model that is not known here.
    """
    aside: Any = 0.0
    if isinstance(robot, DifferentialDrive):
        ahead = (control[0] + control[1]) * robot.wheel_radius / 2.0
        turn_rate = (control[0] - control[1]) * robot.wheel_radius / (2.0 * robot.half_track)
    elif isinstance(robot, Ackermann):
        ahead = control[0] * robot.wheel_radius
        turn_rate = ahead * casadi.tan(control[1]) / robot.wheel_base
    elif isinstance(robot, Omnidirectional):
        rims = np.array(robot.rims)[robot.driven] / robot.wheel_radius
        twist = casadi.DM(np.linalg.inv(rims)) @ control
        ahead, aside, turn_rate = twist[0], twist[1], twist[2]
    elif isinstance(robot, CustomRobot):
        given = (control[k] for k in range(robot.n_controls))
        found = robot.motion(robot.constants, *given)
        ahead, aside, turn_rate = (robot.wheel_radius * each for each in found)
    else:
        name = type(robot).__name__
        raise StudyError(f'robot.model: found {name}, wanted one that the judge knows')
    half = turn_rate * duration / 2.0
    # sin(a) / a by its series, exact to rounding for every turn that matters here.
    square = half * half
    sinc = 1 - square / 6 * (1 - square / 20 * (1 - square / 42 * (1 - square / 72)))
    cosine, sine = casadi.cos(heading + half), casadi.sin(heading + half)
    x, y = ahead * cosine - aside * sine, ahead * sine + aside * cosine
    return casadi.vertcat(x * sinc * duration, y * sinc * duration, 2.0 * half)


def limit(casadi: Any, opti: Any, robot: Robot, controls: Any, period: float) -> None:
    """Keep controls to the limits of a robot that begins at rest.

    Args:
        casadi: The module.
        opti: The program.
        robot: The robot.
        controls: Its variables, shape ``(r, N)``.
        period: From one control to the next [s].
    """
    limits = limits_of(robot)
    values = limits.rows @ controls
    before = casadi.horzcat(casadi.DM.zeros(len(limits.rows), 1), values[:, :-1])
    for row, (largest, change) in enumerate(zip(limits.largest, limits.change, strict=True)):
        if largest < math.inf:
            opti.subject_to(opti.bounded(-largest, values[row, :].T, largest))
        if change < math.inf:
            at_once = change * period
            opti.subject_to(opti.bounded(-at_once, (values - before)[row, :].T, at_once))


def excess(robot: Robot, controls: Array, period: float) -> float:
    """By how much controls ``(N, r)`` are beyond the limits of `limit`; 0 or less for not."""
    limits = limits_of(robot)
    values = controls @ limits.rows.T
    changes = np.diff(values, axis=0, prepend=0.0 * values[:1])
    beyond = np.abs(values) - limits.largest, np.abs(changes) - limits.change * period
    return float(np.max(beyond))
