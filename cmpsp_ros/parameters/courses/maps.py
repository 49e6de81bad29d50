"""The map from parameters, and its checks."""

from __future__ import annotations

import base64
import binascii
import re
import zlib
from functools import lru_cache
from typing import Final

import numpy as np

from cmpsp_ros.guidance import MAP
from cmpsp_ros.parameters.errors import ParameterError, Problem, describe
from cmpsp_ros.parameters.table import Values
from cmpsp_ros.world.grids import Cells, GridError, GridObstacle, OccupancyGrid, check_size

NONE: Final = 'none'
"""Cells of no map."""

_FORM: Final = re.compile(r'(\d{1,9}) x (\d{1,9}) ([A-Za-z0-9+/=]+)', re.ASCII)
_WANTED: Final = 'what map.file makes of a map, or none'


def text_of(cells: Cells) -> str:
    """Cells as text: rows, columns and compressed values."""
    packed = base64.b64encode(zlib.compress(cells.tobytes(), 9)).decode()
    return f'{cells.shape[0]} x {cells.shape[1]} {packed}'


def map_of(values: Values) -> GridObstacle | None:
    """What is occupied in the map, if there is one; the same object for the same map.

    Raises:
        ParameterError: It is no map, or nothing is free in it.
    """
    if values['map.cells'] == NONE:
        return None
    x, y, yaw = values['map.origin']
    found = (x, y, yaw), values['map.resolution'], values['map.cells']
    return _map_of(*found, values['map.unknown_is_free'])


# It takes much longer than all other parameters, which are read several times over.
@lru_cache(maxsize=4)
def _map_of(
    origin: tuple[float, float, float], resolution: float, text: str, unknown_is_free: bool
) -> GridObstacle:
    try:
        grid = OccupancyGrid(origin, resolution, _cells_of(text))
        found = GridObstacle(MAP, grid, unknown_is_free)
        found.check_space()
    except GridError as error:
        raise ParameterError(Problem(f'map.{error.where}', error.found, error.wanted)) from error
    return found


def _cells_of(text: str) -> Cells:
    form = _FORM.fullmatch(text)
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
