"""The road as the parameters describe it, and what is wrong with it or with a place on it."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from cmpsp_ros.parameters.errors import ParameterError, Problem, describe
from cmpsp_ros.parameters.table import Values
from cmpsp_ros.world.free_space import FreeSpace
from cmpsp_ros.world.roads.corridor import Corridor, RoadError
from cmpsp_ros.world.roads.road import Annulus, OpenFloor, Road

_ROUNDING = 1e-9


def lacks_road(values: Values) -> bool:
    """Whether the road is still to come, on the topic `road`."""
    return values['road.source'] == 'topic' and not values['road.points']


def road_of(values: Values) -> Road:
    """The road.

    Returns:
        The road. Where it is still to come one stands in for it, which is driven on by nobody: code
        can be compiled for its kind.

    Raises:
        ParameterError: A corridor's lists do not fit together, or its points make no road; names
            the point.
    """
    if values['road.type'] == 'none':
        return OpenFloor()
    if values['road.type'] == 'corridor':
        return _stand_in(values) if lacks_road(values) else _corridor(values)
    center = tuple(values['road.center'])
    return Annulus(center, values['road.inner_radius'], values['road.outer_radius'])


def road_keys(values: Values) -> tuple[str, ...]:
    """Parameters without which nothing can be said about the road of that type."""
    if values['road.type'] == 'none':
        return ('road.type',)
    if values['road.type'] == 'corridor':
        return ('road.type', 'road.points')
    return ('road.center', 'road.inner_radius', 'road.outer_radius')


def road_problems(values: Values) -> Iterator[Problem]:
    """What makes a road that the robot cannot be on."""
    kind = values['road.type']
    if values['road.source'] == 'topic' and kind != 'corridor':
        yield Problem('road.source', 'topic', f'parameters with road.type {kind}')
    if lacks_road(values):
        return
    try:
        road = road_of(values)
    except ParameterError as error:
        yield from error.problems
        return
    needed = values['robot.radius'] + values['safety.margin']
    wanted = f'more than robot.radius + safety.margin = {needed:.9g} m'
    if isinstance(road, Corridor):
        for key, widths in (('left', road.left), ('right', road.right)):
            narrowest = int(np.argmin(widths))
            if widths[narrowest] <= needed:
                found = f'{widths[narrowest]:.9g} m to the {key} of point {narrowest}'
                yield Problem('road.half_width', found, wanted)
    elif isinstance(road, Annulus):
        if road.width <= 0.0:
            less = f'less than road.outer_radius = {road.outer_radius} m'
            yield Problem('road.inner_radius', f'{road.inner_radius} m', less)
        elif road.width / 2.0 <= needed:
            where = 'road.inner_radius, road.outer_radius'
            yield Problem(where, f'a road of half width {road.width / 2.0:.9g} m', wanted)


def off_road_problems(values: Values, key: str, point: tuple[float, float]) -> Iterator[Problem]:
    """What of the road forbids the robot, without its margin, to stand at a point [m]."""
    if lacks_road(values):
        return
    try:
        road = road_of(values)
    except ParameterError:
        # A problem of its own.
        return
    radius = values['robot.radius']
    if isinstance(road, Annulus):
        low, high = road.inner_radius + radius, road.outer_radius - radius
        distance = math.dist(point, road.center)
        # A road that leaves no room is a problem of its own.
        if low < high and not low <= distance <= high:
            wanted = f'{low:.9g} to {high:.9g} m (road.inner_radius + robot.radius to '
            wanted += 'road.outer_radius - robot.radius)'
            yield Problem(key, f'{distance:.9g} m from road.center', wanted)
    elif isinstance(road, Corridor):
        clearance = FreeSpace.of(road, (), radius).at(np.array([[*point, math.nan]]))[0]
        nearest = int(np.argmin(clearance))
        if clearance[nearest] < -_ROUNDING:
            found = f'{-clearance[nearest]:.9g} m beyond {road.edge_names[nearest]}'
            yield Problem(key, found, 'a point on the road, robot.radius away from its edges')
        elif road.beyond(point) > _ROUNDING:
            found = f'{road.beyond(point):.9g} m beyond the end of the road'
            yield Problem(key, found, 'a point between its first and its last point')


def _stand_in(values: Values) -> Corridor:
    """A ring with room for the robot."""
    half = 1.0 + values['robot.radius'] + values['safety.margin']
    radius, count = 10.0 * half, 16
    angles = [math.tau * k / count for k in range(count)]
    points = tuple((radius * math.cos(angle), radius * math.sin(angle)) for angle in angles)
    return Corridor(points, (half,) * count, (half,) * count, closed=True)


def _corridor(values: Values) -> Corridor:
    numbers = values['road.points']
    if len(numbers) % 2 or not numbers:
        wanted = 'x and y of each point of the centre line'
        raise ParameterError(Problem('road.points', describe(numbers), wanted))
    points = tuple(zip(numbers[::2], numbers[1::2], strict=True))
    left, right = (_widths(values, side, len(points)) for side in ('left', 'right'))
    try:
        return Corridor(points, left, right, values['road.closed'])
    except RoadError as error:
        found = f'at point {error.point} (from 0) {error.found}'
        raise ParameterError(Problem('road.points', found, error.wanted)) from error


def _widths(values: Values, side: str, count: int) -> tuple[float, ...]:
    """Width to one side at each point; what is said for both sides counts where it says nothing."""
    own = f'road.{side}_width'
    key = own if values[own] else 'road.half_width'
    widths = values[key]
    if len(widths) not in (1, count):
        found = f'{len(widths)} widths'
        raise ParameterError(Problem(key, found, f'one, or one for each of {count} points'))
    return tuple(widths) if len(widths) == count else (widths[0],) * count
