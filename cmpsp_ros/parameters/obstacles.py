"""Obstacles and the map from parameters."""

from __future__ import annotations

import base64
import binascii
import re
import zlib
from collections.abc import Callable, Iterator
from functools import lru_cache, partial
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from cmpsp_ros import guidance
from cmpsp_ros.parameters.errors import ParameterError, Problem, Problems, describe
from cmpsp_ros.parameters.parameter import ParameterType
from cmpsp_ros.parameters.table import Values
from cmpsp_ros.setting import NOT_NEGATIVE, POSITIVE, Range
from cmpsp_ros.world import obstacles

if TYPE_CHECKING:
    from cmpsp_ros.parameters.parameter import Group, Parameter
    from cmpsp_ros.world.grids import Cells, GridObstacle
    from cmpsp_ros.world.obstacles import Point, Shape

_BOOL, _DOUBLE = ParameterType.BOOL, ParameterType.DOUBLE
_STRING, _DOUBLES = ParameterType.STRING, ParameterType.DOUBLE_ARRAY
_FIXED: Final = {'reconfigurable': False}

_INTEGER: Final = ParameterType.INTEGER


NO_MAP: Final = 'none'
"""Cells of no map."""

HIDDEN: Final = 'sim.obstacles'
"""Section of the obstacles that only the simulator knows."""

_CELLS: Final = re.compile(r'(\d{1,9}) x (\d{1,9}) ([A-Za-z0-9+/=]+)', re.ASCII)
_WANTED: Final = 'what map.file makes of a map, or none'


class _Kind(NamedTuple):
    """A type of obstacle: keys of its points, whether it has a radius, and its maker."""

    points: tuple[str, ...]
    has_radius: bool
    make: Callable[[str, list[list[Point]], float], Shape]


_KINDS: Final = {
    'circle': _Kind(
        ('center',), True, lambda name, points, r: obstacles.Obstacle(name, points[0][0], r)
    ),
    'capsule': _Kind(
        ('start', 'end'),
        True,
        lambda name, points, r: obstacles.Capsule(name, points[0][0], points[1][0], r),
    ),
    'polygon': _Kind(
        ('vertices',), False, lambda name, points, _: obstacles.convex(name, points[0])
    ),
}


# fmt: off
def shape_parameters(group: Group, section: str) -> Iterator[Parameter]:
    """Rows of the table for the block of an obstacle."""
    block = f'{section}.<name>'
    yield group(f'{block}.type', _STRING, 'circle', '',
        'Shape of this obstacle: a `capsule` is the region around a line segment, a `polygon` is '
        'convex.', choices=tuple(_KINDS))
    yield group(f'{block}.center', _DOUBLES, [], 'm', 'Centre of this `circle` (x, y).')
    yield group(f'{block}.start', _DOUBLES, [], 'm',
        'One end of the line segment of this `capsule` (x, y).')
    yield group(f'{block}.end', _DOUBLES, [], 'm', 'Other end of the line segment (x, y).')
    yield group(f'{block}.vertices', _DOUBLES, [], 'm',
        'Corners of this `polygon`, in order, in either direction: x and y of each.')
    yield group(f'{block}.radius', _DOUBLE, 0.0, 'm',
        'Radius of this `circle` or `capsule`; must be above 0 for these.', range=NOT_NEGATIVE)


def map_parameters(place: Group) -> Iterator[Parameter]:
    """Rows of the table for the map."""
    yield place('map.cells', _STRING, 'none', '',
        'Cells of an occupancy grid (rows, columns, compressed values); all occupied cells form '
        'one obstacle. `map.file` reads them from a file of map_server, `map.topic` from messages.')
    yield place('map.origin', _DOUBLES, [0.0, 0.0, 0.0], 'm, m, rad',
        'Pose of the outer corner of its first cell (x, y, yaw).', length=3)
    yield place('map.resolution', _DOUBLE, 0.05, 'm', 'Side length of its cells.',
        range=POSITIVE)
    yield place('map.unknown_is_free', _BOOL, False, '',
        'Whether unknown cells, and everything beyond the grid, are free; otherwise they are '
        'occupied.',
        **_FIXED)
    only_guidance = {'nodes': ('guidance',), **_FIXED}
    yield place('map.topic', _STRING, '', '',
        'Topic of a map or a live costmap; the guidance node waits for the first message, and each '
        'replaces the map. Empty: none.', **only_guidance)
    yield place('map.lethal', _INTEGER, 65, '',
        'Value from which on a cell in a message is occupied.', range=Range(1, 100),
        **only_guidance)
    yield place('map.timeout', _DOUBLE, 0.0, 's',
        'Age of the last message at which a live costmap counts as lost and the robot is stopped; '
        '0: a map may be of any age.', range=NOT_NEGATIVE, **only_guidance)
# fmt: on


def obstacles_of(values: Values) -> tuple[Shape, ...]:
    """The static obstacles, including the map.

    Raises:
        ParameterError: A block lacks a value that its type needs, or has one of another type, its
            vertices are not a convex polygon, or the map is invalid; names the key and the vertex.
            With all problems of all obstacles.
    """
    problems = Problems()
    shapes = problems.attempt(lambda: shapes_of(values, 'obstacles'))
    has_map = values['map.cells'] != NO_MAP or values['map.topic']
    if guidance.MAP in values['obstacles.names'] and has_map:
        problems.append(
            Problem('obstacles.names', repr(guidance.MAP), 'another name: it is that of the map')
        )
    known = problems.attempt(lambda: map_of(values))
    problems.check()
    return (*(shapes or ()), *(() if known is None else (known,)))


def shapes_of(values: Values, section: str = HIDDEN) -> tuple[Shape, ...]:
    """The shapes of a section, by default of those that only the simulator knows.

    Raises:
        ParameterError: As from `obstacles_of`.
    """
    problems = Problems()
    prefixes = [f'{section}.{name}' for name in values[f'{section}.names']]
    shapes = [problems.attempt(partial(_shape, values, prefix)) for prefix in prefixes]
    problems.check()
    return tuple(each for each in shapes if each is not None)


def map_of(values: Values) -> GridObstacle | None:
    """The occupied cells of the map, if there is one; the same object for the same map.

    Raises:
        ParameterError: It is no map, or nothing is free in it.
    """
    if values['map.cells'] == NO_MAP:
        return None
    x, y, yaw = values['map.origin']
    found = (x, y, yaw), values['map.resolution'], values['map.cells']
    return _map_of(*found, values['map.unknown_is_free'])


def text_of(cells: Cells) -> str:
    """Cells as text: rows, columns and compressed values."""
    packed = base64.b64encode(zlib.compress(cells.tobytes(), 9)).decode()
    return f'{cells.shape[0]} x {cells.shape[1]} {packed}'


def _shape(values: Values, prefix: str) -> Shape:
    kind, radius = _KINDS[values[f'{prefix}.type']], values[f'{prefix}.radius']
    if problems := list(_block_problems(values, prefix)):
        raise ParameterError(*problems)
    numbers = [values[f'{prefix}.{key}'] for key in kind.points]
    points = [list(zip(each[::2], each[1::2], strict=True)) for each in numbers]
    try:
        return kind.make(prefix.rpartition('.')[2], points, radius)
    except obstacles.ShapeError as error:
        found = f'at vertex {error.vertex} (from 0) {error.found}'
        raise ParameterError(Problem(f'{prefix}.vertices', found, error.wanted)) from error


def _block_problems(values: Values, prefix: str) -> Iterator[Problem]:
    """Values that a block lacks for its type, or has too many."""
    kind = values[f'{prefix}.type']
    for each, (keys, *_) in _KINDS.items():
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
    if radius != 0.0 and not _KINDS[kind].has_radius:
        yield Problem(where, describe(radius), f'nothing for a {kind}')
    elif radius == 0.0 and _KINDS[kind].has_radius:
        yield Problem(where, 'nothing, or 0', 'a number > 0 [m]')


# It takes much longer than all other parameters, which are read again at every live change.
@lru_cache(maxsize=4)
def _map_of(
    origin: tuple[float, float, float], resolution: float, text: str, unknown_is_free: bool
) -> GridObstacle:
    from cmpsp_ros.world.grids import GridError, GridObstacle, OccupancyGrid  # noqa: PLC0415 (numba)

    try:
        grid = OccupancyGrid(origin, resolution, _cells_of(text))
        found = GridObstacle(guidance.MAP, grid, unknown_is_free)
        found.check_space()
    except GridError as error:
        raise ParameterError(Problem(f'map.{error.where}', error.found, error.wanted)) from error
    return found


def _cells_of(text: str) -> Cells:
    from cmpsp_ros.world.grids import GridError, check_size  # noqa: PLC0415 (loads numba)

    form = _CELLS.fullmatch(text)
    if form is None:
        raise GridError('cells', describe(text), _WANTED)
    shape = int(form[1]), int(form[2])
    check_size(shape)
    try:
        stream = zlib.decompressobj()
        size = shape[0] * shape[1]
        unpacked = stream.decompress(base64.b64decode(form[3], validate=True), size + 1)
    except (binascii.Error, zlib.error) as error:
        raise GridError('cells', f'no packed cells ({error})', _WANTED) from error
    if len(unpacked) != size or not stream.eof:
        raise GridError('cells', f'{len(unpacked)} cells', f'{size} of them')
    return np.frombuffer(unpacked, np.uint8).reshape(shape)
