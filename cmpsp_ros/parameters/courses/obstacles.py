"""Obstacles from parameters, and their checks."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Final

import numpy as np

from cmpsp_ros.guidance import MAP
from cmpsp_ros.guidance.formulation import N_EDGE_CONSTRAINTS
from cmpsp_ros.parameters.courses.maps import NONE, map_of
from cmpsp_ros.parameters.errors import ParameterError, Problem, describe
from cmpsp_ros.parameters.table import Values
from cmpsp_ros.world import FreeSpace
from cmpsp_ros.world.obstacles import Capsule, Obstacle, Point, Shape, ShapeError, convex
from cmpsp_ros.world.roads import OpenFloor

_POINTS: Final = {'circle': ('center',), 'capsule': ('start', 'end'), 'polygon': ('vertices',)}
"""What says where an obstacle of each type is."""


def obstacles_of(values: Values) -> tuple[Shape, ...]:
    """The static obstacles, including the map.

    Args:
        values: A set resolved by the table.

    Raises:
        ParameterError: A block lacks a value that its type needs, or has one of another type, its
            vertices are not a convex polygon, or the map is invalid; names the key and the vertex.
    """
    known = map_of(values)
    return shapes_of(values, 'obstacles') + (() if known is None else (known,))


def shapes_of(values: Values, where: str) -> tuple[Shape, ...]:
    """The shapes of a section, such as `obstacles`; arguments and errors as of `obstacles_of`."""
    return tuple(_obstacle(values, f'{where}.{name}') for name in values[f'{where}.names'])


def obstacle_problems(values: Values) -> Iterator[Problem]:
    """What is wrong with each obstacle, and with the map."""
    yield from shape_problems(values, 'obstacles')
    has_map = values['map.cells'] != NONE or values['map.topic']
    if MAP in values['obstacles.names'] and has_map:
        yield Problem('obstacles.names', repr(MAP), 'another name: it is that of the map')
    try:
        map_of(values)
    except ParameterError as error:
        yield from error.problems


def shape_problems(values: Values, where: str) -> Iterator[Problem]:
    """What is wrong with each shape of a section."""
    for name in values[f'{where}.names']:
        try:
            _obstacle(values, f'{where}.{name}')
        except ParameterError as error:
            yield from error.problems


def in_obstacle_problems(values: Values, key: str, point: Point) -> Iterator[Problem]:
    """Problems if the robot, without its margin, touches an obstacle at a point [m]."""
    try:
        obstacles = obstacles_of(values)
    except ParameterError:
        # A problem of its own.
        return
    radius = values['robot.radius']
    for obstacle in obstacles:
        if len(obstacle.corners) == 1:
            distance, needed = math.dist(point, obstacle.center), obstacle.radius + radius
            found = f'{distance:.9g} m from the centre of obstacle {obstacle.name}'
            wanted = f'{needed:.9g} m or more (obstacles.{obstacle.name}.radius + robot.radius)'
        else:
            space = FreeSpace.of(OpenFloor(), (obstacle,), 0.0)
            distance, needed = (
                float(space.at(np.array([[*point, 0.0]]))[0, N_EDGE_CONSTRAINTS]),
                radius,
            )
            found = f'{distance:.9g} m from obstacle {obstacle.name}'
            wanted = f'{needed:.9g} m or more (robot.radius)'
        if distance < needed:
            yield Problem(key, found, wanted)


def _obstacle(values: Values, prefix: str) -> Shape:
    name = prefix.rpartition('.')[2]
    kind = values[f'{prefix}.type']
    problems = list(_block_problems(values, prefix, kind))
    if problems:
        raise ParameterError(*problems)
    points = [_pairs(values[f'{prefix}.{key}']) for key in _POINTS[kind]]
    if kind == 'circle':
        return Obstacle(name, points[0][0], values[f'{prefix}.radius'])
    if kind == 'capsule':
        return Capsule(name, points[0][0], points[1][0], values[f'{prefix}.radius'])
    try:
        return convex(name, points[0])
    except ShapeError as error:
        found = f'at vertex {error.vertex} (from 0) {error.found}'
        raise ParameterError(Problem(f'{prefix}.vertices', found, error.wanted)) from error


def _block_problems(values: Values, prefix: str, kind: str) -> Iterator[Problem]:
    """What a block lacks for its type, or has too much."""
    for each, keys in _POINTS.items():
        for key in keys:
            numbers, where = values[f'{prefix}.{key}'], f'{prefix}.{key}'
            if each != kind:
                if numbers:
                    yield Problem(where, describe(numbers), f'nothing for a {kind}')
            elif kind == 'polygon':
                if len(numbers) % 2 or not numbers:
                    found = describe(numbers or None)
                    yield Problem(where, found, 'x and y [m] of each vertex')
            elif len(numbers) != 2:
                yield Problem(where, describe(numbers or None), 'a list of 2 numbers [m]')
    radius, where = values[f'{prefix}.radius'], f'{prefix}.radius'
    if kind == 'polygon' and radius != 0.0:
        yield Problem(where, describe(radius), 'nothing for a polygon')
    elif kind != 'polygon' and radius == 0.0:
        yield Problem(where, 'nothing, or 0', 'a number > 0 [m]')


def _pairs(numbers: list[float]) -> list[Point]:
    return list(zip(numbers[::2], numbers[1::2], strict=True))
