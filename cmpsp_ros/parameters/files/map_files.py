"""Map files of map_server and slam_toolbox: YAML with PGM or PNG.

``map.file`` is replaced by the parameters of the map in it before anything is declared or
recorded: a bag has the map itself.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np
import yaml

from cmpsp_ros.arrays import Array, BoolArray
from cmpsp_ros.parameters.errors import ParameterError, Problem, describe
from cmpsp_ros.parameters.obstacles import text_of
from cmpsp_ros.world.grids import Cell, GridError, OccupancyGrid, check_size

KEY: Final = 'map.file'

_LARGEST: Final = 100_000
_MODES: Final = ('trinary', 'scale', 'raw')
_PERCENT: Final = 100.0
_WHITE: Final = 255.0


def with_map_file(values: Mapping[str, Any], folder: Path | None = None) -> dict[str, Any]:
    """The values with the map of the file that they name, from the folder, or ParameterError."""
    if KEY not in values:
        return dict(values)
    name = values[KEY]
    if not isinstance(name, str) or Path(name).suffix.lower() not in {'.yaml', '.yml'}:
        raise ParameterError(Problem(KEY, describe(name), 'a file named *.yaml'))
    beside = (folder or Path()) / name
    grid = read_map(beside if beside.is_file() else Path(name))
    replaced = (KEY, 'map.origin', 'map.resolution', 'map.cells')
    given = {key: value for key, value in values.items() if key not in replaced}
    return given | {
        'map.origin': list(grid.origin),
        'map.resolution': grid.resolution,
        'map.cells': text_of(grid.cells),
    }


def read_map(path: Path) -> OccupancyGrid:
    """The map of a file in YAML, with its picture; raises ParameterError."""
    said = _read_yaml(path)

    def take(key: str, default: Any, wanted: str, fits: Callable[[Any], bool]) -> Any:
        value = said.get(key, default)
        if not fits(value):
            found = 'nothing' if value is None else describe(value)
            raise ParameterError(Problem(f'{path}: {key}', found, wanted))
        return value

    def fraction(key: str, default: float) -> float:
        return float(take(key, default, 'a number from 0 to 1', _in_unit))

    picture = take('image', None, 'the name of a picture', lambda each: isinstance(each, str))
    resolution = take('resolution', None, 'a number > 0 [m]', lambda each: _is_number(each, 0.0))
    origin = take('origin', None, 'x, y and yaw [m, m, rad]', _is_pose)
    mode = take('mode', 'trinary', ' or '.join(_MODES), lambda each: each in _MODES)
    negate = take('negate', 0, '0 or 1', lambda each: each in (0, 1))
    high, low = fraction('occupied_thresh', 0.65), fraction('free_thresh', 0.25)
    if low >= high:
        wanted = f'less than occupied_thresh = {high}'
        raise ParameterError(Problem(f'{path}: free_thresh', f'{low}', wanted))
    shades, seen = _read_picture(path.parent / picture)
    # Black is occupied, but in `raw`, where a shade is a percentage.
    occupancy = shades / _WHITE if negate else 1.0 - shades / _WHITE
    if mode == 'raw':
        occupancy = shades / _PERCENT
        seen = shades <= _PERCENT
    elif mode == 'trinary':
        seen = np.ones_like(seen)
    cells = np.full(shades.shape, Cell.UNKNOWN, np.uint8)
    cells[seen & (occupancy < low)] = Cell.FREE
    cells[seen & (occupancy > high)] = Cell.OCCUPIED
    try:
        # A picture begins at the top.
        x, y, yaw = map(float, origin)
        return OccupancyGrid((x, y, yaw), float(resolution), np.ascontiguousarray(cells[::-1]))
    except GridError as error:
        where = f'{path}: {error.where}'
        raise ParameterError(Problem(where, error.found, error.wanted)) from error


def _read_yaml(path: Path) -> dict[str, Any]:
    wanted = 'image, resolution and origin, as map_saver writes them'
    try:
        with path.open(encoding='utf-8') as file:
            said = yaml.safe_load(file.read(_LARGEST))
    except OSError as error:
        raise ParameterError(Problem(str(path), str(error.strerror), 'a map')) from error
    except (ValueError, yaml.YAMLError, RecursionError) as error:
        raise ParameterError(Problem(str(path), describe(str(error)), wanted)) from error
    if not isinstance(said, dict):
        raise ParameterError(Problem(str(path), describe(said), wanted))
    return said


def _read_picture(path: Path) -> tuple[Array, BoolArray]:
    """Mean of the colours of each pixel, and whether it is opaque, ``(rows, columns)``."""
    # Slow to load, and few runs have a map.
    from PIL import Image, UnidentifiedImageError  # noqa: PLC0415

    try:
        with Image.open(path) as picture:
            check_size((picture.height, picture.width))
            channels = np.asarray(picture.convert('RGBA'), dtype=np.uint8)
    except GridError as error:
        raise ParameterError(Problem(str(path), error.found, error.wanted)) from error
    except UnidentifiedImageError as error:
        raise ParameterError(Problem(str(path), 'no picture', 'PGM or PNG')) from error
    except FileNotFoundError as error:
        raise ParameterError(Problem(str(path), 'no file', 'the picture of a map')) from error
    except (OSError, SyntaxError, ValueError, Image.DecompressionBombError) as error:
        wanted = 'a whole picture'
        raise ParameterError(Problem(str(path), describe(str(error)), wanted)) from error
    return channels[..., :3].mean(axis=2), channels[..., 3] == int(_WHITE)


def _is_number(value: Any, least: float = -math.inf) -> bool:
    number = isinstance(value, (int, float)) and not isinstance(value, bool)
    return number and math.isfinite(value) and value > least


def _in_unit(value: Any) -> bool:
    return _is_number(value) and 0.0 <= value <= 1.0


def _is_pose(value: Any) -> bool:
    return isinstance(value, list) and len(value) == 3 and all(map(_is_number, value))
