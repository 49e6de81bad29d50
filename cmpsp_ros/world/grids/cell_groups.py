"""Groups of cells that hang together, at corners too."""

import math
from typing import Final

import numpy as np

from cmpsp_ros.arrays import BoolArray, IntArray
from cmpsp_ros.mpsp.jit import allocation_free

_MOST: Final = 24


def islands_of(occupied: BoolArray) -> tuple[IntArray, IntArray]:
    """Rows and columns of the middlemost cell of the largest groups that do not touch the rim.

    `occupied` ``(rows, columns)``.
    """
    cells, ends, count = _groups(occupied)
    middles, sizes = np.empty(count, dtype=np.int64), np.empty(count, dtype=np.int64)
    count = _find_islands(middles, sizes, cells, ends, *occupied.shape)
    largest = np.argsort(-sizes[:count], kind='stable')[:_MOST]
    rows, columns = np.divmod(middles[largest], occupied.shape[1])
    return rows, columns


def small_groups(occupied: BoolArray, least: int, most: int) -> list[IntArray]:
    """Rows and columns ``(K, 2)`` of groups off the rim whose longer side has so many cells."""
    cells, ends, count = _groups(occupied)
    chosen = np.zeros(count, dtype=np.bool_)
    rows, columns = occupied.shape
    _choose_small(chosen, cells, ends, rows, columns, least, most)
    groups = np.split(cells, ends[: count - 1]) if chosen.any() else []
    return [np.column_stack(np.divmod(groups[k], columns)) for k in np.flatnonzero(chosen).tolist()]


def _groups(occupied: BoolArray) -> tuple[IntArray, IntArray, int]:
    """Cells as ``row * columns + column`` group by group, where each ends, and how many."""
    cells = np.empty(np.count_nonzero(occupied), dtype=np.int64)
    ends = np.empty_like(cells)
    return cells, ends, _collect(cells, ends, occupied.copy())


@allocation_free
def _collect(cells: IntArray, ends: IntArray, left: BoolArray) -> int:
    """Fill in the groups, in the order of their first cells; how many there are."""
    rows, columns = left.shape
    count = at = size = 0
    for i in range(rows):
        for j in range(columns):
            if not left[i, j]:
                continue
            left[i, j], cells[size] = False, i * columns + j
            size += 1
            while at < size:
                row, column = cells[at] // columns, cells[at] % columns
                at += 1
                for m in range(max(row - 1, 0), min(row + 2, rows)):
                    for n in range(max(column - 1, 0), min(column + 2, columns)):
                        if left[m, n]:
                            left[m, n], cells[size] = False, m * columns + n
                            size += 1
            ends[count] = size
            count += 1
    return count


@allocation_free
def _find_islands(
    middles: IntArray, sizes: IntArray, cells: IntArray, ends: IntArray, rows: int, columns: int
) -> int:
    """Fill in the middlemost cell and the size of each group off the rim; how many there are."""
    count = begin = 0
    for k in range(middles.shape[0]):
        end, row_sum, column_sum, is_inner = ends[k], 0, 0, True
        for at in range(begin, end):
            row, column = cells[at] // columns, cells[at] % columns
            row_sum, column_sum = row_sum + row, column_sum + column
            is_inner &= 0 < row < rows - 1 and 0 < column < columns - 1
        if is_inner:
            size = end - begin
            middles[count] = _nearest(cells, begin, end, columns, row_sum / size, column_sum / size)
            sizes[count] = size
            count += 1
        begin = end
    return count


@allocation_free
def _nearest(cells: IntArray, begin: int, end: int, columns: int, row: float, column: float) -> int:
    """The first of the cells that are nearest to a place."""
    nearest, least = 0, math.inf
    for k in range(begin, end):
        away_row, away_column = cells[k] // columns - row, cells[k] % columns - column
        away = away_row * away_row + away_column * away_column
        if away < least or (away == least and cells[k] < nearest):
            nearest, least = cells[k], away
    return nearest


@allocation_free
def _choose_small(
    chosen: BoolArray,
    cells: IntArray,
    ends: IntArray,
    rows: int,
    columns: int,
    least: int,
    most: int,
) -> None:
    """Mark the groups off the rim whose longer side has `least` to `most` cells."""
    begin = 0
    for k in range(chosen.shape[0]):
        low = left = rows + columns
        high = right = -1
        for at in range(begin, ends[k]):
            row, column = cells[at] // columns, cells[at] % columns
            low, high = min(low, row), max(high, row)
            left, right = min(left, column), max(right, column)
        begin = ends[k]
        is_inner = min(low, left) > 0 and high < rows - 1 and right < columns - 1
        chosen[k] = is_inner and least <= max(high - low, right - left) + 1 <= most
