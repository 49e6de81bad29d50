"""Shortest lengths to a cell of a grid, over cells that cost more where there is less clearance."""

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from cmpsp_ros.arrays import Array, BoolArray, IntArray
from cmpsp_ros.mpsp.jit import allocation_free

Links = NDArray[np.int32]

NARROW: Final = 2.0  # by how much more a cell costs where there is no clearance to spare
ROOM: Final = 0.4  # clearance below which a cell costs more [m]

_NONE: Final = -1
NEIGHBOURS: Final = np.array(
    [[-1, -1], [-1, 0], [-1, 1], [0, -1], [0, 1], [1, -1], [1, 0], [1, 1]], dtype=np.int64
)
"""Rows and columns from a cell to those beside it."""
STEPS: Final = np.hypot(*NEIGHBOURS.T)  # lengths of these steps [cells]


def costs_of(clearance: Array) -> Array:
    """Cost of each cell by its clearance [m], infinite where it is not clear."""
    costs = 1.0 + NARROW * np.clip(1.0 - clearance / ROOM, 0.0, 1.0)
    return np.where(clearance < 0.0, math.inf, costs)


def lengths_to(costs: Array, goal: IntArray) -> Array:
    """Path lengths from all cells to one, weighted by cost, infinite where there is none [cells].

    Dijkstra's algorithm with buckets (Dial, Comm. ACM 12, 1969): no step costs less than the width
    of one, 1, so that the order in a bucket does not matter. Costs are at least 1.
    """
    lengths = np.full((costs.shape[0] + 2, costs.shape[1] + 2), math.inf)
    walled = np.pad(costs, 1, constant_values=math.inf)
    largest = np.max(costs, where=np.isfinite(costs), initial=1.0)
    count = math.ceil(math.sqrt(2.0) * largest) + 2
    # A power of two: the remainder is found by a mask.
    buckets = np.full(1 << count.bit_length(), _NONE)
    links = np.empty((walled.size, 2), dtype=np.int32)
    offsets = NEIGHBOURS @ np.array([walled.shape[1], 1])
    first = int((goal[0] + 1) * walled.shape[1] + goal[1] + 1)
    _spread(lengths.reshape(-1), walled.reshape(-1), offsets, STEPS, buckets, links, first)
    return np.ascontiguousarray(lengths[1:-1, 1:-1])


def cells_from(lengths: Array, start: IntArray) -> IntArray:
    """Cells of the shortest way from one, shape ``(K, 2)``; none where no way leads."""
    places = np.empty((lengths.size, 2), dtype=np.int64)
    return places[: _descend(places, lengths, NEIGHBOURS, int(start[0]), int(start[1]))]


def led_out(lengths: Array, marked: BoolArray, cost: float, steps: int) -> Array:
    """Lengths over at most so many marked cells more, each at a `cost`; on the rim none is."""
    rows, columns = np.nonzero(marked[1:-1, 1:-1])
    cells = (rows + 1) * lengths.shape[1] + columns + 1
    offsets = NEIGHBOURS @ np.array([lengths.shape[1], 1])
    found = lengths.copy()
    found.reshape(-1)[cells] = math.inf
    _lead_out(found.reshape(-1), cells, np.empty(len(cells)), offsets, STEPS * cost, steps)
    return np.minimum(found, lengths)


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
def _descend(places: IntArray, lengths: Array, neighbours: IntArray, row: int, column: int) -> int:
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
def _lead_out(
    lengths: Array, cells: IntArray, shorter: Array, offsets: IntArray, costs: Array, steps: int
) -> None:
    """Shorten the lengths of cells by those of their neighbours, all at once in each step."""
    for _ in range(steps):
        for c in range(cells.shape[0]):
            shorter[c] = lengths[cells[c]]
            for k in range(offsets.shape[0]):
                shorter[c] = min(shorter[c], lengths[cells[c] + offsets[k]] + costs[k])
        for c in range(cells.shape[0]):
            lengths[cells[c]] = shorter[c]


@allocation_free
def _spread(
    lengths: Array,
    costs: Array,
    offsets: IntArray,
    steps: Array,
    buckets: IntArray,
    links: Links,
    goal: int,
) -> None:
    """Fill in the lengths, bucket after bucket."""
    waiting, bucket, mask = 1, 0, buckets.shape[0] - 1
    lengths[goal] = 0.0
    _put(buckets, links, 0, goal)
    while waiting > 0:
        cell = buckets[bucket]
        if cell == _NONE:
            bucket = (bucket + 1) & mask
            continue
        _take(buckets, links, bucket, cell)
        waiting -= 1
        here = lengths[cell]
        for k in range(offsets.shape[0]):
            other = cell + offsets[k]
            length, before = here + steps[k] * costs[other], lengths[other]
            if not length < before:
                continue
            if math.isinf(before):
                waiting += 1
            else:
                _take(buckets, links, int(before) & mask, other)
            lengths[other] = length
            _put(buckets, links, int(length) & mask, other)


@allocation_free
def _put(buckets: IntArray, links: Links, bucket: int, cell: int) -> None:
    first = buckets[bucket]
    links[cell, 0], links[cell, 1] = _NONE, first
    if first != _NONE:
        links[first, 0] = cell
    buckets[bucket] = cell


@allocation_free
def _take(buckets: IntArray, links: Links, bucket: int, cell: int) -> None:
    before, after = links[cell, 0], links[cell, 1]
    if before == _NONE:
        buckets[bucket] = after
    else:
        links[before, 1] = after
    if after != _NONE:
        links[after, 0] = before
