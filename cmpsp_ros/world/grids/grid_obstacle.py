"""The occupied cells of a grid as one obstacle that stands still."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar

import numpy as np

from cmpsp_ros.arrays import Array, BoolArray
from cmpsp_ros.world.grids.cell_groups import islands_of
from cmpsp_ros.world.grids.distance_transform import AROUND, distance_field
from cmpsp_ros.world.grids.field_functions import DistanceField
from cmpsp_ros.world.grids.occupancy_grid import Cell, GridError, OccupancyGrid
from cmpsp_ros.world.obstacles.shapes import Shape

Point = tuple[float, float]


@dataclass(frozen=True, eq=False)
class GridObstacle(Shape):
    """Occupied cells of a grid."""

    name: str  # the user's name for it, used in messages
    grid: OccupancyGrid
    unknown_is_free: bool = False  # true if unknown cells and all beyond are free

    corners: ClassVar[tuple[Point, ...]] = ()  # none: it has a distance field instead

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
        """Raise GridError if no cell is free."""
        if not (self.field.distances[AROUND:-AROUND, AROUND:-AROUND] > 0.0).any():
            raise GridError('cells', 'none that is free', 'a place to drive')

    @cached_property
    def islands(self) -> Array:
        """Points ``(I, 2)`` [m] of groups of occupied cells off the grid's rim, largest first."""
        occupied = self.field.distances[AROUND:-AROUND, AROUND:-AROUND] <= 0.0
        return self.grid.centers(*islands_of(occupied))

    def walls(self) -> list[Array]:
        """Lines around the occupied cells, each closed, shape ``(K, 2)`` [m]."""
        return [self.grid.corners(*loop) for loop in loops(self.grid.cells == Cell.OCCUPIED)]

    def outlines(self, distance: float) -> list[Array]:
        """Outlines as `Shape.outlines`: along edges of cells, longest first."""
        within = self.field.distances[AROUND:-AROUND, AROUND:-AROUND] <= distance
        found = [self.grid.corners(*loop) for loop in loops(within)]
        return sorted(found, key=lambda line: -len(line))


Node = tuple[int, int]


def loops(cells: BoolArray) -> list[tuple[Array, Array]]:
    """Rows and columns of closed lines around cells and holes, with the cells to their left."""
    onward = _edges(cells)
    found = []
    while onward:
        begin = next(iter(onward))
        line, step = [begin], onward[begin].pop()
        while True:
            line.append(_after(line[-1], step))
            left = onward[line[-2]]
            if not left:
                del onward[line[-2]]
            if line[-1] == begin:
                break
            ahead = onward[line[-1]]
            # Where cells touch at a corner, the line keeps to the cell that it is around.
            turn = (step[1], -step[0])
            step = ahead.pop(ahead.index(turn) if len(ahead) > 1 and turn in ahead else 0)
        nodes = np.array(line, dtype=float)
        along = np.diff(nodes, axis=0)
        turns = np.append(True, (along[1:] != along[:-1]).any(axis=1))
        found.append((*nodes[np.append(turns, True)].T,))
    return found


def _edges(cells: BoolArray) -> dict[Node, list[Node]]:
    """Steps (rows, columns) that lead on from each node along an edge of the cells."""
    padded = np.pad(cells, 1)
    onward: dict[Node, list[Node]] = {}
    # Below a cell the line leads to greater columns, to the right of it to greater rows.
    for step, begin, beside in (
        ((0, 1), (0, 0), (-1, 0)),
        ((1, 0), (0, 1), (0, 1)),
        ((0, -1), (1, 1), (1, 0)),
        ((-1, 0), (1, 0), (0, -1)),
    ):
        outside = ~np.roll(padded, (-beside[0], -beside[1]), axis=(0, 1))
        for row, column in np.argwhere(padded & outside) - 1 + np.array(begin):
            onward.setdefault((int(row), int(column)), []).append(step)
    return onward


def _after(node: Node, step: Any) -> Node:
    return node[0] + step[0], node[1] + step[1]
