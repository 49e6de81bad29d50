"""Files of roads, CSV or GeoJSON in metres, and of maps, as map_server and slam_toolbox have them.

``road.file`` and ``map.file`` are replaced by the parameters of what they contain before anything
is declared or recorded: a bag has the road and the map themselves.
"""

import csv
import json
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

ROAD: Final = 'road.file'
MAP: Final = 'map.file'
_LARGEST_ROAD: Final = 10_000_000
_WIDTHS: Final = ('half_width', 'left_width', 'right_width')
_CSV: Final = 'a first line with x, y and, if need be, half_width, left_width, right_width'
_GEOJSON: Final = 'one LineString of [x, y] in metres'
_LARGEST_MAP: Final = 100_000
_MODES: Final = ('trinary', 'scale', 'raw')
_PERCENT: Final = 100.0
_WHITE: Final = 255.0


def with_road_file(values: Mapping[str, Any]) -> dict[str, Any]:
    """Replace the name of a road file, if given, by its road, or ParameterError with the line."""
    if ROAD not in values:
        return dict(values)
    name = values[ROAD]
    if not isinstance(name, str) or Path(name).suffix.lower() not in _READERS:
        raise ParameterError(Problem(ROAD, describe(name), 'a file named *.csv or *.geojson'))
    try:
        with Path(name).open(encoding='utf-8-sig') as file:
            text = file.read(_LARGEST_ROAD + 1)
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) else error
        raise ParameterError(Problem(name, str(reason), 'a file that can be read')) from error
    if len(text) > _LARGEST_ROAD:
        raise ParameterError(Problem(name, 'a larger file', f'{_LARGEST_ROAD} characters or less'))
    road = _READERS[Path(name).suffix.lower()](text, name)
    given = {key: value for key, value in values.items() if key not in (ROAD, *_replaced(road))}
    return {**given, 'road.type': 'corridor', **{f'road.{k}': v for k, v in road.items()}}


def _replaced(road: Mapping[str, Any]) -> list[str]:
    """Parameters that a road in a file replaces: widths only by widths."""
    keys = ['points', 'closed', *(_WIDTHS if set(_WIDTHS) & set(road) else ())]
    return [f'road.{key}' for key in keys]


def _read_csv(text: str, name: str) -> dict[str, Any]:
    rows = [row for row in csv.reader(text.splitlines()) if row]
    names = [column.strip() for column in rows[0]] if rows else []
    if not {'x', 'y'} <= set(names) <= {'x', 'y', *_WIDTHS} or len(set(names)) != len(names):
        raise ParameterError(Problem(f'{name}, line 1', describe(','.join(names)), _CSV))
    columns: dict[str, list[float]] = {column: [] for column in names}
    for line, row in enumerate(csv.reader(text.splitlines()), 1):
        if line == 1 or not row:
            continue
        numbers = [_number(item) for item in row]
        if len(numbers) != len(names) or None in numbers:
            wanted = f'{len(names)} finite numbers'
            raise ParameterError(Problem(f'{name}, line {line}', describe(','.join(row)), wanted))
        for column, number in zip(names, numbers, strict=True):
            columns[column].append(number or 0.0)
    points = list(zip(columns.pop('x'), columns.pop('y'), strict=True))
    return _road(points, columns)


def _read_geojson(text: str, name: str) -> dict[str, Any]:
    try:
        lines = list(_lines(json.loads(text)))
    except (ValueError, RecursionError) as error:
        raise ParameterError(Problem(name, f'no JSON ({error})', _GEOJSON)) from error
    if len(lines) != 1:
        raise ParameterError(Problem(name, f'{len(lines)} LineStrings', _GEOJSON))
    coordinates, properties = lines[0]
    points = []
    for point, place in enumerate(coordinates if isinstance(coordinates, list) else [None]):
        numbers = [_number(item) for item in place] if isinstance(place, list) else []
        if len(numbers) < 2 or None in numbers[:2]:
            where = f'{name}, point {point}'
            raise ParameterError(Problem(where, describe(place), '[x, y] in metres'))
        points.append((numbers[0] or 0.0, numbers[1] or 0.0))
    widths = {key: properties[key] for key in _WIDTHS if key in properties}
    return _road(points, {k: v if isinstance(v, list) else [v] for k, v in widths.items()})


def _lines(found: Any) -> Any:
    """Coordinates and properties of every LineString in a GeoJSON object."""
    if not isinstance(found, dict):
        return
    properties = found.get('properties')
    properties = properties if isinstance(properties, dict) else {}
    if found.get('type') == 'FeatureCollection' and isinstance(found.get('features'), list):
        for feature in found['features']:
            yield from _lines(feature)
    elif found.get('type') == 'Feature':
        for coordinates, _ in _lines(found.get('geometry')):
            yield coordinates, properties
    elif found.get('type') == 'LineString':
        yield found.get('coordinates'), properties


def _road(points: list[tuple[float, float]], widths: dict[str, list[Any]]) -> dict[str, Any]:
    closed = len(points) > 1 and points[0] == points[-1]
    kept = slice(None, -1) if closed else slice(None)
    # One width stands for all points.
    listed = {k: v[kept] if len(v) == len(points) > 1 else v for k, v in widths.items()}
    numbers = [number for point in points[kept] for number in point]
    return {'points': numbers, 'closed': closed, **listed}


def _number(item: object) -> float | None:
    if isinstance(item, bool) or not isinstance(item, (str, int, float)):
        return None
    try:
        number = float(item)
    except (ValueError, OverflowError):
        return None
    return number if math.isfinite(number) else None


_READERS: Final = {'.csv': _read_csv, '.geojson': _read_geojson, '.json': _read_geojson}


def with_map_file(values: Mapping[str, Any], folder: Path | None = None) -> dict[str, Any]:
    """The values with the map of the file that they name, from the folder, or ParameterError."""
    if MAP not in values:
        return dict(values)
    name = values[MAP]
    if not isinstance(name, str) or Path(name).suffix.lower() not in {'.yaml', '.yml'}:
        raise ParameterError(Problem(MAP, describe(name), 'a file named *.yaml'))
    beside = (folder or Path()) / name
    path = beside if beside.is_file() else Path(name)
    if not path.is_file():
        places = ' or '.join(dict.fromkeys(str(each.absolute()) for each in (beside, path)))
        raise ParameterError(Problem(MAP, f'no file {places}', 'the YAML file of a map'))
    grid = read_map(path)
    replaced = (MAP, 'map.origin', 'map.resolution', 'map.cells')
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
            said = yaml.safe_load(file.read(_LARGEST_MAP))
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
        problem = Problem(str(path), 'no file', 'the picture that image names in the map')
        raise ParameterError(problem) from error
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
