"""Settings of the guidance law and of the plant, built from a resolved set of parameters."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from itertools import pairwise
from typing import Any, Final

import numpy as np

from cmpsp_ros.guidance import (
    GuidanceSettings,
    InitialGuess,
    MovingObstacles,
    Safety,
    SolverSettings,
    Weights,
)
from cmpsp_ros.mpsp import ProblemError
from cmpsp_ros.mpsp.qp import available, backend
from cmpsp_ros.parameters.courses.course import place_problems, start_problems
from cmpsp_ros.parameters.courses.goals import (
    follow_of,
    follow_problems,
    goal_problems,
    heading_of,
    waypoints_of,
)
from cmpsp_ros.parameters.courses.obstacles import obstacle_problems, obstacles_of
from cmpsp_ros.parameters.courses.roads import road_of, road_problems
from cmpsp_ros.parameters.errors import ParameterError, Problem, describe
from cmpsp_ros.parameters.parameter import fields_of
from cmpsp_ros.parameters.robots.footprints import footprint_of, footprint_problems
from cmpsp_ros.parameters.robots.models import robot_of, robot_problems
from cmpsp_ros.parameters.robots.sensors import sight_of, sight_problems
from cmpsp_ros.parameters.table import Values
from cmpsp_ros.simulator import OdometryErrors, Physics, PlantSettings

_MOST_STEPS: Final = 10_000
"""Control steps beyond which the horizon's matrices would fill the memory."""

_LARGEST: Final = 1e9
_SMALLEST: Final = 1e-6
_DIVISORS: Final = ('robot.wheel_radius', 'robot.half_track', 'weights.control_change')
"""What the law divides by, beside a wheel limit that is not 0."""

_NAMESPACE: Final = re.compile(r'(?:/[A-Za-z_]\w*)+', re.ASCII)


def guidance_settings(values: Values) -> GuidanceSettings:
    """Settings of the guidance law.

    Returns:
        The settings, checked against each other.

    Raises:
        ParameterError: If a number is far out of range or the footprint is invalid; otherwise, all
            of these problems: an invalid or too narrow road, an invalid obstacle, a goal off the
            road or in an obstacle, times out of order or too short for a control step and its
            command, a followed road with an end, a QP back end that is not installed, an invalid
            namespace of another robot.
    """
    _raise_if_any([*_size_problems(values), *footprint_problems(values)])
    goals = follow_problems if values['follow.speed'] else goal_problems
    groups = (
        robot_problems,
        _time_problems,
        road_problems,
        obstacle_problems,
        sight_problems,
        goals,
        _solver_problems,
        _others_problems,
        start_problems,
    )
    _raise_if_any([problem for group in groups for problem in group(values)])
    footprint, radius = footprint_of(values)
    return GuidanceSettings(
        robot=robot_of(values),
        road=road_of(values),
        goal=tuple(values['goal.position']),
        goal_tolerance=values['goal.tolerance'],
        goal_heading=heading_of(values, 'goal.heading'),
        heading_tolerance=values['goal.heading_tolerance'],
        final_time=values['final_time'] or math.inf,
        waypoints=waypoints_of(values),
        may_be_late=values['goal.may_be_late'],
        hold=values['goal.hold'],
        nominal_speed=values['goal.nominal_speed'],
        follow=follow_of(values),
        control_period=values['control_period'],
        command_delay=values['command_delay'],
        max_command_delay=values['max_command_delay'],
        delay_tolerance=values['command_delay_tolerance'],
        max_slip=values['max_wheel_slip'],
        max_lag=values['max_wheel_lag'],
        obstacles=obstacles_of(values),
        moving_obstacles=MovingObstacles(**fields_of(MovingObstacles, values, 'moving_obstacles.')),
        sight=sight_of(values),
        robot_radius=radius,
        footprint=footprint,
        weights=Weights(**fields_of(Weights, values, 'weights.')),
        solver=SolverSettings(**fields_of(SolverSettings, values, 'solver.')),
        initial_guess=InitialGuess(**fields_of(InitialGuess, values, 'initial_guess.')),
        safety=Safety(**fields_of(Safety, values, 'safety.')),
        frame_id=values['frame_id'],
        odom_timeout=values['odom_timeout'],
        failure_tolerance=values['failure_tolerance'],
        start_tolerance=values['start.tolerance'],
        start_pose=tuple(values['start.pose']) or None,
    )


def plant_settings(values: Values) -> PlantSettings:
    """Settings of the simulated robot.

    Raises:
        ParameterError: If the times at which odometry is lost are no pairs in order, or slip is
            asked of a robot whose tyres slip by themselves.
    """
    return PlantSettings(
        robot=robot_of(values),
        odometry=OdometryErrors(
            **fields_of(OdometryErrors, values, 'noise.'), dropout_windows=_dropout_windows(values)
        ),
        physics=_physics(values),
        **fields_of(PlantSettings, values),
    )


def check_start(values: Values) -> None:
    """Refuses a start from which there is no lawful first step.

    Raises:
        ParameterError: If the footprint or an obstacle cannot be made, or the initial pose is off
            the road or in an obstacle.
    """
    _raise_if_any([*footprint_problems(values), *obstacle_problems(values)])
    x, y, heading = values['initial_pose']
    _raise_if_any(list(place_problems(values, 'initial_pose', (x, y), heading)))


def check_pace(values: Values) -> None:
    """Refuses a simulation whose times do not fit together.

    Raises:
        ParameterError: If odometry or simulated time are too slow or too fast to be kept, or
            lockstep cannot work.
    """
    problems = []
    rate, factor = values['odom_rate'], values['real_time_factor']
    if rate < 1e-3:
        problems.append(Problem('odom_rate', f'{rate} Hz', 'at least 0.001 Hz'))
    elif values['odom_jitter'] >= 1.0 / rate:
        wanted = f'less than the odometry period of {1.0 / rate:.9g} s'
        problems.append(Problem('odom_jitter', f'{values["odom_jitter"]} s', wanted))
    elif values['lockstep'] and not _meets_control_instants(values):
        found = f'{values["control_period"]} s and {rate} Hz'
        wanted = (
            'a whole number of odometry periods in a control period, or an odometry period with '
            'odom_jitter in half of one, for lockstep'
        )
        problems.append(Problem('control_period, odom_rate', found, wanted))
    if values['lockstep'] and values['odom_timeout'] <= values['control_period']:
        # Its odometry comes in bursts of one control period.
        wanted = f'more than control_period = {values["control_period"]} s, for lockstep'
        problems.append(Problem('odom_timeout', f'{values["odom_timeout"]} s', wanted))
    for name in values['waypoints.names'] if values['lockstep'] else []:
        time = values[f'waypoints.{name}.time']
        if _whole(time) % _whole(values['control_period']):
            wanted = f'a multiple of control_period = {values["control_period"]} s, for lockstep'
            problems.append(Problem(f'waypoints.{name}.time', f'{time} s', wanted))
    longest = max((end - begin for begin, end in _dropout_windows(values)), default=0.0)
    bridged = values['odom_timeout'] - values['control_period']
    if values['lockstep'] and longest > bridged:
        # The guidance would stop by its clock then, which does not wait for the simulator.
        wanted = f'at most odom_timeout - control_period = {bridged:.9g} s, for lockstep'
        found = f'a window of {longest:.9g} s'
        problems.append(Problem('noise.dropout_windows', found, wanted))
    if not 1e-3 <= factor <= 1e3:
        problems.append(Problem('real_time_factor', f'{factor}', 'from 0.001 to 1000'))
    _raise_if_any(problems)


def _meets_control_instants(values: Values) -> bool:
    """Whether guidance and simulator agree on which odometry a control step falls due at."""
    period, jitter = _whole(1.0 / values['odom_rate']), _whole(values['odom_jitter'])
    control = _whole(values['control_period'])
    return 2 * (period + jitter) <= control or (not jitter and not control % period)


def _dropout_windows(values: Values) -> tuple[tuple[float, float], ...]:
    times = values['noise.dropout_windows']
    if len(times) % 2 or any(begin >= end for begin, end in pairwise(times)):
        wanted = 'pairs of times, each later than the one before'
        raise ParameterError(Problem('noise.dropout_windows', describe(times), wanted))
    return tuple(zip(times[::2], times[1::2], strict=True))


def _physics(values: Values) -> Physics | None:
    if values['plant'] != 'mujoco':
        return None
    _raise_if_any(
        [
            Problem(
                key, describe(values[key]), 'no slip: with plant mujoco it is friction that decides'
            )
            for key in ('wheel_slip', 'wheel_slip_stddev')
            if np.any(values[key])
        ]
    )
    return Physics(**fields_of(Physics, values, 'physics.'))


def _whole(seconds: float) -> int:
    return round(seconds * 1_000_000_000)


def _size_problems(values: Values) -> Iterator[Problem]:
    """Numbers that no robot has, and that floats cannot calculate with."""
    for key, value in values.items():
        numbers = [each for each in _as_list(value) if isinstance(each, float)]
        if any(abs(number) > _LARGEST for number in numbers):
            yield Problem(key, describe(value), f'no number beyond {_LARGEST:.0e}')
    for key in _DIVISORS:
        if values[key] < _SMALLEST:
            yield Problem(key, describe(values[key]), f'{_SMALLEST:.0e} or more')
    if 0.0 < values['robot.max_wheel_speed'] < _SMALLEST:
        found = f'{values["robot.max_wheel_speed"]} rad/s'
        yield Problem('robot.max_wheel_speed', found, f'{_SMALLEST:.0e} rad/s or more, or 0')


def _as_list(value: Any) -> list[Any]:
    return value if isinstance(value, list) else [value]


def _time_problems(values: Values) -> Iterator[Problem]:
    final_time, period = values['final_time'], values['control_period']
    if values['follow.speed'] and final_time == 0.0:
        return
    if final_time < period:
        yield Problem('final_time', f'{final_time} s', f'at least control_period = {period} s')
    elif final_time < period + values['command_delay']:
        wanted = f'at most final_time - control_period = {final_time - period:.9g} s'
        yield Problem('command_delay', f'{values["command_delay"]} s', wanted)
    if final_time > _MOST_STEPS * period:
        wanted = f'at most {_MOST_STEPS} times control_period = {period} s'
        yield Problem('final_time', f'{final_time} s', wanted)


def _solver_problems(values: Values) -> Iterator[Problem]:
    name = values['solver.qp']
    try:
        backend(name)
    except ProblemError:
        yield Problem('solver.qp', repr(name), f'one of {", ".join(available())}')


def _others_problems(values: Values) -> Iterator[Problem]:
    for each in values['others.namespaces']:
        if not _NAMESPACE.fullmatch(each):
            wanted = 'namespaces of robots, as in /r1: letters, digits and _ after each /'
            yield Problem('others.namespaces', describe(each), wanted)


def _raise_if_any(problems: list[Problem]) -> None:
    if problems:
        raise ParameterError(*problems)
