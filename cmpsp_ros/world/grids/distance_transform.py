"""Exact distances of cells from marked ones, for compiled code (Felzenszwalb, Huttenlocher 2012).

A marked cell is a closed square. Seen from the centre of another cell its nearest point is on the
lattice of centres, corners and middles of edges. Distances are in units of that lattice, of half a
cell, and their squares whole numbers.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from cmpsp_ros.mpsp.jit.compiled import allocation_free

Array = NDArray[np.float64]
Indices = NDArray[np.int64]


def distances_from(marked: NDArray[np.bool_]) -> Array:
    """Distance of the centre of each cell from the nearest marked cell, 0 in one, else infinite.

    Args:
        marked: Which cells are, shape ``(rows, columns)``.

    Returns:
        Shape ``(rows, columns)`` [cells].
    """
    squared, edges = np.empty(marked.shape), marked.shape[0] + 1
    work = np.empty(edges), np.empty(edges + 1), np.empty(edges, dtype=np.int64)
    _transform(squared, np.ascontiguousarray(marked), *work)
    return np.sqrt(squared) / 2.0


@allocation_free
def _transform(
    squared: Array, marked: NDArray[np.bool_], heights: Array, begins: Array, lowest: Indices
) -> None:
    """Squares of the distances, first along rows, then along columns from the edges of rows.

    Args:
        squared: Where they go, shape ``(rows, columns)``.
        marked: Shape ``(rows, columns)``.
        heights: To work with, shape ``(rows + 1,)``.
        begins: To work with, shape ``(rows + 2,)``.
        lowest: To work with, shape ``(rows + 1,)``.
    """
    rows, columns = marked.shape
    for i in range(rows):
        _along_row(squared, marked, i)
    for j in range(columns):
        heights[0], heights[rows] = squared[0, j], squared[rows - 1, j]
        for i in range(1, rows):
            heights[i] = min(squared[i - 1, j], squared[i, j])
        if _envelope(heights, begins, lowest) == 0:
            continue
        k = 0
        for i in range(rows):
            while begins[k + 1] < i + 0.5:
                k += 1
            away = 2.0 * (i - lowest[k]) + 1.0
            squared[i, j] = min(squared[i, j], heights[lowest[k]] + away * away)


@allocation_free
def _along_row(squared: Array, marked: NDArray[np.bool_], i: int) -> None:
    """Squares of the distances from the marked cells of the same row."""
    columns = marked.shape[1]
    away = math.inf
    for j in range(columns):
        away = 0.0 if marked[i, j] else away + 2.0 if away > 0.0 else 1.0
        squared[i, j] = away * away
    away = math.inf
    for back in range(columns):
        j = columns - 1 - back
        away = 0.0 if marked[i, j] else away + 2.0 if away > 0.0 else 1.0
        squared[i, j] = min(squared[i, j], away * away)


@allocation_free
def _envelope(heights: Array, begins: Array, lowest: Indices) -> int:
    """Which parabolas ``heights[p] + 4 (x - p)^2`` are lowest somewhere, and from where on."""
    count = 0
    for p in range(heights.shape[0]):
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
