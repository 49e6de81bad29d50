"""The road from parameters, and checks of the road and of points on it."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import Any, Final, NamedTuple

import numpy as np

from cmpsp_ros.parameters.errors import ParameterError, Problem, describe
from cmpsp_ros.parameters.robots.footprints import footprint_of, radius_name
from cmpsp_ros.parameters.table import Values
from cmpsp_ros.world import FreeSpace
from cmpsp_ros.world.roads import Annulus, Corridor, OpenFloor, Road, RoadError

_ROUNDING = 1e-9
_WANTED = 'more than {} + safety.margin = {:.9g} m'


def lacks_road(values: Values) -> bool:
    """Whether the road has not been received yet, on the topic `road`."""
    return values['road.source'] == 'topic' and not values['road.points']


def road_of(values: Values) -> Road:
    """The road.

    Returns:
        The road. Until one is received, a placeholder of the same type, for compiling code; no
        robot drives on it.

    Raises:
        ParameterError: A corridor's lists do not match, or its points are not a road; names the
            point.
    """
    return _KINDS[values['road.type']].make(values)


def known_road(values: Values) -> Road | None:
    """The road; None until it is received, or if it is invalid, which is reported separately."""
    try:
        return None if lacks_road(values) else road_of(values)
    except ParameterError:
        return None


def road_keys(values: Values) -> tuple[str, ...]:
    """Parameters that the checks of a road of that type need."""
    return _KINDS[values['road.type']].keys


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
    _, radius = footprint_of(values)
    needed = radius + values['safety.margin']
    wanted = _WANTED.format(radius_name(values), needed)
    yield from _KINDS[kind].problems(road, needed, wanted)


def off_road_problems(values: Values, key: str, point: tuple[float, float]) -> Iterator[Problem]:
    """Problems if the robot, without its margin, is off the road at a point [m]."""
    road = known_road(values)
    if road is not None:
        yield from _KINDS[values['road.type']].off_road(road, values['robot.radius'], key, point)


def _annulus(values: Values) -> Annulus:
    center = tuple(values['road.center'])
    return Annulus(center, values['road.inner_radius'], values['road.outer_radius'])


def _annulus_problems(road: Annulus, needed: float, wanted: str) -> Iterator[Problem]:
    if road.width <= 0.0:
        less = f'less than road.outer_radius = {road.outer_radius} m'
        yield Problem('road.inner_radius', f'{road.inner_radius} m', less)
    elif road.width / 2.0 <= needed:
        where = 'road.inner_radius, road.outer_radius'
        found = f'a road of half width {road.width / 2.0:.9g} m'
        yield Problem(where, found, wanted)


def _off_annulus(
    road: Annulus, radius: float, key: str, point: tuple[float, float]
) -> Iterator[Problem]:
    low, high = road.inner_radius + radius, road.outer_radius - radius
    distance = math.dist(point, road.center)
    # A road that leaves no room is a problem of its own.
    if low < high and not low <= distance <= high:
        wanted = f'{low:.9g} to {high:.9g} m (road.inner_radius + robot.radius to '
        wanted += 'road.outer_radius - robot.radius)'
        yield Problem(key, f'{distance:.9g} m from road.center', wanted)


def _corridor_problems(road: Corridor, needed: float, wanted: str) -> Iterator[Problem]:
    for key, widths in (('left', road.left), ('right', road.right)):
        narrowest = int(np.argmin(widths))
        if widths[narrowest] <= needed:
            found = f'{widths[narrowest]:.9g} m to the {key} of point {narrowest}'
            yield Problem('road.half_width', found, wanted)


def _off_corridor(
    road: Corridor, radius: float, key: str, point: tuple[float, float]
) -> Iterator[Problem]:
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
    half = 1.0 + footprint_of(values)[1] + values['safety.margin']
    radius, count = 10.0 * half, 16
    angles = [math.tau * k / count for k in range(count)]
    points = tuple((radius * math.cos(angle), radius * math.sin(angle)) for angle in angles)
    return Corridor(points, (half,) * count, (half,) * count, closed=True)


def _corridor(values: Values) -> Corridor:
    if lacks_road(values):
        return _stand_in(values)
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
    """Width to one side at each point; the common width if it is not given for this side."""
    own = f'road.{side}_width'
    key = own if values[own] else 'road.half_width'
    widths = values[key]
    if len(widths) not in (1, count):
        found = f'{len(widths)} widths'
        raise ParameterError(Problem(key, found, f'one, or one for each of {count} points'))
    return tuple(widths) if len(widths) == count else (widths[0],) * count


def _no_problems(*_: Any) -> Iterator[Problem]:
    return iter(())


class _Kind(NamedTuple):
    """How a type of road is made from parameters and checked.

    Attributes:
        make: The road of a set of values.
        keys: Parameters that the checks need.
        problems: Of a road, the clearance needed on either side of its centre line [m], and that in
            words.
        off_road: Of a road, the robot's radius [m], a parameter and its point [m].
    """

    make: Callable[[Values], Road]
    keys: tuple[str, ...]
    problems: Callable[[Any, float, str], Iterator[Problem]]
    off_road: Callable[[Any, float, str, tuple[float, float]], Iterator[Problem]]


_KINDS: Final = {
    'annulus': _Kind(
        _annulus,
        ('road.center', 'road.inner_radius', 'road.outer_radius'),
        _annulus_problems,
        _off_annulus,
    ),
    'corridor': _Kind(_corridor, ('road.type', 'road.points'), _corridor_problems, _off_corridor),
    'none': _Kind(lambda _: OpenFloor(), ('road.type',), _no_problems, _no_problems),
}
"""What `road.type` may be."""
