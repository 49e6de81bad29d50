"""The shortest way across a map from anywhere to a goal, which one search of its grid finds."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Final

import numpy as np

from cmpsp_ros.arrays import Array, BoolArray
from cmpsp_ros.world.free_space import FreeSpace
from cmpsp_ros.world.grids.distance_field import node_points, nodes_near, signed_distances
from cmpsp_ros.world.grids.field_functions import DistanceField
from cmpsp_ros.world.grids.grid_obstacle import GridObstacle
from cmpsp_ros.world.grids.grid_search import (
    NEIGHBOURS,
    ROOM,
    cells_from,
    costs_of,
    evenly_spaced,
    lengths_to,
)
from cmpsp_ros.world.obstacles.shapes import Shape
from cmpsp_ros.world.roads import OpenFloor

Point = tuple[float, float]

# Cost of a cell that is nearer than wanted: a way around it is preferred.
_TOO_NEAR: Final = 50.0
# The same nearer than the margin, and where only the body fits: the widest way costs least.
_TIGHT: Final = 500.0, 5000.0
# Cost of a cell where the robot does not fit, for one who stands there.
_LOST: Final = 1e5
# Part of a cell by which centres may be nearer than the middle of a gap that fits.
_ROUNDING: Final = 0.5
# So that a line of cells is as straight as a robot would drive [m].
_SMOOTHED: Final = 0.2
# Lines that are nowhere farther apart go the same way [m].
_BESIDE: Final = 0.5


@dataclass(frozen=True, eq=False)
class KeptLine:
    """A line that is kept to unless another one is clearly better.

    Attributes:
        points: Of the line, shape ``(K, 2)`` [m].
        reluctance: By which part cells that are not beside it cost more.
    """

    points: Array
    reluctance: float


@dataclass(frozen=True)
class MapSearch:
    """A search for lines across a map, one for all lines to a goal.

    Attributes:
        obstacles: At least one of them is a grid.
        wanted: Distance to keep from them at the samples of a plan [m].
        margin: Distance that the path between samples keeps, radius and margin [m]. It is given up
            only where no other way leads, and then as little of it as possible.
        body: Distance without which the robot does not fit [m].
        kept: A line that is kept to.
    """

    obstacles: tuple[Shape, ...]
    wanted: float
    margin: float
    body: float
    kept: KeptLine | None = None

    @property
    def grid(self) -> GridObstacle:
        """The first grid, on whose cells lines are searched."""
        return next(each for each in self.obstacles if isinstance(each, GridObstacle))

    def line(self, start: Array, goal: Point, spacing: float) -> Array:
        """Evenly spaced points ``(K, 2)`` [m] of the line from start ``(2,)`` to goal.

        `spacing` is their largest distance [m]; ``K`` = 0 where no line leads.
        """
        field = self.grid.field
        cells = cells_from(_lengths(self, goal), nodes_near(field, start))
        if not len(cells):
            return np.empty((0, 2))
        line = np.vstack([start, node_points(field, cells[1:-1]), goal])
        passes = math.ceil((_SMOOTHED / float(field.frame['cell'][0])) ** 2)
        return evenly_spaced(line, spacing, passes)

    def lengths(self, points: Array, goal: Point) -> Array:
        """Lengths of the lines from points ``(K, 2)`` to a goal, longer where it is narrow [m]."""
        field, lengths = self.grid.field, _lengths(self, goal)
        found: Array = lengths[tuple(nodes_near(field, points).T)] * field.frame['cell'][0]
        return found

    def prepare(self, goal: Point) -> None:
        """Search for the lines to a goal: it takes too long for a control step."""
        _lengths(self, goal)


def is_beside(line: Array, other: Array) -> bool:
    """True for a line that nowhere strays from another; points of shape ``(K, 2)`` each [m]."""
    away = np.hypot(*(line[:, None] - other).T).min(axis=0, initial=math.inf)
    return bool((away <= _BESIDE).all())


def _take_out(distances: Array, field: DistanceField, shape: Shape, reach: float) -> None:
    """Lower distances at the nodes that a shape is nearer to than a reach [m]."""
    ends = shape.grid.ends if isinstance(shape, GridObstacle) else np.array(shape.corners)
    nodes = nodes_near(field, ends)
    around = math.ceil((shape.radius + reach) / field.frame['cell'][0]) + 1
    low = np.maximum(nodes.min(axis=0) - around, 0)
    part = distances[low[0] : nodes[:, 0].max() + around, low[1] : nodes[:, 1].max() + around]
    nodes = low + np.indices(part.shape).reshape(2, -1).T
    poses = np.column_stack([node_points(field, nodes), np.zeros(len(nodes))])
    away = FreeSpace.of(OpenFloor(), (shape,), 0.0).at(poses)[:, 2]
    np.minimum(part, away.reshape(part.shape), out=part)


@lru_cache(maxsize=16)
def _lengths(search: MapSearch, goal: Point) -> Array:
    field = search.grid.field
    distances = field.distances.copy()
    for each in search.obstacles:
        if each is not search.grid:
            _take_out(distances, field, each, search.wanted + ROOM)
    cell = float(field.frame['cell'][0])
    least = search.body - _ROUNDING * cell
    costs = costs_of(distances - search.wanted)
    costs[(distances < search.wanted) & (distances >= search.margin)] = _TOO_NEAR
    is_tight = (distances < search.margin) & (distances > least)
    spent = (search.margin - distances[is_tight]) / (search.margin - least)
    costs[is_tight] = _TIGHT[0] * (_TIGHT[1] / _TIGHT[0]) ** spent
    if search.kept is not None:
        line = np.zeros(costs.shape, dtype=bool)
        line[tuple(nodes_near(field, search.kept.points).T)] = True
        costs[signed_distances(line) * cell > _BESIDE] *= 1.0 + search.kept.reluctance
    lengths = lengths_to(costs, nodes_near(field, np.array(goal)))
    _lead_out(lengths, (distances <= least) & (distances > 0.0), math.ceil(search.body / cell))
    return lengths


def _lead_out(lengths: Array, too_near: BoolArray, steps: int) -> None:
    """Fill in lengths of cells where the robot does not fit: out of them, never through them.

    One who stands there, by an error of what is seen, is led out by the shortest way.
    """
    rows, columns = np.nonzero(too_near[1:-1, 1:-1] & np.isinf(lengths[1:-1, 1:-1]))
    rows, columns = rows + 1, columns + 1
    for _ in range(steps):
        known = [lengths[rows + i, columns + j] + math.hypot(i, j) * _LOST for i, j in NEIGHBOURS]
        lengths[rows, columns] = np.min([lengths[rows, columns], *known], axis=0)
