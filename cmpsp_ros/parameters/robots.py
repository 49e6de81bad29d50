"""The robot from parameters: its model with limits, and its footprint."""

import ast
import math
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import lru_cache
from itertools import combinations
from typing import Any, Final

import numpy as np

from cmpsp_ros import robots
from cmpsp_ros.arrays import Array
from cmpsp_ros.parameters.errors import ParameterError, Problem, describe
from cmpsp_ros.parameters.table import Values

FOOTPRINT: Final = 'robot.footprint'
_LATERAL: Final = 'robot.max_lateral_acceleration'
_ACCELERATION: Final = 'robot.max_wheel_acceleration'
_JERK: Final = 'robot.max_wheel_jerk'
_CORNERS: Final = 'corners around the robot, [[x1, y1], [x2, y2], [x3, y3], ...]'
_UNREADABLE: Final = (SyntaxError, ValueError, MemoryError, RecursionError)
_ROUNDING: Final = 1e-9
_FEWEST_WHEELS: Final = 3
_SINGULAR: Final = 1e-6


def robot_of(values: Values) -> robots.Robot:
    """The robot, of the model that `robot.model` names, or ParameterError."""
    model = values['robot.model']
    if model in MODELS:
        return MODELS[model](values)
    try:
        robot = robots.custom_robot(model, values)
    except robots.ModelError as error:
        raise ParameterError(Problem('robot.model', *error.args)) from error
    return replace(robot, max_lateral_acceleration=values[_LATERAL] or math.inf)


def robot_problems(values: Values, robot: robots.Robot) -> Iterator[Problem]:
    """Parameters that a robot lacks or cannot follow."""
    model, names = values['robot.model'], values['robot.joint_names']
    counts = {
        'differential_drive': 2,
        'mecanum': 4,
        'omni_wheels': len(values['robot.wheel_bearings']),
        'ackermann': 1,
    }
    wheels = counts.get(model, robot.n_controls)
    if len(names) != wheels:
        yield Problem('robot.joint_names', describe(names), f'{wheels} names, one a wheel')
    if model == 'mecanum' and values['robot.half_wheel_base'] == 0.0:
        yield Problem('robot.half_wheel_base', '0.0 m', 'a distance above 0 for a mecanum robot')
    for key in (_JERK, 'robot.max_steering_rate') if values[_ACCELERATION] == 0.0 else ():
        if values[key]:
            yield Problem(_ACCELERATION, describe(0.0), f'above 0 where {key} is')
    if values[_JERK] and model not in {'differential_drive', 'ackermann'}:
        wanted = f'0 for robot.model {model}: differential_drive and ackermann have the limit'
        yield Problem(_JERK, describe(values[_JERK]), wanted)
    if model == 'ackermann':
        yield from _car_problems(values)
    if model == 'differential_drive':
        return
    if values['initial_guess.type'] == 'constant':
        wanted = f'road, for the wheel speeds of constant are not those of robot.model {model}'
        yield Problem('initial_guess.type', "'constant'", wanted)
    if values['plant'] == 'mujoco':
        yield Problem('plant', "'mujoco'", f'kinematic for robot.model {model}')


def _car_problems(values: Values) -> Iterator[Problem]:
    for key in ('robot.wheel_base', 'robot.max_steering_angle'):
        if values[key] < _SINGULAR:
            yield Problem(key, describe(values[key]), f'{_SINGULAR:.0e} or more for a car')
    if values['goal.hold']:
        yield Problem('goal.hold', 'true', 'false for a car: it cannot turn where it stands')


def _on_omni_wheels(values: Values) -> robots.Robot:
    bearings = values['robot.wheel_bearings']
    rows = [(-math.sin(each), math.cos(each), 1.0) for each in bearings]
    if len(rows) < _FEWEST_WHEELS or np.linalg.svd(rows, compute_uv=False)[-1] < _SINGULAR:
        wanted = 'three or more directions, of which three differ'
        raise ParameterError(Problem('robot.wheel_bearings', describe(bearings), wanted))
    return robots.Omnidirectional.on_omni_wheels(
        values['robot.half_track'], bearings, **_wheels(values)
    )


def _wheels(values: Values) -> dict[str, float]:
    return {
        'wheel_radius': values['robot.wheel_radius'],
        'max_wheel_speed': values['robot.max_wheel_speed'] or math.inf,
        'max_wheel_acceleration': values[_ACCELERATION] or math.inf,
        'max_wheel_jerk': values[_JERK] or math.inf,
        'max_lateral_acceleration': values[_LATERAL] or math.inf,
    }


MODELS: Final[dict[str, Callable[[Values], robots.Robot]]] = {
    'differential_drive': lambda values: robots.DifferentialDrive(
        half_track=values['robot.half_track'], **_wheels(values)
    ),
    'mecanum': lambda values: robots.Omnidirectional.mecanum(
        values['robot.half_track'], values['robot.half_wheel_base'], **_wheels(values)
    ),
    'omni_wheels': _on_omni_wheels,
    'ackermann': lambda values: robots.Ackermann(
        wheel_base=values['robot.wheel_base'],
        max_steering_angle=values['robot.max_steering_angle'],
        max_steering_rate=values['robot.max_steering_rate'] or math.inf,
        **_wheels(values),
    ),
}
"""Makers of the robots that `robot.model` names."""


def footprint_of(values: Values) -> tuple[robots.Footprint, float]:
    """The footprint and the radius of its discs [m]; ParameterError for a polygon that is none."""
    text, excess = values[FOOTPRINT], values['robot.footprint_excess']
    return _covered(text, excess) if text else (robots.Footprint(), values['robot.radius'])


@lru_cache(maxsize=16)
def _covered(text: str, excess: float) -> tuple[robots.Footprint, float]:
    corners = _read(text)
    if problem := _why_no_polygon(np.array(corners)):
        raise ParameterError(Problem(FOOTPRINT, problem, _CORNERS))
    try:
        return robots.covered(corners, excess)
    except ValueError as error:
        found = f'{excess:g} m, which takes too many discs'
        raise ParameterError(Problem('robot.footprint_excess', found, str(error))) from error


def _read(text: str) -> list[tuple[float, float]]:
    """Three or more corners, from text as Nav2 writes it."""
    try:
        corners: Any = ast.literal_eval(text)
    except _UNREADABLE:
        raise ParameterError(Problem(FOOTPRINT, describe(text), _CORNERS)) from None
    if not isinstance(corners, list) or not all(map(_is_pair, corners)):
        raise ParameterError(Problem(FOOTPRINT, describe(text), _CORNERS))
    if len(corners) < 3:
        raise ParameterError(Problem(FOOTPRINT, f'{len(corners)} corners', 'three or more'))
    return [(float(x), float(y)) for x, y in corners]


def _is_pair(corner: object) -> bool:
    if not isinstance(corner, list | tuple) or len(corner) != 2:
        return False
    try:
        return all(type(each) in (int, float) and math.isfinite(each) for each in corner)
    except OverflowError:
        return False


def _why_no_polygon(corners: Array) -> str:
    """Reason why corners are no polygon around the origin; empty for one that is."""
    count, after = len(corners), np.roll(corners, -1, axis=0)
    for i in range(count):
        if math.dist(corners[i], after[i]) < _ROUNDING:
            return f'corner {(i + 1) % count} (from 0) at the place of the one before'
    for i, j in combinations(range(count), 2):
        is_neighbour = 1 in (j - i, (i - j) % count)
        if _meet(corners[i], after[i], corners[j], after[j], is_neighbour=is_neighbour):
            return f'sides that cross, from corners {i} and {j} (from 0)'
    if not robots.contains(corners, np.zeros(2)):
        return 'corners that do not go around [0, 0], where odometry is of'
    return ''


def _meet(a: Array, b: Array, c: Array, d: Array, *, is_neighbour: bool) -> bool:
    """True if two sides have a point in common; neighbours one beside their common corner."""
    one, two = _side(a, b, c), _side(a, b, d)
    three, four = _side(c, d, a), _side(c, d, b)
    if is_neighbour:
        # Only where one leads back along the other.
        return one == two == 0.0 and float((b - a) @ (d - c)) < 0.0
    if one == two == 0.0:
        along = b - a
        low, high = sorted((float((c - a) @ along), float((d - a) @ along)))
        return low <= float(along @ along) and high >= 0.0
    return one * two <= 0.0 and three * four <= 0.0


def _side(a: Array, b: Array, point: Array) -> float:
    (x, y), (out_x, out_y) = b - a, point - a
    return float(x * out_y - y * out_x)
