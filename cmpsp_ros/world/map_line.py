"""The shortest way across a map from anywhere to a goal, which one search of its grid finds."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Final

import numpy as np
from numpy.typing import NDArray

from cmpsp_ros.world.free_space import FreeSpace
from cmpsp_ros.world.grids.distance_field import node_near, node_points
from cmpsp_ros.world.grids.grid_obstacle import GridObstacle
from cmpsp_ros.world.grids.grid_search import (
    cells_from,
    costs_of,
    evenly_spaced,
    lengths_to,
)
from cmpsp_ros.world.obstacles.shapes import Shape
from cmpsp_ros.world.roads.open_floor import OpenFloor

Array = NDArray[np.float64]
Point = tuple[float, float]

# Of a cell that is nearer than wanted: for one who stands there, or where no other way leads.
_TOO_NEAR: Final = 50.0
# So that a line of cells is as straight as a robot would drive [m].
_SMOOTHED: Final = 0.2


@dataclass(frozen=True)
class MapSearch:
    """What lines across a map keep away from. One search is for all lines to a goal.

    Attributes:
        obstacles: At least one of them is a grid.
        wanted: Distance to keep from them [m].
        least: Distance to keep where there is no other way [m].
    """

    obstacles: tuple[Shape, ...]
    wanted: float
    least: float

    @property
    def grid(self) -> GridObstacle:
        """The first grid, on whose cells lines are searched."""
        return next(each for each in self.obstacles if isinstance(each, GridObstacle))

    def line(self, start: Array, goal: Point, spacing: float) -> Array:
        """Points of the line from a start to a goal, evenly spaced, shape ``(K, 2)`` [m].

        Args:
            start: Where it begins, shape ``(2,)`` [m].
            goal: Where it ends (x, y) [m].
            spacing: Largest distance of two points [m].

        Returns:
            Nothing, shape ``(0, 2)``, where no line leads.
        """
        field = self.grid.field
        cells = cells_from(_lengths(self, goal), node_near(field, start))
        if not len(cells):
            return np.empty((0, 2))
        line = np.vstack([start, node_points(field, cells[1:-1]), goal])
        passes = math.ceil((_SMOOTHED / float(field.frame['cell'][0])) ** 2)
        return evenly_spaced(line, spacing, passes)

    def lengths(self, points: Array, goal: Point) -> Array:
        """Lengths of the lines from points ``(K, 2)`` to a goal, longer where it is narrow [m]."""
        field, lengths = self.grid.field, _lengths(self, goal)
        nodes = np.array([node_near(field, point) for point in points])
        found: Array = lengths[tuple(nodes.T)] * field.frame['cell'][0]
        return found

    def prepare(self, goal: Point) -> None:
        """Search for the lines to a goal: it takes too long for a control step."""
        _lengths(self, goal)


@lru_cache(maxsize=8)
def _lengths(search: MapSearch, goal: Point) -> Array:
    field = search.grid.field
    others = [each for each in search.obstacles if each is not search.grid]
    distances = field.distances
    if others:
        nodes = np.indices(distances.shape).reshape(2, -1).T
        poses = np.column_stack([node_points(field, nodes), np.zeros(len(nodes))])
        around = FreeSpace.of(OpenFloor(), others, 0.0).at(poses)[:, 2:].min(axis=1)
        distances = np.minimum(distances, around.reshape(distances.shape))
    costs = costs_of(distances - search.wanted)
    costs[(distances < search.wanted) & (distances > search.least)] = _TOO_NEAR
    return lengths_to(costs, node_near(field, np.array(goal)))
