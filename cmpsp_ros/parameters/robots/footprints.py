"""The robot's footprint from parameters, its checks, and places where it may be."""

from __future__ import annotations

import ast
import math
from collections.abc import Iterator
from functools import lru_cache
from itertools import combinations
from typing import Any, Final

import numpy as np

from cmpsp_ros.arrays import Array
from cmpsp_ros.parameters.errors import ParameterError, Problem, describe
from cmpsp_ros.parameters.table import Values
from cmpsp_ros.robots import Footprint, Point, contains, covered

KEY: Final = 'robot.footprint'

_WANTED: Final = 'corners around the robot, [[x1, y1], [x2, y2], [x3, y3], ...]'
_ROUNDING: Final = 1e-9
_UNREADABLE: Final = (SyntaxError, ValueError, MemoryError, RecursionError)


def footprint_of(values: Values) -> tuple[Footprint, float]:
    """The footprint, and the radius of each disc that covers it [m].

    Raises:
        ParameterError: It is no polygon around the robot's reference point.
    """
    text = values[KEY]
    return _covered(text) if text else (Footprint(), values['robot.radius'])


def footprint_problems(values: Values) -> Iterator[Problem]:
    """What is wrong with the footprint."""
    try:
        footprint_of(values)
    except ParameterError as error:
        yield from error.problems


def radius_name(values: Values) -> str:
    """What messages call the radius of the discs."""
    return 'robot.radius' if not values[KEY] else f'the radius of the discs of {KEY}'


@lru_cache(maxsize=16)
def _covered(text: str) -> tuple[Footprint, float]:
    corners = _read(text)
    if problem := _why_no_polygon(np.array(corners)):
        raise ParameterError(Problem(KEY, problem, _WANTED))
    return covered(corners)


def _read(text: str) -> list[Point]:
    """Corners of a text as Nav2 has it.

    Raises:
        ParameterError: It is no list of three or more pairs of finite numbers.
    """
    try:
        corners: Any = ast.literal_eval(text)
    except _UNREADABLE:
        raise ParameterError(Problem(KEY, describe(text), _WANTED)) from None
    if not isinstance(corners, list) or not all(map(_is_pair, corners)):
        raise ParameterError(Problem(KEY, describe(text), _WANTED))
    if len(corners) < 3:
        raise ParameterError(Problem(KEY, f'{len(corners)} corners', 'three or more'))
    return [(float(x), float(y)) for x, y in corners]


def _is_pair(corner: object) -> bool:
    if not isinstance(corner, list | tuple) or len(corner) != 2:
        return False
    try:
        return all(type(each) in (int, float) and math.isfinite(each) for each in corner)
    except OverflowError:
        return False


def _why_no_polygon(corners: Array) -> str:
    """What keeps corners from being a polygon around the origin; empty where nothing does."""
    count, after = len(corners), np.roll(corners, -1, axis=0)
    for i in range(count):
        if math.dist(corners[i], after[i]) < _ROUNDING:
            return f'corner {(i + 1) % count} (from 0) at the place of the one before'
    for i, j in combinations(range(count), 2):
        is_neighbour = 1 in (j - i, (i - j) % count)
        if _meet(corners[i], after[i], corners[j], after[j], is_neighbour=is_neighbour):
            return f'sides that cross, from corners {i} and {j} (from 0)'
    if not contains(corners, np.zeros(2)):
        return 'corners that do not go around [0, 0], where odometry is of'
    return ''


def _meet(a: Array, b: Array, c: Array, d: Array, *, is_neighbour: bool) -> bool:
    """Whether two sides have a point in common; neighbours one beside their common corner."""
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
