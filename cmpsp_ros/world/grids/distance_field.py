"""The distance to the occupied cells of a grid at the centres of all its cells."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from cmpsp_ros.arrays import Array, IntArray
from cmpsp_ros.world.grids.distance_transform import signed_distances
from cmpsp_ros.world.grids.field_functions import FRAME, DistanceField
from cmpsp_ros.world.grids.occupancy_grid import Cell, OccupancyGrid

AROUND: Final = 2
"""Cells that a field has around its grid."""

_FAR: Final = 1e4
"""Distance where nothing is occupied, or nothing free [cells]."""


def distance_field(grid: OccupancyGrid, *, unknown_is_free: bool = False) -> DistanceField:
    """Signed distance from the occupied cells, which are closed squares.

    Args:
        grid: The grid.
        unknown_is_free: Whether cells that are unknown, and all beyond the grid, are free; else
            they are occupied.
    """
    inner = grid.cells == Cell.OCCUPIED if unknown_is_free else grid.cells != Cell.FREE
    rows, columns = inner.shape
    occupied = np.full((rows + 2 * AROUND, columns + 2 * AROUND), not unknown_is_free)
    occupied[AROUND:-AROUND, AROUND:-AROUND] = inner
    frame = np.zeros(1, FRAME)
    outermost = np.array(-AROUND)
    frame['x'], frame['y'] = grid.centers(outermost, outermost)
    frame['cosine'], frame['sine'] = math.cos(grid.origin[2]), math.sin(grid.origin[2])
    frame['cell'], frame['is_free_beyond'] = grid.resolution, unknown_is_free
    distances = signed_distances(occupied)
    np.clip(distances, -_FAR, _FAR, out=distances)
    distances *= grid.resolution
    return DistanceField(frame, distances)


def node_points(field: DistanceField, nodes: IntArray) -> Array:
    """Places of nodes, by their rows and columns ``(K, 2)``; shape ``(K, 2)`` [m]."""
    frame, (rows, columns) = field.frame[0], nodes.T * field.frame['cell'][0]
    return np.column_stack(
        [
            frame['x'] + frame['cosine'] * columns - frame['sine'] * rows,
            frame['y'] + frame['sine'] * columns + frame['cosine'] * rows,
        ]
    )


def nodes_near(field: DistanceField, points: Array) -> IntArray:
    """Rows and columns of the nodes that are nearest to points ``(..., 2)`` [m], of their shape."""
    frame = field.frame[0]
    offsets = (points - np.array([frame['x'], frame['y']])) / frame['cell']
    dx, dy = offsets[..., 0], offsets[..., 1]
    along = frame['cosine'] * dx + frame['sine'] * dy
    up = frame['cosine'] * dy - frame['sine'] * dx
    last = np.array(field.distances.shape) - 1
    return np.clip(np.round(np.stack([up, along], axis=-1)), 0, last).astype(np.int64)
