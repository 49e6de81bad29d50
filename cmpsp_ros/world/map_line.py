"""The shortest way across a map from anywhere to a goal, which one search of its grid finds."""

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Final

import numpy as np

from cmpsp_ros.arrays import Array
from cmpsp_ros.world.free_space import FreeSpace
from cmpsp_ros.world.grids import grid_search
from cmpsp_ros.world.grids.distance_transform import node_points, nodes_near, signed_distances
from cmpsp_ros.world.grids.field_functions import DistanceField
from cmpsp_ros.world.grids.grid_obstacle import GridObstacle
from cmpsp_ros.world.obstacles.shapes import Shape
from cmpsp_ros.world.roads import OpenFloor

Point = tuple[float, float]

# Cost of a cell that is nearer than wanted: a way around it is preferred. It is that of any cell
# nearer than the margin, too, on the way out for one who stands there.
_TOO_NEAR: Final = 50.0
# The same nearer than the margin, and where only the body fits: the widest way costs least.
_TIGHT: Final = 500.0, 5000.0
# Cost of a cell near a place that did not fit.
_BLOCKED: Final = 2e4
# Part of a cell by which centres may be nearer than the middle of a gap that fits.
_ROUNDING: Final = 0.5
# So that a line of cells is as straight as a robot would drive [m].
_SMOOTHED: Final = 0.2
# Lines that are nowhere farther apart go the same way [m].
_BESIDE: Final = 0.5


@dataclass(frozen=True, eq=False)
class KeptLine:
    """A line ``(K, 2)`` [m] that is kept to: cells not beside it cost more by a `reluctance`."""

    points: Array
    reluctance: float


@dataclass(frozen=True)
class MapSearch:
    """A search for lines across a map, one for all lines to a goal.

    The margin is given up only where no other way leads, and then as little of it as possible.
    """

    obstacles: tuple[Shape, ...]  # at least one of them is a grid
    wanted: float  # distance to keep from them at the samples of a plan [m]
    margin: float  # distance that the path between samples keeps, radius and margin [m]
    body: float  # distance without which the robot does not fit [m]
    kept: KeptLine | None = None  # a line that is kept to
    blocked: tuple[Point, ...] = ()  # places that did not fit (x, y): other ways are preferred [m]

    @property
    def grid(self) -> GridObstacle:
        """The first grid, on whose cells lines are searched."""
        return next(each for each in self.obstacles if isinstance(each, GridObstacle))

    @property
    def detour(self) -> float:
        """Least cost of the way to the middle of a place that did not fit [m]."""
        return 2.0 * self.body * _BLOCKED

    def line(self, start: Array, goal: Point, spacing: float) -> Array:
        """Points ``(K, 2)`` of the line to a goal, at most `spacing` apart [m]; none for none."""
        field = self.grid.field
        lengths, led_out = _lengths(self, goal)
        cells = grid_search.cells_from(led_out, nodes_near(field, start))
        if not len(cells):
            return np.empty((0, 2))
        # Once it is out it keeps to cells that fit.
        out = int((lengths[tuple(cells.T)] == led_out[tuple(cells.T)]).argmax())
        cells = np.vstack([cells[:out], grid_search.cells_from(lengths, cells[out])])
        line = np.vstack([start, node_points(field, cells[1:-1]), goal])
        passes = math.ceil((_SMOOTHED / float(field.frame['cell'][0])) ** 2)
        return grid_search.evenly_spaced(line, spacing, passes)

    def lengths(self, points: Array, goal: Point) -> Array:
        """Lengths of the lines from points ``(K, 2)`` to a goal, longer where it is narrow [m]."""
        field, (_, led_out) = self.grid.field, _lengths(self, goal)
        return np.asarray(led_out[tuple(nodes_near(field, points).T)] * field.frame['cell'][0])

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
def _lengths(search: MapSearch, goal: Point) -> tuple[Array, Array]:
    """Lengths from all cells, and the same for one who is led out of a cell that is too near."""
    field = search.grid.field
    distances = field.distances.copy()
    for each in search.obstacles:
        if each is not search.grid:
            _take_out(distances, field, each, search.wanted + grid_search.ROOM)
    cell = float(field.frame['cell'][0])
    least = search.body - _ROUNDING * cell
    costs = grid_search.costs_of(distances - search.wanted)
    costs[(distances < search.wanted) & (distances >= search.margin)] = _TOO_NEAR
    is_tight = (distances < search.margin) & (distances > least)
    spent = (search.margin - distances[is_tight]) / (search.margin - least)
    costs[is_tight] = _TIGHT[0] * (_TIGHT[1] / _TIGHT[0]) ** spent
    if search.kept is not None:
        line = np.zeros(costs.shape, dtype=bool)
        line[tuple(nodes_near(field, search.kept.points).T)] = True
        costs[signed_distances(line) * cell > _BESIDE] *= 1.0 + search.kept.reluctance
    for place in search.blocked:
        row, column = nodes_near(field, np.array(place)).tolist()
        around = math.ceil(2.0 * search.body / cell)
        part = np.s_[max(row - around, 0) : row + around + 1]
        beside = np.s_[max(column - around, 0) : column + around + 1]
        near = costs[part, beside]
        np.maximum(near, _BLOCKED, out=near, where=np.isfinite(near))
    lengths = grid_search.lengths_to(costs, nodes_near(field, np.array(goal)))
    is_near = (distances < search.margin) & (distances > search.body / 2.0)
    # Who is near something, by an error of what is seen, is led out by the shortest way.
    return lengths, grid_search.led_out(
        lengths, is_near, _TOO_NEAR, math.ceil(search.margin / cell)
    )
