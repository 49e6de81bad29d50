"""The shortest way across a map from anywhere to a goal, which one search of its grid finds."""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Final

import numpy as np
from numpy.typing import NDArray

from cmpsp_ros.world.free_space import FreeSpace
from cmpsp_ros.world.grids.distance_field import node_near, node_points
from cmpsp_ros.world.grids.field_functions import DistanceField
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

# What a cell costs that is nearer than wanted, so that one who stands there is led away, and down
# to what part of that distance.
_TOO_NEAR: Final = 50.0
_PART: Final = 0.5
# So that a line of cells is as straight as a robot would drive [m].
_SMOOTHED: Final = 0.2


def map_line(
    obstacles: tuple[Shape, ...], distance: float, start: Array, goal: Point, spacing: float
) -> Array:
    """Points of the line from a start to a goal, evenly spaced, shape ``(K, 2)`` [m].

    Args:
        obstacles: What it keeps away from; one of them is a grid.
        distance: By how much [m].
        start: Where it begins, shape ``(2,)`` [m].
        goal: Where it ends (x, y) [m].
        spacing: Largest distance of two points [m].

    Returns:
        Nothing, shape ``(0, 2)``, where no line leads.
    """
    field = _field(obstacles)
    cells = cells_from(_lengths(obstacles, distance, goal), node_near(field, start))
    if not len(cells):
        return np.empty((0, 2))
    line = np.vstack([start, node_points(field, cells[1:-1]), goal])
    passes = math.ceil((_SMOOTHED / float(field.frame['cell'][0])) ** 2)
    return evenly_spaced(line, spacing, passes)


def map_lengths(obstacles: tuple[Shape, ...], distance: float, points: Array, goal: Point) -> Array:
    """Lengths of the lines from points to a goal, longer where it is narrow, ``(K,)`` [m].

    Arguments as of `map_line`; points of shape ``(K, 2)``.
    """
    field = _field(obstacles)
    lengths = _lengths(obstacles, distance, goal)
    nodes = np.array([node_near(field, point) for point in points])
    found: Array = lengths[tuple(nodes.T)] * field.frame['cell'][0]
    return found


# One search is for all control steps on the way to a goal.
@lru_cache(maxsize=8)
def _lengths(obstacles: tuple[Shape, ...], distance: float, goal: Point) -> Array:
    field = _field(obstacles)
    clearance = field.distances - distance
    if others := [each for each in obstacles if not isinstance(each, GridObstacle)]:
        nodes = np.indices(clearance.shape).reshape(2, -1).T
        poses = np.column_stack([node_points(field, nodes), np.zeros(len(nodes))])
        around = FreeSpace.of(OpenFloor(), others, distance).at(poses)[:, 2:].min(axis=1)
        clearance = np.minimum(clearance, around.reshape(clearance.shape))
    costs = costs_of(clearance)
    costs[(clearance < 0.0) & (clearance > -_PART * distance)] = _TOO_NEAR
    return lengths_to(costs, node_near(field, np.array(goal)))


def _field(obstacles: tuple[Shape, ...]) -> DistanceField:
    return next(each.field for each in obstacles if isinstance(each, GridObstacle))
