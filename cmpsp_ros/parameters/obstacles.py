"""Obstacles and the map from parameters."""

from __future__ import annotations

import base64
import binascii
import re
import zlib
from collections.abc import Iterator
from functools import lru_cache, partial
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from cmpsp_ros import guidance
from cmpsp_ros.parameters.errors import ParameterError, Problem, Problems, describe
from cmpsp_ros.parameters.parameter import Group, Parameter, ParameterType
from cmpsp_ros.parameters.table import Values
from cmpsp_ros.setting import NOT_NEGATIVE, POSITIVE, Range
from cmpsp_ros.world.obstacles import SHAPES, ShapeError

if TYPE_CHECKING:
    from cmpsp_ros.world.grids import Cells, GridObstacle
    from cmpsp_ros.world.obstacles import Shape

_BOOL, _INTEGER, _DOUBLE, _STRING, _DOUBLES, _STRINGS = ParameterType
_FIXED: Final = {'reconfigurable': False}

NO_MAP: Final = 'none'  # cells of no map
HIDDEN: Final = 'sim.obstacles'  # section of the obstacles that only the simulator knows

_CELLS: Final = re.compile(r'(\d{1,9}) x (\d{1,9}) ([A-Za-z0-9+/=]+)', re.ASCII)
_WANTED: Final = 'what map.file makes of a map, or none'


_SETTINGS: Final = {
    each.kind: {setting.name: setting for setting in Group('').of(each)} for each in SHAPES
}
"""Settings of each type of obstacle by name, as that type wants them."""

_BLOCK: Final = {key: each for own in _SETTINGS.values() for key, each in own.items()}
"""Settings of all types by name."""


def shape_parameters(group: Group, section: str) -> Iterator[Parameter]:
    """Rows of the table for the block of an obstacle: any setting of any type may be left out."""
    block, kinds = f'{section}.<name>', tuple(_SETTINGS)
    yield group(f'{block}.type', _STRING, kinds[0], '', 'Shape of this obstacle.', choices=kinds)
    for key, each in _BLOCK.items():
        users = ' or '.join(f'`{kind}`' for kind in kinds if key in _SETTINGS[kind])
        text = f'{each.description} With type {users}.'
        within = Range(min(each.range.low, 0.0), each.range.high)
        yield group(f'{block}.{key}', each.type, each.default, each.unit, text, range=within)


# fmt: off
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
    """The static obstacles, including the map; ParameterError with all problems, by key."""
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
    """The shapes of a section, by default of those that only the simulator knows."""
    problems = Problems()
    prefixes = [f'{section}.{name}' for name in values[f'{section}.names']]
    shapes = [problems.attempt(partial(_shape, values, prefix)) for prefix in prefixes]
    problems.check()
    return tuple(each for each in shapes if each is not None)


def map_of(values: Values) -> GridObstacle | None:
    """The occupied cells of the map, if there is one; the same object for the same map."""
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
    kind = values[f'{prefix}.type']
    problems, found = Problems(), {}
    for key in _BLOCK:
        where, value, own = f'{prefix}.{key}', values[f'{prefix}.{key}'], _SETTINGS[kind].get(key)
        if own is not None:
            found[key] = problems.attempt(partial(_setting, own, where, value))
        elif value:
            problems.append(Problem(where, describe(value), f'nothing with type {kind}'))
    problems.check()
    made = next(each for each in SHAPES if each.kind == kind)
    try:
        return made.of(prefix.rpartition('.')[2], **found)
    except ShapeError as error:
        wrong = f'at vertex {error.vertex} (from 0) {error.found}'
        raise ParameterError(Problem(f'{prefix}.vertices', wrong, error.wanted)) from error


def _setting(own: Parameter, where: str, value: Any) -> Any:
    """Value of a setting as its type of obstacle wants it; raises `ParameterError`."""
    if not own.is_array:
        if value not in own.range:
            raise ParameterError(Problem(where, 'nothing, or 0', own.wanted))
        return value
    if own.length is not None:
        return tuple(own.read(where, value or None))
    if len(value) % 2 or not value:
        raise ParameterError(Problem(where, describe(value or None), 'x and y [m] of each vertex'))
    return tuple(zip(value[::2], value[1::2], strict=True))


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
