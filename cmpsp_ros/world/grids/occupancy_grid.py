"""A grid of cells that are free, occupied or unknown, at any pose in the plane."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import IntEnum
from typing import Final

import numpy as np
from numpy.typing import NDArray

from cmpsp_ros.arrays import Array, BoolArray, IntArray

Cells = NDArray[np.uint8]

MOST_CELLS: Final = 100_000_000  # larger grids are refused


class Cell(IntEnum):
    """State of a cell."""

    FREE = 0
    OCCUPIED = 1
    UNKNOWN = 2
    REMEMBERED = 3  # free when last seen, and out of sight now


class GridError(ValueError):
    """A grid, or a file of one, that cannot be used: where (attribute or key), found and wanted."""

    def __init__(self, where: str, found: str, wanted: str) -> None:
        super().__init__(f'{where}: found {found}, wanted {wanted}')
        self.where, self.found, self.wanted = where, found, wanted


@dataclass(frozen=True, eq=False)
class OccupancyGrid:
    """Cells in rows along x, one row after the other along y, as in nav_msgs/OccupancyGrid.

    GridError for no cells or too many, values that are none, or numbers that are not finite.
    """

    origin: tuple[float, float, float]  # pose of the outer corner of cell (0, 0) [m, m, rad]
    resolution: float  # side of a cell [m]
    cells: Cells  # values of `Cell`, shape ``(rows, columns)``

    def __post_init__(self) -> None:
        if not all(map(math.isfinite, self.origin)):
            raise GridError('origin', f'{self.origin}', 'x, y and yaw, finite')
        if not (math.isfinite(self.resolution) and self.resolution > 0.0):
            raise GridError('resolution', f'{self.resolution} m', 'a finite number > 0')
        shape = self.cells.shape
        check_size(shape)
        if self.cells.dtype != np.uint8 or self.cells.max() > Cell.REMEMBERED:
            raise GridError('cells', f'{self.cells.dtype}, up to {self.cells.max()}', 'uint8, 0-3')

    def equals(self, other: OccupancyGrid) -> bool:
        """True if the other grid has the same cells at the same place."""
        is_there = (self.origin, self.resolution) == (other.origin, other.resolution)
        return is_there and np.array_equal(self.cells, other.cells)

    @property
    def size(self) -> tuple[float, float]:
        """Width along x and height along y, of the grid itself [m]."""
        rows, columns = self.cells.shape
        return columns * self.resolution, rows * self.resolution

    @property
    def ends(self) -> Array:
        """Corners of the grid itself, shape ``(4, 2)`` [m]."""
        rows, columns = self.cells.shape
        return self.corners(*np.array([[0, 0, rows, rows], [0, columns, 0, columns]], float))

    def centers(self, rows: IntArray, columns: IntArray) -> Array:
        """Centres of cells, shape ``(..., 2)`` [m]."""
        return self.corners(rows.astype(float) + 0.5, columns.astype(float) + 0.5)

    def corners(self, rows: Array, columns: Array) -> Array:
        """Outer corners of cells, or other points by their rows and columns, ``(..., 2)`` [m]."""
        cosine, sine = math.cos(self.origin[2]), math.sin(self.origin[2])
        along, across = columns * self.resolution, rows * self.resolution
        points = np.empty((*np.shape(along), 2))
        points[..., 0] = self.origin[0] + cosine * along - sine * across
        points[..., 1] = self.origin[1] + sine * along + cosine * across
        return points

    def indices(self, points: Array) -> tuple[IntArray, IntArray]:
        """Row and column of the cells of points ``(..., 2)`` [m], beyond the grid too."""
        cosine, sine = math.cos(self.origin[2]), math.sin(self.origin[2])
        dx, dy = points[..., 0] - self.origin[0], points[..., 1] - self.origin[1]
        columns = np.floor((cosine * dx + sine * dy) / self.resolution).astype(np.int64)
        rows = np.floor((cosine * dy - sine * dx) / self.resolution).astype(np.int64)
        return rows, columns

    def contains(self, rows: IntArray, columns: IntArray) -> BoolArray:
        """True for cells in the grid."""
        high, wide = self.cells.shape
        return np.asarray((rows >= 0) & (rows < high) & (columns >= 0) & (columns < wide))

    def at(self, points: Array) -> Cells:
        """State of the cells that points ``(..., 2)`` [m] are in, unknown outside the grid."""
        rows, columns = self.indices(points)
        inside = self.contains(rows, columns)
        found = np.full(inside.shape, Cell.UNKNOWN, np.uint8)
        found[inside] = self.cells[rows[inside], columns[inside]]
        return found

    def around(self, points: Array, reach: float) -> OccupancyGrid:
        """The part of the grid near points ``(K, 2)`` along its axes [m], one cell at least."""
        found, cells = np.array(self.indices(points)), math.ceil(reach / self.resolution)
        last = np.array(self.cells.shape)
        (row, column) = low = np.clip(found.min(axis=1) - cells, 0, last - 1)
        high = np.maximum(np.clip(found.max(axis=1) + cells + 1, 0, last), low + 1)
        x, y = self.corners(row, column).tolist()
        part = self.cells[row : high[0], column : high[1]]
        return OccupancyGrid((x, y, self.origin[2]), self.resolution, part)

    def completed_by(self, other: OccupancyGrid) -> OccupancyGrid:
        """Copy with unknown cells filled from another grid."""
        rows, columns = np.nonzero(self.cells == Cell.UNKNOWN)
        cells = self.cells.copy()
        cells[rows, columns] = other.at(self.centers(rows, columns))
        return OccupancyGrid(self.origin, self.resolution, cells)


def is_free(cells: Cells) -> BoolArray:
    """True for cells that are free, in sight or not."""
    return np.asarray((cells == Cell.FREE) | (cells == Cell.REMEMBERED))


def check_size(shape: tuple[int, ...]) -> None:
    """Raise GridError for a shape without cells, or with more than fit into memory."""
    if len(shape) != 2 or min(shape) < 1 or math.prod(shape) > MOST_CELLS:
        wanted = f'1 to {MOST_CELLS} cells in rows and columns'
        raise GridError('cells', ' x '.join(map(str, shape)), wanted)
