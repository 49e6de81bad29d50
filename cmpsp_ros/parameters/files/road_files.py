"""Road files: CSV, or GeoJSON in metres.

``road.file`` is replaced by the parameters of the road in it before anything is declared or
recorded: a bag has the road itself.
"""

from __future__ import annotations

import csv
import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

from cmpsp_ros.parameters.errors import ParameterError, Problem, describe

KEY: Final = 'road.file'

_LARGEST: Final = 10_000_000
_WIDTHS: Final = ('half_width', 'left_width', 'right_width')
_CSV: Final = 'a first line with x, y and, if need be, half_width, left_width, right_width'
_GEOJSON: Final = 'one LineString of [x, y] in metres'


def with_road_file(values: Mapping[str, Any]) -> dict[str, Any]:
    """Replace the name of a road file, if given, by its road, or ParameterError with the line."""
    if KEY not in values:
        return dict(values)
    name = values[KEY]
    if not isinstance(name, str) or Path(name).suffix.lower() not in _READERS:
        raise ParameterError(Problem(KEY, describe(name), 'a file named *.csv or *.geojson'))
    try:
        with Path(name).open(encoding='utf-8-sig') as file:
            text = file.read(_LARGEST + 1)
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) else error
        raise ParameterError(Problem(name, str(reason), 'a file that can be read')) from error
    if len(text) > _LARGEST:
        raise ParameterError(Problem(name, 'a larger file', f'{_LARGEST} characters or less'))
    road = _READERS[Path(name).suffix.lower()](text, name)
    given = {key: value for key, value in values.items() if key not in (KEY, *_replaced(road))}
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
