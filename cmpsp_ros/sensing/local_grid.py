"""Memory of sightings: a grid that moves along with the robot, cell by cell.

Kernels count coordinates in cells, from the grid's corner. A cell has its state, the time of its
sighting [ns], and the end of a beam in it.
"""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cmpsp_ros.arrays import Array, BoolArray, IntArray
from cmpsp_ros.mpsp.jit import allocation_free, inner
from cmpsp_ros.robots import contains
from cmpsp_ros.sensing.beams import Beams
from cmpsp_ros.world.grids import Cell, OccupancyGrid

Cells = NDArray[np.uint8]
Places = NDArray[np.float32]

_NEVER = np.iinfo(np.int64).min
_FREE, _OCCUPIED = int(Cell.FREE), int(Cell.OCCUPIED)
_UNKNOWN, _REMEMBERED = int(Cell.UNKNOWN), int(Cell.REMEMBERED)

_UNSEEN = 2.0  # width of the strip around the footprint that no beam need ever pass [cells]
_BESIDE = 0.25  # distance from an earlier beam's end at which another shows it gone [cells]
_BEYOND = 4.0  # distance by which that beam must go on [cells]: one that grazes a wall does not


class LocalGrid:
    """Cells around the robot, along the axes of the frame of odometry.

    They belong to one lattice that never moves: the robot's position only decides which of them are
    remembered, so that nothing drifts.
    """

    def __init__(self, size: float, resolution: float, memory: float) -> None:
        """Make a square of unknown cells; sides in [m], `memory` out of sight [s]."""
        # As it is in a nav_msgs/OccupancyGrid, so that the grid in a bag is this one.
        self._resolution = resolution = float(np.float32(resolution))
        self._memory = round(memory * 1e9)
        side = max(1, math.ceil(size / resolution))
        self._column, self._row = -(side // 2), -(side // 2)
        self._cells = np.full((side, side), Cell.UNKNOWN, dtype=np.uint8)
        self._seen = np.full((side, side), _NEVER, dtype=np.int64)
        # Where in its cell the last beam ended [cells]: a wall is there, not in all of the cell.
        self._hits = np.zeros((side, side, 2), dtype=np.float32)
        # Number of the object that was hit there, its complement if by a beam of a cloud.
        self._owners = np.zeros((side, side), dtype=np.int64)

    def center_on(self, x: float, y: float) -> None:
        """Follow the robot by whole cells, and forget those left behind."""
        half = len(self._cells) // 2
        column = math.floor(x / self._resolution) - half
        row = math.floor(y / self._resolution) - half
        right, up = column - self._column, row - self._row
        if right or up:
            self._cells = _shifted(self._cells, up, right, Cell.UNKNOWN)
            self._seen = _shifted(self._seen, up, right, _NEVER)
            self._hits = _shifted(self._hits, up, right, 0.0)
            self._owners = _shifted(self._owners, up, right, 0)
            self._column, self._row = column, row

    def see(self, beams: Beams, owners: IntArray | None = None) -> None:
        """Clear cells along the beams of one message, and mark their ends.

        Where a mark is newer, as with sensors whose messages come late, it stays as it is.

        `owners` ``(B,)`` are the objects hit: 0 for none, negative for a moving one, which marks
        nothing.
        """
        if owners is None:
            owners = np.zeros(len(beams.ends), np.int64)
        arrays = self._cells, self._seen, self._hits, self._owners
        corner = np.array([self._column, self._row], dtype=float)
        starts = beams.starts / self._resolution - corner
        ends = beams.ends / self._resolution - corner
        times = beams.stamp, beams.stamp - self._memory
        clear(*arrays, starts, ends, beams.hits, *times, beams.is_sweep)
        mark(*arrays, ends, beams.hits, owners, beams.stamp, beams.is_sweep)

    def release(self, owner: int) -> None:
        """Free all cells that an object has marked: it moves."""
        is_owned = (self._owners == owner) | (self._owners == ~owner)
        self._cells[is_owned & (self._cells == Cell.OCCUPIED)] = Cell.FREE

    def stand_at(
        self, x: float, y: float, radius: float, stamp: int, corners: Array | None = None
    ) -> None:
        """Free the cells under the robot, and unknown ones so near that they were never seen.

        Obstacles seen beside the footprint stay: no beam need meet them there again. `x`, `y` and
        `radius` are of a disc that covers some of it [m], `corners` ``(C, 2)`` of the robot itself
        [m].
        """
        side, cell = len(self._cells), self._resolution
        near = math.ceil(radius / cell + _UNSEEN) + 1
        middle = math.floor(y / cell) - self._row, math.floor(x / cell) - self._column
        low = [min(max(each - near, 0), side) for each in middle]
        high = [min(max(each + near, 0), side) for each in middle]
        rows = (self._row + np.arange(low[0], high[0]) + 0.5) * cell - y
        columns = (self._column + np.arange(low[1], high[1]) + 0.5) * cell - x
        squared = np.square(columns) + np.square(rows)[:, None]
        around = slice(low[0], high[0]), slice(low[1], high[1])
        covered = squared <= (radius + _UNSEEN * cell) ** 2
        body = squared <= radius * radius
        if corners is not None:
            body = contains(corners - (x, y), np.dstack(np.meshgrid(columns, rows)))
        covered &= body | (self._cells[around] != Cell.OCCUPIED)
        self._cells[around][covered] = Cell.FREE
        self._seen[around][covered] = stamp

    def hits(self, stamp: int) -> Array:
        """Ends of beams in the cells that are occupied at a time [ns], ``(P, 2)`` [m]."""
        is_known = self._seen >= stamp - self._memory
        rows, columns = np.nonzero((self._cells == Cell.OCCUPIED) & is_known)
        corners = np.column_stack([columns + self._column, rows + self._row])
        return np.asarray((corners + self._hits[rows, columns]) * self._resolution, dtype=float)

    def at(self, stamp: int, in_sight: int | None = None) -> OccupancyGrid:
        """The grid at a time [ns]; cells last seen too long before it are unknown.

        Those seen longer ago than `in_sight` [ns], if it is given, are remembered at best.
        """
        cells = np.empty_like(self._cells)
        in_sight = self._memory if in_sight is None else in_sight
        remember(cells, self._cells, self._seen, stamp - self._memory, stamp - in_sight)
        origin = self._column * self._resolution, self._row * self._resolution, 0.0
        return OccupancyGrid(origin, self._resolution, cells)


def _shifted(array: NDArray[Any], up: int, right: int, fill: float) -> NDArray[Any]:
    """The part of a plane that begins so many cells further up and right."""
    shifted = np.full_like(array, fill)
    high, wide = array.shape[:2]
    if abs(up) < high and abs(right) < wide:
        shifted[max(-up, 0) : high - max(up, 0), max(-right, 0) : wide - max(right, 0)] = array[
            max(up, 0) : high - max(-up, 0), max(right, 0) : wide - max(-right, 0)
        ]
    return shifted


@allocation_free
def clear(
    cells: Cells,
    seen: IntArray,
    hits: Places,
    owned: IntArray,
    starts: Array,
    ends: Array,
    is_hit: BoolArray,
    stamp: int,
    oldest: int,
    is_sweep: bool,
) -> None:
    """Free the cells that beams pass through, but for those at whose end is an obstacle.

    A sweep frees an occupied cell only where a sweep has hit it, and a beam has passed close to the
    place that was hit and well beyond it: else those that graze a wall would open it, and those
    below a table the table. A mark from before `oldest` [ns] is forgotten. The space between two
    neighbours of a sweep is seen as well, as far as the shorter one.
    """
    arrays = cells, seen, hits, owned
    for i in range(starts.shape[0]):
        x, y, end_x, end_y = starts[i, 0], starts[i, 1], ends[i, 0], ends[i, 1]
        _clear_one(*arrays, x, y, end_x, end_y, is_hit[i], stamp, oldest, is_sweep)
        if not is_sweep or i + 1 == starts.shape[0]:
            continue
        along_x, along_y = end_x - x, end_y - y
        next_x, next_y = ends[i + 1, 0] - starts[i + 1, 0], ends[i + 1, 1] - starts[i + 1, 1]
        length = math.sqrt(along_x * along_x + along_y * along_y)
        next_length = math.sqrt(next_x * next_x + next_y * next_y)
        shorter = min(length, next_length)
        if shorter <= 0.0:
            continue
        along_x, along_y = along_x * shorter / length, along_y * shorter / length
        next_x, next_y = next_x * shorter / next_length, next_y * shorter / next_length
        apart = max(abs(next_x - along_x), abs(next_y - along_y))
        between = int(min(math.ceil(apart), 16.0)) if apart < shorter else 0
        for k in range(1, between):
            part = k / between
            from_x = x + part * (starts[i + 1, 0] - x)
            from_y = y + part * (starts[i + 1, 1] - y)
            to_x = from_x + along_x + part * (next_x - along_x)
            to_y = from_y + along_y + part * (next_y - along_y)
            # Nothing was measured along it: it frees unknown cells only.
            _clear_one(*arrays, from_x, from_y, to_x, to_y, True, stamp, oldest, False)


@allocation_free
def remember(known: Cells, cells: Cells, seen: IntArray, oldest: int, in_sight: int) -> None:
    """Fill in what is known of cells, by the earliest times that count [ns]."""
    for i in range(cells.shape[0]):
        for j in range(cells.shape[1]):
            cell = cells[i, j]
            known[i, j] = _REMEMBERED if cell == _FREE and seen[i, j] < in_sight else cell
            if seen[i, j] < oldest:
                known[i, j] = _UNKNOWN


@allocation_free
def mark(
    cells: Cells,
    seen: IntArray,
    hits: Places,
    owned: IntArray,
    ends: Array,
    is_hit: BoolArray,
    owners: IntArray,
    stamp: int,
    is_sweep: bool,
) -> None:
    """Occupy the cells in which beams have hit something that stands still."""
    for i in range(ends.shape[0]):
        column, row = math.floor(ends[i, 0]), math.floor(ends[i, 1])
        is_inside = 0 <= row < cells.shape[0] and 0 <= column < cells.shape[1]
        if not (is_hit[i] and owners[i] >= 0 and is_inside):
            continue
        if cells[row, column] != _OCCUPIED or seen[row, column] <= stamp:
            cells[row, column], seen[row, column] = _OCCUPIED, stamp
            owned[row, column] = owners[i] if is_sweep else ~owners[i]
            hits[row, column, 0] = ends[i, 0] - column
            hits[row, column, 1] = ends[i, 1] - row


@inner
def _clear_one(
    cells: Cells,
    seen: IntArray,
    hits: Places,
    owned: IntArray,
    x: float,
    y: float,
    end_x: float,
    end_y: float,
    is_hit: bool,
    stamp: int,
    oldest: int,
    sees_gone: bool,
) -> None:
    """Walk from cell to cell along a beam, within the grid (Amanatides and Woo 1987)."""
    along_x, along_y = end_x - x, end_y - y
    length = math.sqrt(along_x * along_x + along_y * along_y)
    rows, columns = cells.shape
    first, last = _inside(x, along_x, columns, 0.0, 1.0)
    first, last = _inside(y, along_y, rows, first, last)
    if not (first < last and length > 0.0):
        return
    column = min(max(math.floor(x + first * along_x), 0), columns - 1)
    row = min(max(math.floor(y + first * along_y), 0), rows - 1)
    right, up = (1 if along_x > 0.0 else -1), (1 if along_y > 0.0 else -1)
    step_x = abs(1.0 / along_x) if along_x != 0.0 else math.inf
    step_y = abs(1.0 / along_y) if along_y != 0.0 else math.inf
    next_x = (column + (right > 0) - x) / along_x if along_x != 0.0 else math.inf
    next_y = (row + (up > 0) - y) / along_y if along_y != 0.0 else math.inf
    end_column, end_row = math.floor(end_x), math.floor(end_y)
    for _ in range(rows + columns):
        if is_hit and column == end_column and row == end_row:
            return
        if cells[row, column] != _OCCUPIED or seen[row, column] < oldest:
            cells[row, column], seen[row, column] = _FREE, stamp
        elif sees_gone and owned[row, column] >= 0 and seen[row, column] <= stamp:
            to_x = column + hits[row, column, 0] - x
            to_y = row + hits[row, column, 1] - y
            beside = abs(along_x * to_y - along_y * to_x) / length
            beyond = length - (along_x * to_x + along_y * to_y) / length
            if beside <= _BESIDE and beyond >= _BEYOND:
                cells[row, column], seen[row, column] = _FREE, stamp
        if next_x < next_y:
            column, after = column + right, next_x
            next_x += step_x
        else:
            row, after = row + up, next_y
            next_y += step_y
        if after >= last or not (0 <= row < rows and 0 <= column < columns):
            return


@inner
def _inside(start: float, along: float, size: int, first: float, last: float) -> Any:
    """The part of a beam between two edges of the grid, and within another part of it."""
    if along == 0.0:
        return (first, last) if 0.0 <= start < size else (1.0, 0.0)
    one, other = -start / along, (size - start) / along
    return max(first, min(one, other)), min(last, max(one, other))
