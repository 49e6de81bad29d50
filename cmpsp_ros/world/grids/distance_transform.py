"""The distance to the occupied cells of a grid at the centres of all its cells."""

import math
from typing import Final

import numpy as np

from cmpsp_ros.arrays import Array, BoolArray, IntArray
from cmpsp_ros.mpsp.jit import allocation_free
from cmpsp_ros.world.grids.field_functions import FRAME, DistanceField
from cmpsp_ros.world.grids.occupancy_grid import Cell, OccupancyGrid, is_free

AROUND: Final = 2  # cells that a field has around its grid
_FAR: Final = 1e4  # distance where nothing is occupied, or nothing free [cells]


def distance_field(grid: OccupancyGrid, *, unknown_is_free: bool = False) -> DistanceField:
    """Signed distance from occupied cells; so are unknown ones and all beyond, or they are free."""
    inner = grid.cells == Cell.OCCUPIED if unknown_is_free else ~is_free(grid.cells)
    rows, columns = inner.shape
    occupied = np.full((rows + 2 * AROUND, columns + 2 * AROUND), not unknown_is_free)
    occupied[AROUND:-AROUND, AROUND:-AROUND] = inner
    frame = np.zeros(1, FRAME)
    outermost = np.array(-AROUND)
    frame['x'], frame['y'] = grid.centers(outermost, outermost)
    frame['cosine'], frame['sine'] = math.cos(grid.origin[2]), math.sin(grid.origin[2])
    frame['cell'], frame['is_free_beyond'] = grid.resolution, unknown_is_free
    distances = signed_distances(occupied)
    if math.isinf(distances[0, 0]):
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


def signed_distances(marked: BoolArray) -> Array:
    """Distances [cells] from the nearest cell of the other kind, not positive in marked ones."""
    distances, edges = np.empty(marked.shape), marked.shape[1] + 1
    work = np.empty(edges), np.empty(edges + 1), np.empty(edges, dtype=np.int64)
    _transform(distances, np.ascontiguousarray(marked), *work)
    return distances


@allocation_free
def _transform(
    distances: Array, marked: BoolArray, heights: Array, begins: Array, lowest: IntArray
) -> None:
    """Fill in the distances, first along columns, then along rows."""
    _along_columns(distances, marked)
    rows, columns = marked.shape
    for i in range(rows):
        first = 0
        for j in range(1, columns + 1):
            if j == columns or marked[i, j] != marked[i, first]:
                _along_run(distances[i], first, j, heights, begins, lowest)
                first = j
    # All roots at once are vector instructions.
    for i in range(rows):
        for j in range(columns):
            distances[i, j] = (-0.5 if marked[i, j] else 0.5) * math.sqrt(distances[i, j])


@allocation_free
def _along_columns(distances: Array, marked: BoolArray) -> None:
    """Distances from the cells of the other kind in the same column [half cells]."""
    rows, columns = marked.shape
    distances[0] = math.inf
    for i in range(1, rows):
        for j in range(columns):
            further = distances[i - 1, j] + 2.0
            distances[i, j] = further if marked[i, j] == marked[i - 1, j] else 1.0
    for back in range(1, rows):
        i = rows - 1 - back
        for j in range(columns):
            further = distances[i + 1, j] + 2.0
            nearer = further if marked[i, j] == marked[i + 1, j] else 1.0
            distances[i, j] = min(distances[i, j], nearer)


@allocation_free
def _along_run(
    row: Array, first: int, end: int, heights: Array, begins: Array, lowest: IntArray
) -> None:
    """Squares of the distances of a run of cells of one kind, from those in their columns."""
    before = 0.0 if first > 0 else math.inf
    for j in range(first, end):
        row[j] = row[j] * row[j]
        heights[j], before = min(before, row[j]), row[j]
    heights[end] = 0.0 if end < len(row) else before
    count = _envelope(heights, first, end, begins, lowest)
    j = first
    for k in range(count):
        lowest_k, height = lowest[k], heights[lowest[k]]
        while j < end and not begins[k + 1] < j + 0.5:
            away = 2.0 * (j - lowest_k) + 1.0
            row[j] = min(row[j], height + away * away)
            j += 1


@allocation_free
def _envelope(heights: Array, first: int, end: int, begins: Array, lowest: IntArray) -> int:
    """Compute the lower envelope of parabolas ``heights[p] + 4 (x - p)^2`` and its breakpoints."""
    count = 0
    for p in range(first, end + 1):
        if heights[p] == math.inf:
            continue
        begin = -math.inf
        while count > 0:
            q = lowest[count - 1]
            begin = (heights[p] - heights[q]) / (8.0 * (p - q)) + (p + q) / 2.0
            if begin > begins[count - 1]:
                break
            count -= 1
        if count == 0:
            begin = -math.inf
        begins[count], lowest[count] = begin, p
        count += 1
    begins[count] = math.inf
    return count
