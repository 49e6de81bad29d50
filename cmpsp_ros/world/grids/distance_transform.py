"""Exact signed distances from marked cells, for compiled code (Felzenszwalb, Huttenlocher 2012).

A marked cell is a closed square. Seen from the centre of another cell its nearest point is on the
lattice of centres, corners and middles of edges. Distances are in units of that lattice, of half a
cell, and their squares whole numbers.
"""

from __future__ import annotations

import math

import numpy as np

from cmpsp_ros.arrays import Array, BoolArray, IntArray
from cmpsp_ros.mpsp.jit import allocation_free

Flags = BoolArray
Indices = IntArray


def signed_distances(marked: Flags) -> Array:
    """Distance of the centre of each cell from the nearest cell of the other kind.

    Args:
        marked: Which cells are, shape ``(rows, columns)``.

    Returns:
        Not positive in marked cells, infinite without any of the other kind; shape
        ``(rows, columns)`` [cells].
    """
    distances, edges = np.empty(marked.shape), marked.shape[1] + 1
    work = np.empty(edges), np.empty(edges + 1), np.empty(edges, dtype=np.int64)
    _transform(distances, np.ascontiguousarray(marked), *work)
    return distances


@allocation_free
def _transform(
    distances: Array, marked: Flags, heights: Array, begins: Array, lowest: Indices
) -> None:
    """Fill in the distances, first along columns, then along rows.

    Between two cells of the other kind in a row, nothing beyond these two is nearest.

    Args:
        distances: Where they go, shape ``(rows, columns)``.
        marked: Shape ``(rows, columns)``.
        heights: To work with, shape ``(columns + 1,)``.
        begins: To work with, shape ``(columns + 2,)``.
        lowest: To work with, shape ``(columns + 1,)``.
    """
    _along_columns(distances, marked)
    rows, columns = marked.shape
    for i in range(rows):
        first = 0
        for j in range(1, columns + 1):
            if j == columns or marked[i, j] != marked[i, first]:
                _along_run(distances, marked[i, first], i, first, j, heights, begins, lowest)
                first = j


@allocation_free
def _along_columns(distances: Array, marked: Flags) -> None:
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
    distances: Array,
    is_marked: bool,
    i: int,
    first: int,
    end: int,
    heights: Array,
    begins: Array,
    lowest: Indices,
) -> None:
    """Distances of a run of cells of one kind, from those in their columns [cells]."""
    before = 0.0 if first > 0 else math.inf
    for j in range(first, end):
        away = distances[i, j] * distances[i, j]
        heights[j], before = min(before, away), away
    heights[end] = 0.0 if end < distances.shape[1] else before
    count = _envelope(heights, first, end, begins, lowest)
    j = first
    for k in range(count):
        lowest_k, height = lowest[k], heights[lowest[k]]
        while j < end and not begins[k + 1] < j + 0.5:
            away = 2.0 * (j - lowest_k) + 1.0
            distances[i, j] = min(distances[i, j], math.sqrt(height + away * away))
            j += 1
    sign = -0.5 if is_marked else 0.5
    for j in range(first, end):
        distances[i, j] = sign * distances[i, j]


@allocation_free
def _envelope(heights: Array, first: int, end: int, begins: Array, lowest: Indices) -> int:
    """Which parabolas ``heights[p] + 4 (x - p)^2`` are lowest somewhere, and from where on."""
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
