"""ROS messages of maps: OccupancyGrid and its updates. Importing it loads compiled kernels."""

import math
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from cmpsp_ros.sensing.messages import FARTHEST
from cmpsp_ros.world.grids import Cell, Cells, GridError, OccupancyGrid, check_size

REMEMBERED: Final = 1  # value of a free cell out of sight, in the grids that guidance publishes
LETHAL: Final = 65  # default value from which a cell is occupied, as of map_server
_FLAT: Final = 1e-3


def grid_of(message: Any, frame_id: str, lethal: int = LETHAL) -> OccupancyGrid:
    """Grid of a `nav_msgs/OccupancyGrid` of any origin and resolution, occupied from `lethal` on.

    GridError if it is in another frame, its data do not fit its size, its resolution is not
    positive, or its origin is not finite, not flat or no place on Earth.
    """
    found = message.header.frame_id
    if found != frame_id:
        raise GridError('frame_id', repr(found), f'{frame_id!r} (frame_id)')
    info = message.info
    shape = int(info.height), int(info.width)
    check_size(shape)
    cells = _cells(message.data, shape, lethal)
    position = float(info.origin.position.x), float(info.origin.position.y)
    if max(map(abs, position)) > FARTHEST:
        raise GridError('origin', f'{position} m', 'a place on Earth')
    return OccupancyGrid((*position, _yaw(info.origin.orientation)), float(info.resolution), cells)


def updated(grid: OccupancyGrid, message: Any, lethal: int = LETHAL) -> OccupancyGrid:
    """A grid after a `map_msgs/OccupancyGridUpdate`; `lethal` as of `grid_of`.

    GridError if it has no cells, other data than its size says, or is not within the grid.
    """
    shape = int(message.height), int(message.width)
    check_size(shape)
    row, column = int(message.y), int(message.x)
    high, wide = grid.cells.shape
    if not (0 <= row <= high - shape[0] and 0 <= column <= wide - shape[1]):
        found = f'{shape[1]} x {shape[0]} cells at {column}, {row}'
        raise GridError('x, y, width, height', found, f'a part of a grid of {wide} x {high}')
    cells = grid.cells.copy()
    cells[row : row + shape[0], column : column + shape[1]] = _cells(message.data, shape, lethal)
    return OccupancyGrid(grid.origin, grid.resolution, cells)


def _cells(data: Any, shape: tuple[int, int], lethal: int) -> Cells:
    values: NDArray[np.int8] = np.asarray(data, dtype=np.int8)
    count = shape[0] * shape[1]
    if values.shape != (count,):
        raise GridError('data', f'{values.size} values', f'{count} for {shape[1]} x {shape[0]}')
    known = np.where(values >= lethal, np.uint8(Cell.OCCUPIED), np.uint8(Cell.FREE))
    known[(values == REMEMBERED) & (lethal > REMEMBERED)] = Cell.REMEMBERED
    return np.where(values < 0, np.uint8(Cell.UNKNOWN), known).reshape(shape)


def _yaw(orientation: Any) -> float:
    """Heading of an orientation about the vertical [rad]."""
    x, y, z, w = (float(getattr(orientation, each)) for each in 'xyzw')
    length = math.sqrt(x * x + y * y + z * z + w * w)
    # NaN is refused as well.
    if not (abs(length - 1.0) <= 0.01 and math.hypot(x, y) <= _FLAT):
        wanted = 'a quaternion of length 1 about the vertical'
        raise GridError('origin.orientation', f'{(x, y, z, w)}', wanted)
    return 2.0 * math.atan2(z, w)
