"""What sensors have seen around the robot: a grid that goes along with it, cell by cell."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cmpsp_ros.arrays import Array
from cmpsp_ros.robots import contains
from cmpsp_ros.sensing.beams import Beams
from cmpsp_ros.sensing.grid_functions import clear, mark
from cmpsp_ros.world.grids import Cell, OccupancyGrid

_NEVER = np.iinfo(np.int64).min

_BESIDE = 2.0
"""Cells around the footprint that no beam need ever pass [cells]."""


class LocalGrid:
    """Cells around the robot, along the axes of the frame of odometry.

    Cells are those of one lattice in the plane, which never moves: where the robot goes only
    decides which of them are remembered, so that nothing drifts.
    """

    def __init__(self, size: float, resolution: float, memory: float) -> None:
        """Know nothing.

        Args:
            size: Side of the square that is remembered [m].
            resolution: Side of a cell [m].
            memory: For how long what is out of sight is remembered [s].
        """
        # As it is in a nav_msgs/OccupancyGrid, so that the grid in a bag is this one.
        self._resolution = resolution = float(np.float32(resolution))
        self._memory = round(memory * 1e9)
        side = max(1, math.ceil(size / resolution))
        self._column, self._row = -(side // 2), -(side // 2)
        self._cells = np.full((side, side), Cell.UNKNOWN, dtype=np.uint8)
        self._seen = np.full((side, side), _NEVER, dtype=np.int64)
        # Where in its cell the last beam ended [cells]: a wall is there, not in all of the cell.
        self._hits = np.zeros((side, side, 2), dtype=np.float32)

    def center_on(self, x: float, y: float) -> None:
        """Go along with the robot, by whole cells; what it leaves behind is forgotten."""
        half = len(self._cells) // 2
        column = math.floor(x / self._resolution) - half
        row = math.floor(y / self._resolution) - half
        right, up = column - self._column, row - self._row
        if right or up:
            self._cells = _shifted(self._cells, up, right, Cell.UNKNOWN)
            self._seen = _shifted(self._seen, up, right, _NEVER)
            self._hits = _shifted(self._hits, up, right, 0.0)
            self._column, self._row = column, row

    def see(self, beams: Beams) -> None:
        """Take beams in: they clear what they pass through, and mark where they end.

        Args:
            beams: Not older than those before.
        """
        arrays = self._cells, self._seen, self._hits
        corner = np.array([self._column, self._row], dtype=float)
        starts = beams.starts / self._resolution - corner
        ends = beams.ends / self._resolution - corner
        clear(*arrays, starts, ends, beams.hits, beams.stamp, beams.is_sweep)
        mark(*arrays, ends, beams.hits, beams.stamp)

    def stand_at(
        self, x: float, y: float, radius: float, stamp: int, corners: Array | None = None
    ) -> None:
        """Know that nothing is where the robot is, or so near that it was never seen there.

        What was seen beside the footprint stays: no beam need meet it there again.

        Args:
            x: Where its centre is [m].
            y: See `x`.
            radius: Of its footprint, or of a disc that covers some of it [m].
            stamp: When [ns].
            corners: Of what of that is the robot itself, ``(C, 2)`` [m]; None for all of it.
        """
        side, cell = len(self._cells), self._resolution
        near = math.ceil(radius / cell + _BESIDE) + 1
        middle = np.array([math.floor(y / cell) - self._row, math.floor(x / cell) - self._column])
        low, high = np.clip([middle - near, middle + near], 0, side).tolist()
        rows = (self._row + np.arange(low[0], high[0]) + 0.5) * cell - y
        columns = (self._column + np.arange(low[1], high[1]) + 0.5) * cell - x
        squared = np.square(columns) + np.square(rows)[:, None]
        around = slice(low[0], high[0]), slice(low[1], high[1])
        covered = squared <= (radius + _BESIDE * cell) ** 2
        body = squared <= radius * radius
        if corners is not None:
            body = contains(corners - (x, y), np.dstack(np.meshgrid(columns, rows)))
        covered &= body | (self._cells[around] != Cell.OCCUPIED)
        self._cells[around][covered] = Cell.FREE
        self._seen[around][covered] = stamp

    def hits(self, stamp: int) -> Array:
        """Where beams have ended in the cells that are occupied at a time [ns], ``(P, 2)`` [m]."""
        is_known = self._seen >= stamp - self._memory
        rows, columns = np.nonzero((self._cells == Cell.OCCUPIED) & is_known)
        corners = np.column_stack([columns + self._column, rows + self._row])
        return np.asarray((corners + self._hits[rows, columns]) * self._resolution, dtype=float)

    def at(self, stamp: int) -> OccupancyGrid:
        """What is known at a time [ns]; what was last seen too long before it is unknown."""
        cells = np.where(self._seen >= stamp - self._memory, self._cells, np.uint8(Cell.UNKNOWN))
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
