"""Groups of occupied cells that a way may pass on either side."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from cmpsp_ros.arrays import BoolArray, IntArray
from cmpsp_ros.mpsp.jit import allocation_free

Flags = BoolArray
Indices = IntArray

_MOST: Final = 24


def islands_of(occupied: Flags) -> tuple[Indices, Indices]:
    """Rows and columns of the middlemost cell of each group that does not touch the rim.

    Args:
        occupied: Shape ``(rows, columns)``. Of its groups, which hang together at corners too, the
            largest count.
    """
    cells = np.empty(np.count_nonzero(occupied), dtype=np.int64)
    middles, sizes = np.empty_like(cells), np.empty_like(cells)
    count = _collect(middles, sizes, cells, occupied.copy())
    largest = np.argsort(-sizes[:count], kind='stable')[:_MOST]
    rows, columns = np.divmod(middles[largest], occupied.shape[1])
    return rows, columns


@allocation_free
def _collect(middles: Indices, sizes: Indices, cells: Indices, left: Flags) -> int:
    """Fill in the groups, in the order of their first cells; how many there are.

    Args:
        middles: Number of the middlemost cell of each, counted row by row.
        sizes: How many cells each has.
        cells: To work with.
        left: Which cells are occupied; false in the end.
    """
    rows, columns = left.shape
    count = 0
    for i in range(rows):
        for j in range(columns):
            if not left[i, j]:
                continue
            left[i, j], cells[0], size, is_inner = False, i * columns + j, 1, True
            at = row_sum = column_sum = 0
            while at < size:
                row, column = cells[at] // columns, cells[at] % columns
                row_sum, column_sum, at = row_sum + row, column_sum + column, at + 1
                is_inner &= 0 < row < rows - 1 and 0 < column < columns - 1
                for m in range(max(row - 1, 0), min(row + 2, rows)):
                    for n in range(max(column - 1, 0), min(column + 2, columns)):
                        if left[m, n]:
                            left[m, n], cells[size] = False, m * columns + n
                            size += 1
            if is_inner:
                middle = _nearest(cells, size, columns, row_sum / size, column_sum / size)
                middles[count], sizes[count] = middle, size
                count += 1
    return count


@allocation_free
def _nearest(cells: Indices, size: int, columns: int, row: float, column: float) -> int:
    """The first of the cells that are nearest to a place."""
    nearest, least = 0, math.inf
    for k in range(size):
        away_row, away_column = cells[k] // columns - row, cells[k] % columns - column
        away = away_row * away_row + away_column * away_column
        if away < least or (away == least and cells[k] < nearest):
            nearest, least = cells[k], away
    return nearest
