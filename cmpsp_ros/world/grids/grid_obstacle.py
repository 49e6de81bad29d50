"""The occupied cells of a grid as one obstacle that stands still."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np

from cmpsp_ros.arrays import Array
from cmpsp_ros.world.grids.distance_field import AROUND, distance_field
from cmpsp_ros.world.grids.field_functions import DistanceField
from cmpsp_ros.world.grids.islands import islands_of
from cmpsp_ros.world.grids.occupancy_grid import Cell, GridError, OccupancyGrid
from cmpsp_ros.world.grids.outlines import loops

Point = tuple[float, float]


@dataclass(frozen=True, eq=False)
class GridObstacle:
    """All that is occupied in a grid.

    Attributes:
        name: The user's name for it, used in messages.
        grid: The grid.
        unknown_is_free: Whether what is unknown is free, all beyond the grid too; else it is
            occupied.
    """

    name: str
    grid: OccupancyGrid
    unknown_is_free: bool = False

    corners: ClassVar[tuple[Point, ...]] = ()
    """None: it has a distance field instead."""

    radius: ClassVar[float] = 0.0

    @property
    def center(self) -> Point:
        """Middle of the grid (x, y) [m]."""
        rows, columns = self.grid.cells.shape
        x, y = self.grid.corners(np.array(rows / 2.0), np.array(columns / 2.0)).tolist()
        return x, y

    @cached_property
    def field(self) -> DistanceField:
        """Distances from the occupied cells."""
        return distance_field(self.grid, unknown_is_free=self.unknown_is_free)

    def check_space(self) -> None:
        """Refuse a grid without a place to drive.

        Raises:
            GridError: No cell is free.
        """
        if not (self.field.distances[AROUND:-AROUND, AROUND:-AROUND] > 0.0).any():
            raise GridError('cells', 'none that is free', 'a place to drive')

    @cached_property
    def islands(self) -> Array:
        """A point of each group of occupied cells that a way may pass on either side.

        They are those that do not touch the rim of the grid, the largest of them, ``(I, 2)`` [m].
        """
        occupied = self.field.distances[AROUND:-AROUND, AROUND:-AROUND] <= 0.0
        return self.grid.centers(*islands_of(occupied))

    def walls(self) -> list[Array]:
        """Lines around the occupied cells, each closed, shape ``(K, 2)`` [m]."""
        return [self.grid.corners(*loop) for loop in loops(self.grid.cells == Cell.OCCUPIED)]

    def outlines(self, distance: float) -> list[Array]:
        """See `cmpsp_ros.world.obstacles.shapes.outlines`: along edges of cells, longest first."""
        within = self.field.distances[AROUND:-AROUND, AROUND:-AROUND] <= distance
        found = [self.grid.corners(*loop) for loop in loops(within)]
        return sorted(found, key=lambda line: -len(line))
