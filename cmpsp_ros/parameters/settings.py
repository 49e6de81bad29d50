"""Settings of the guidance law and of the simulator, built from a resolved set of parameters."""

import math
import re
from collections.abc import Iterator
from functools import partial
from itertools import pairwise
from typing import Any, Final

import numpy as np

from cmpsp_ros import guidance, simulator
from cmpsp_ros.arrays import Array
from cmpsp_ros.mpsp import ProblemError
from cmpsp_ros.mpsp.qp import available, backend
from cmpsp_ros.parameters.course import (
    Course,
    follow_of,
    follow_problems,
    goal_problems,
    heading_of,
    waypoints_of,
)
from cmpsp_ros.parameters.errors import ParameterError, Problem, Problems, describe
from cmpsp_ros.parameters.obstacles import obstacles_of, shapes_of
from cmpsp_ros.parameters.parameter import build
from cmpsp_ros.parameters.plausibility import millimetres
from cmpsp_ros.parameters.roads import road_of
from cmpsp_ros.parameters.robots import footprint_of, robot_of, robot_problems
from cmpsp_ros.parameters.table import Values
from cmpsp_ros.robots import placed
from cmpsp_ros.sensing import Sensor, SightSettings, TrackSource
from cmpsp_ros.world import FreeSpace
from cmpsp_ros.world.obstacles import Shape
from cmpsp_ros.world.roads import OpenFloor

_MOST_STEPS: Final = 10_000  # control steps whose matrices would not fill the memory
_LARGEST: Final = 1e9
_ROUNDING: Final = 1e-9  # of places [m]
_SMALLEST: Final = 1e-6
_DIVISORS: Final = ('robot.wheel_radius', 'robot.half_track', 'weights.control_change')
"""Divisors of the law, beside a wheel limit that is not 0."""

_NAMESPACE: Final = re.compile(r'(?:/[A-Za-z_]\w*)+', re.ASCII)


def guidance_settings(values: Values) -> guidance.GuidanceSettings:
    """Settings of the guidance law, checked against each other, or ParameterError."""
    problems = Problems(_size_problems(values))
    problems.attempt(partial(footprint_of, values))
    problems.check()
    robot = problems.attempt(partial(robot_of, values))
    if robot is not None:
        problems += robot_problems(values, robot)
    problems += _time_problems(values)
    course = Course.of(values, problems)
    problems += _sensor_problems(values)
    problems += (follow_problems if values['follow.speed'] else goal_problems)(values, course)
    problems += _solver_problems(values)
    problems += _namespace_problems(values)
    if len(pose := values['start.pose']) not in (0, 3):
        problems.append(Problem('start.pose', describe(pose), 'x, y and heading, or none of them'))
    if problems:
        # A robot in millimetres fits on no road: the cause comes first.
        in_metres = 'metres: it looks like millimetres'
        problems[:0] = [Problem(k, describe(values[k]), in_metres) for k in millimetres(values)]
    problems.check()
    assert robot is not None  # noqa: S101 (its absence is a problem)
    sensors = tuple(
        build(Sensor, values, f'sensors.{name}.', name=name) for name in values['sensors.names']
    )
    trackers = tuple(
        build(TrackSource, values, f'trackers.{name}.', name=name)
        for name in values['trackers.names']
    )
    return build(
        guidance.GuidanceSettings,
        values,
        robot=robot,
        road=course.road,
        obstacles=course.obstacles,
        goal=tuple(values['goal.position']),
        goal_heading=heading_of(values, 'goal.heading'),
        final_time=values['final_time'] or math.inf,
        waypoints=waypoints_of(values),
        follow=follow_of(values),
        moving_obstacles=build(
            guidance.MovingObstacles, values, 'moving_obstacles.', trackers=trackers
        ),
        sight=build(SightSettings, values, 'sight.', sensors=sensors),
        robot_radius=course.radius,
        footprint=course.footprint,
        weights=build(guidance.Weights, values, 'weights.'),
        solver=build(guidance.SolverSettings, values, 'solver.'),
        initial_guess=build(guidance.InitialGuess, values, 'initial_guess.'),
        safety=build(guidance.Safety, values, 'safety.'),
        start_pose=tuple(values['start.pose']) or None,
    )


def plant_settings(values: Values) -> simulator.PlantSettings:
    """Settings of the simulated robot; ParameterError for lost odometry or slip that cannot be."""
    windows = _dropout_windows(values)
    return build(
        simulator.PlantSettings,
        values,
        robot=robot_of(values),
        odometry=build(simulator.OdometryErrors, values, 'noise.', dropout_windows=windows),
        physics=_physics(values),
    )


def laser_settings(values: Values) -> simulator.LaserSettings:
    """Settings of the simulated laser scanner; ParameterError for contradictions."""
    problems = Problems(_scan_problems(values))
    problems.attempt(partial(shapes_of, values))
    problems.check()
    return build(simulator.LaserSettings, values, 'sim.scan.', seed=values['noise.seed'])


def scenery(values: Values) -> tuple[tuple[Shape, ...], list[Array]]:
    """Obstacles and lines that the simulated scanner sees; ParameterError if one is invalid."""
    lines = road_of(values).edges() if values['sim.scan.road_edges'] else []
    return obstacles_of(values) + shapes_of(values), lines


def people_settings(values: Values) -> simulator.PeopleSettings:
    """People who walk about in the simulator; ParameterError for waypoints that are no points."""
    problems, walkers = Problems(), []
    for name in values['sim.people.names']:
        prefix = f'sim.people.{name}.'
        place = tuple(values[f'{prefix}position'])
        walkers.append(build(simulator.Walker, values, prefix, name=name, position=place))
        key, given = f'{prefix}waypoints', values[f'{prefix}waypoints']
        if walkers[-1].motion != 'waypoints' and given:
            problems.append(Problem(key, describe(given), f'{prefix}motion: waypoints with them'))
        elif walkers[-1].motion == 'waypoints' and (len(given) % 2 or not given):
            problems.append(Problem(key, describe(given or None), 'x and y [m] of each point'))
    problems.check()
    seed = values['noise.seed']
    return build(simulator.PeopleSettings, values, 'sim.people.', walkers=tuple(walkers), seed=seed)


def check_simulation(values: Values) -> None:
    """ParameterError for a simulation that cannot start, keep pace, or keep lockstep."""
    problems, of_road = Problems(), Problems()
    course = problems.attempt(lambda: Course.of(values, of_road))
    if course is not None:
        problems += [each for each in of_road if not each.where.startswith('road.')]
        x, y, heading = values['initial_pose']
        problems += course.place_problems('initial_pose', (x, y), heading)
    people = problems.attempt(partial(people_settings, values))
    problems.check()
    if people is not None and people.walkers:
        Problems(_crowding_problems(values, people)).check()
    Problems(_pace_problems(values)).check()


def _crowding_problems(values: Values, people: simulator.PeopleSettings) -> Iterator[Problem]:
    """Problems of people who begin inside an obstacle, or a disc that covers the robot."""
    obstacles, _ = scenery(values)
    footprint, radius = footprint_of(values)
    discs = placed(footprint.discs, np.array(values['initial_pose']))
    names = *(f'obstacle {each.name}' for each in obstacles), 'the robot (initial_pose)'
    for each in people.walkers:
        places, wanted = each.places, f'a place where {each.name} has room'
        space = FreeSpace.of(OpenFloor(), obstacles, each.radius)
        clearance = space.at(np.pad(places, ((0, 0), (0, 1))))[:, len(OpenFloor.edge_names) :]
        apart = np.linalg.norm(places[:, None] - discs, axis=2) - radius - each.radius
        least = [*clearance.min(axis=0).tolist(), float(apart.min())]
        for name, away in zip(names, least, strict=True):
            if away < -_ROUNDING:
                found = f'{-away:.3g} m inside {name}'
                yield Problem(f'sim.people.{each.name}.position', found, wanted)


def _pace_problems(values: Values) -> Iterator[Problem]:
    rate, factor = values['odom_rate'], values['real_time_factor']
    if rate < 1e-3:
        yield Problem('odom_rate', f'{rate} Hz', 'at least 0.001 Hz')
    elif values['odom_jitter'] >= 1.0 / rate:
        wanted = f'less than the odometry period of {1.0 / rate:.9g} s'
        yield Problem('odom_jitter', f'{values["odom_jitter"]} s', wanted)
    elif values['lockstep'] and not _meets_control_instants(values):
        found = f'{values["control_period"]} s and {rate} Hz'
        wanted = (
            'a whole number of odometry periods in a control period, or an odometry period with '
            'odom_jitter in half of one, for lockstep'
        )
        yield Problem('control_period, odom_rate', found, wanted)
    if values['lockstep']:
        yield from _lockstep_problems(values)
    if not 1e-3 <= factor <= 1e3:
        yield Problem('real_time_factor', f'{factor}', 'from 0.001 to 1000')


def _lockstep_problems(values: Values) -> Iterator[Problem]:
    period, timeout = values['control_period'], values['odom_timeout']
    if timeout <= period:
        # Its odometry comes in bursts of one control period.
        wanted = f'more than control_period = {period} s, for lockstep'
        yield Problem('odom_timeout', f'{timeout} s', wanted)
    for name in values['waypoints.names']:
        time = values[f'waypoints.{name}.time']
        if _whole(time) % _whole(period):
            wanted = f'a multiple of control_period = {period} s, for lockstep'
            yield Problem(f'waypoints.{name}.time', f'{time} s', wanted)
    longest = max((end - begin for begin, end in _dropout_windows(values)), default=0.0)
    if longest > timeout - period:
        # The guidance would stop by its clock then, which does not wait for the simulator.
        wanted = f'at most odom_timeout - control_period = {timeout - period:.9g} s, for lockstep'
        found = f'a window of {longest:.9g} s'
        yield Problem('noise.dropout_windows', found, wanted)


def _meets_control_instants(values: Values) -> bool:
    """True if guidance and simulator agree on the odometry at which a control step is due."""
    period, jitter = _whole(1.0 / values['odom_rate']), _whole(values['odom_jitter'])
    control = _whole(values['control_period'])
    return 2 * (period + jitter) <= control or (not jitter and not control % period)


def _dropout_windows(values: Values) -> tuple[tuple[float, float], ...]:
    times = values['noise.dropout_windows']
    if len(times) % 2 or any(begin >= end for begin, end in pairwise(times)):
        wanted = 'pairs of times, each later than the one before'
        raise ParameterError(Problem('noise.dropout_windows', describe(times), wanted))
    return tuple(zip(times[::2], times[1::2], strict=True))


def _physics(values: Values) -> simulator.Physics | None:
    if values['plant'] != 'mujoco':
        return None
    wanted = 'no slip: with plant mujoco it is friction that decides'
    slips = [each for each in ('wheel_slip', 'wheel_slip_stddev') if np.any(values[each])]
    Problems(Problem(key, describe(values[key]), wanted) for key in slips).check()
    return build(simulator.Physics, values, 'physics.')


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


def _namespace_problems(values: Values) -> Iterator[Problem]:
    for each in values['others.namespaces']:
        if not _NAMESPACE.fullmatch(each):
            wanted = 'namespaces of robots, as in /r1: letters, digits and _ after each /'
            yield Problem('others.namespaces', describe(each), wanted)


def _scan_problems(values: Values) -> Iterator[Problem]:
    first, last = values['sim.scan.angle_min'], values['sim.scan.angle_max']
    if not first < last <= first + math.tau + 1e-9:
        wanted = f'more than sim.scan.angle_min = {first} rad, by a full turn at most'
        yield Problem('sim.scan.angle_max', f'{last} rad', wanted)
    nearest, farthest = values['sim.scan.range_min'], values['sim.scan.range_max']
    if nearest >= farthest:
        wanted = f'more than sim.scan.range_min = {nearest} m'
        yield Problem('sim.scan.range_max', f'{farthest} m', wanted)
    increment, period = values['sim.scan.time_increment'], 1.0 / values['sim.scan.rate']
    longest = period / (values['sim.scan.count'] - 1)
    if increment > longest * (1.0 + 1e-9):
        wanted = f'at most {longest:.9g} s, for a scan within 1 / sim.scan.rate = {period:.9g} s'
        yield Problem('sim.scan.time_increment', f'{increment} s', wanted)


def _sensor_problems(values: Values) -> Iterator[Problem]:
    for name in values['sensors.names']:
        low, high = values[f'sensors.{name}.heights']
        if low >= high:
            key = f'sensors.{name}.heights'
            yield Problem(key, describe([low, high]), 'the least z before the greatest')
    if values['sensors.names'] and guidance.SEEN in values['obstacles.names']:
        yield Problem(
            'obstacles.names', repr(guidance.SEEN), 'another name: it is that of what is seen'
        )
