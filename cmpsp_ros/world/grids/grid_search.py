"""Shortest lengths to a cell of a grid, over cells that cost more where there is less clearance."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from cmpsp_ros.mpsp.jit.compiled import allocation_free

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

NARROW: Final = 2.0
"""By how much more a cell costs where there is no clearance to spare."""

# A cell costs more where there is less clearance than this [m].
_ROOM: Final = 0.4
_NONE: Final = -1
_NEIGHBOURS: Final = np.array(
    [[-1, -1], [-1, 0], [-1, 1], [0, -1], [0, 1], [1, -1], [1, 0], [1, 1]], dtype=np.int64
)


def costs_of(clearance: Array) -> Array:
    """What each cell costs, infinite where it is not clear, by its clearance [m]."""
    costs = 1.0 + NARROW * np.clip(1.0 - clearance / _ROOM, 0.0, 1.0)
    return np.where(clearance < 0.0, math.inf, costs)


def lengths_to(costs: Array, goal: Indices) -> Array:
    """Lengths from all cells to one, times what they cost, infinite where no way leads [cells].

    It is Dijkstra's algorithm with buckets (Dial, Comm. ACM 12, 1969): no step costs less than the
    width of a bucket, 1, so that the order of the cells in one does not matter.

    Args:
        costs: Of the cells, 1 at least, shape ``(rows, columns)``.
        goal: Row and column of that cell.
    """
    lengths = np.full(costs.shape, math.inf)
    finite = costs[np.isfinite(costs)]
    buckets = np.full(math.ceil(math.sqrt(2.0) * finite.max(initial=1.0)) + 2, _NONE)
    links = np.empty((2, costs.size), dtype=np.int64)
    _spread(lengths, costs, _NEIGHBOURS, buckets, links, int(goal[0]), int(goal[1]))
    return lengths


def cells_from(lengths: Array, start: Indices) -> Indices:
    """Cells of the shortest way from one, shape ``(K, 2)``; none where no way leads."""
    places = np.empty((lengths.size, 2), dtype=np.int64)
    return places[: _descend(places, lengths, _NEIGHBOURS, int(start[0]), int(start[1]))]


def evenly_spaced(line: Array, spacing: float, smoothings: int) -> Array:
    """A line with its corners smoothed, at even distances, not more than these [m]."""
    _smooth(line, smoothings)
    along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(line, axis=0).T))])
    at = np.linspace(0.0, along[-1], max(math.ceil(along[-1] / spacing), 1) + 1)
    return np.column_stack([np.interp(at, along, each) for each in line.T])


@allocation_free
def _smooth(line: Array, passes: int) -> None:
    for _ in range(passes):
        for axis in range(2):
            before = line[0, axis]
            for k in range(1, line.shape[0] - 1):
                here = line[k, axis]
                line[k, axis] = here + (before - 2.0 * here + line[k + 1, axis]) / 4.0
                before = here


@allocation_free
def _descend(places: Indices, lengths: Array, neighbours: Indices, row: int, column: int) -> int:
    """Fill in the cells of a way down to where the length is 0; how many there are."""
    if not math.isfinite(lengths[row, column]):
        return 0
    count = 1
    places[0, 0], places[0, 1] = row, column
    while lengths[row, column] > 0.0:
        best, i, j = math.inf, row, column
        for k in range(neighbours.shape[0]):
            m, n = row + neighbours[k, 0], column + neighbours[k, 1]
            inside = 0 <= m < lengths.shape[0] and 0 <= n < lengths.shape[1]
            if inside and lengths[m, n] < best:
                best, i, j = lengths[m, n], m, n
        row, column = i, j
        places[count, 0], places[count, 1] = row, column
        count += 1
    return count


@allocation_free
def _spread(
    lengths: Array,
    costs: Array,
    neighbours: Indices,
    buckets: Indices,
    links: Indices,
    row: int,
    column: int,
) -> None:
    """Fill in the lengths, bucket after bucket.

    Args:
        lengths: Infinite at first.
        costs: Of the cells.
        neighbours: Rows and columns from a cell to those beside it.
        buckets: Number of the first cell in each, `_NONE` at first.
        links: Numbers of the cells before and after each in its bucket, shape ``(2, cells)``.
        row: Of the goal.
        column: Of the goal.
    """
    columns, waiting, bucket = costs.shape[1], 1, 0
    lengths[row, column] = 0.0
    _put(buckets, links, 0, row * columns + column)
    while waiting > 0:
        cell = buckets[bucket]
        if cell == _NONE:
            bucket = (bucket + 1) % buckets.shape[0]
            continue
        _take(buckets, links, bucket, cell)
        waiting -= 1
        i, j = cell // columns, cell % columns
        for k in range(neighbours.shape[0]):
            m, n = i + neighbours[k, 0], j + neighbours[k, 1]
            if not (0 <= m < costs.shape[0] and 0 <= n < columns):
                continue
            step = math.sqrt(float(neighbours[k, 0] ** 2 + neighbours[k, 1] ** 2))
            length, before = lengths[i, j] + step * costs[m, n], lengths[m, n]
            if not length < before:
                continue
            if math.isinf(before):
                waiting += 1
            else:
                _take(buckets, links, int(before) % buckets.shape[0], m * columns + n)
            lengths[m, n] = length
            _put(buckets, links, int(length) % buckets.shape[0], m * columns + n)


@allocation_free
def _put(buckets: Indices, links: Indices, bucket: int, cell: int) -> None:
    first = buckets[bucket]
    links[0, cell], links[1, cell] = _NONE, first
    if first != _NONE:
        links[0, first] = cell
    buckets[bucket] = cell


@allocation_free
def _take(buckets: Indices, links: Indices, bucket: int, cell: int) -> None:
    before, after = links[0, cell], links[1, cell]
    if before == _NONE:
        buckets[bucket] = after
    else:
        links[1, before] = after
    if after != _NONE:
        links[0, after] = before
