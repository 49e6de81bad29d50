"""The road from parameters."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np

from cmpsp_ros.parameters.errors import ParameterError, Problem, describe
from cmpsp_ros.parameters.parameter import Group, Parameter, ParameterType
from cmpsp_ros.parameters.table import Values
from cmpsp_ros.setting import NOT_NEGATIVE, POSITIVE
from cmpsp_ros.world import roads

if TYPE_CHECKING:
    from cmpsp_ros.world.roads import Annulus, Corridor, Road

_BOOL, _INTEGER, _DOUBLE, _STRING, _DOUBLES, _STRINGS = ParameterType
_FIXED: Final = {'reconfigurable': False}


# fmt: off
def road_parameters(place: Group) -> Iterator[Parameter]:
    """Rows of the table, in the order of the documentation."""
    yield place('road.type', _STRING, 'annulus', '',
        'Shape of the road: `annulus` lies between two circles, as in the paper; `corridor` runs '
        'along a line through points; `none` is open floor.',
        choices=tuple(_KINDS), **_FIXED)
    yield place('road.source', _STRING, 'parameters', '',
        'Source of a `corridor`: these parameters, or the topic `road`. With `topic` the guidance '
        'node waits for a message; each message sets `road.points` and `road.closed`. The '
        'simulator publishes their initial values there.',
        choices=('parameters', 'topic'), **_FIXED)
    yield place('road.center', _DOUBLES, [0.0, 0.0], 'm',
        'Centre of an `annulus` (x, y).', length=2)
    yield place('road.inner_radius', _DOUBLE, 9.0, 'm',
        'Radius of the inner edge: `r_i` = 9 m in the paper.', range=NOT_NEGATIVE)
    yield place('road.outer_radius', _DOUBLE, 11.0, 'm',
        'Radius of the outer edge: `r_o` = 11 m in the paper.', range=POSITIVE)
    yield place('road.points', _DOUBLES, [], 'm',
        'Centre line of a `corridor`: x and y of each point, in order. `road.file` reads them '
        'from a file.')
    yield place('road.half_width', _DOUBLES, [1.0], 'm',
        'Distance from the centre line of a `corridor` to either edge: one value, or one for each '
        'point.', range=POSITIVE)
    yield place('road.left_width', _DOUBLES, [], 'm',
        'Distance to the left edge; omit it if `road.half_width` holds.', range=POSITIVE)
    yield place('road.right_width', _DOUBLES, [], 'm',
        'Distance to the right edge; omit it if `road.half_width` holds.', range=POSITIVE)
    yield place('road.closed', _BOOL, False, '',
        'Whether the last point of a `corridor` is joined to its first.')
# fmt: on


def lacks_road(values: Values) -> bool:
    """True if the road has not been received yet, on the topic `road`."""
    return values['road.source'] == 'topic' and not values['road.points']


def road_of(values: Values, kept: float = 0.0) -> Road:
    """Road of a parameter set; before one is received, a ring with room for `kept` [m]."""
    return _placeholder(kept) if lacks_road(values) else _KINDS[values['road.type']].make(values)


def road_problems(values: Values, road: Road, kept: float, wanted: str) -> Iterator[Problem]:
    """Problems of a road that cannot be received, or is not wider than `kept` [m] to each side."""
    kind = values['road.type']
    if values['road.source'] == 'topic' and kind != 'corridor':
        yield Problem('road.source', 'topic', f'parameters with road.type {kind}')
    if not lacks_road(values):
        yield from _KINDS[kind].narrow(road, kept, wanted)


def road_keys(values: Values) -> tuple[str, ...]:
    """Parameters that the checks of a road of that type need."""
    return _KINDS[values['road.type']].keys


def unused_road_keys(values: Values) -> Iterator[str]:
    """Parameters that were changed, but that the road does not use, for it is of another type."""
    used = ('road.type', 'road.source', *_KINDS[values['road.type']].own)
    for each in road_parameters(Group('')):
        if each.name not in used and values[each.name] != each.default:
            yield each.name


def _annulus(values: Values) -> Annulus:
    center = tuple(values['road.center'])
    return roads.Annulus(center, values['road.inner_radius'], values['road.outer_radius'])


def _narrow_annulus(road: Annulus, kept: float, wanted: str) -> Iterator[Problem]:
    if road.width <= 0.0:
        less = f'less than road.outer_radius = {road.outer_radius} m'
        yield Problem('road.inner_radius', f'{road.inner_radius} m', less)
    elif road.width / 2.0 <= kept:
        where = 'road.inner_radius, road.outer_radius'
        yield Problem(where, f'a road of half width {road.width / 2.0:.9g} m', wanted)


def _corridor(values: Values) -> Corridor:
    numbers = values['road.points']
    if len(numbers) % 2 or not numbers:
        wanted = 'x and y of each point of the centre line'
        raise ParameterError(Problem('road.points', describe(numbers), wanted))
    points = tuple(zip(numbers[::2], numbers[1::2], strict=True))
    left, right = (_widths(values, side, len(points)) for side in ('left', 'right'))
    try:
        return roads.Corridor(points, left, right, values['road.closed'])
    except roads.RoadError as error:
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


def _narrow_corridor(road: Corridor, kept: float, wanted: str) -> Iterator[Problem]:
    for key, widths in (('left', road.left), ('right', road.right)):
        narrowest = int(np.argmin(widths))
        if widths[narrowest] <= kept:
            found = f'{widths[narrowest]:.9g} m to the {key} of point {narrowest}'
            yield Problem('road.half_width', found, wanted)


def _placeholder(kept: float) -> Corridor:
    """A ring with room for the robot."""
    half = 1.0 + kept
    radius, count = 10.0 * half, 16
    angles = [math.tau * k / count for k in range(count)]
    points = tuple((radius * math.cos(angle), radius * math.sin(angle)) for angle in angles)
    return roads.Corridor(points, (half,) * count, (half,) * count, closed=True)


class _Kind(NamedTuple):
    """A type of road: its maker, its own parameters, those that its checks need, and problems."""

    make: Callable[[Values], Road]
    own: tuple[str, ...]
    keys: tuple[str, ...]
    narrow: Callable[[Any, float, str], Iterator[Problem]]


_RING: Final = 'road.center', 'road.inner_radius', 'road.outer_radius'
_WIDTHS: Final = 'road.half_width', 'road.left_width', 'road.right_width'
_LINE: Final = 'road.points', 'road.closed', *_WIDTHS

_KINDS: Final = {
    'annulus': _Kind(_annulus, _RING, _RING, _narrow_annulus),
    'corridor': _Kind(_corridor, _LINE, ('road.type', 'road.points'), _narrow_corridor),
    'none': _Kind(lambda _: roads.OpenFloor(), (), ('road.type',), lambda *_: iter(())),
}
"""Types of roads, by their names in `road.type`."""

ROAD_TYPES: Final = tuple(_KINDS)  # values of `road.type`
