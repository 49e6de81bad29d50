"""Beams through a grid, for compiled code. Coordinates are in cells, from the grid's corner.

A cell has what is known of it, when that was seen [ns], and where in it a beam ended.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cmpsp_ros.arrays import Array, BoolArray, IntArray
from cmpsp_ros.mpsp.jit import allocation_free, inner
from cmpsp_ros.world.grids import Cell

Cells = NDArray[np.uint8]
Stamps = IntArray
Places = NDArray[np.float32]
Flags = BoolArray

_FREE, _OCCUPIED = int(Cell.FREE), int(Cell.OCCUPIED)

_BESIDE = 0.25
"""How near to where a beam ended another one must pass to show that it is gone [cells]."""

_BEYOND = 4.0
"""How far beyond that place it must go on [cells]: one that grazes a wall does not."""


@allocation_free
def clear(
    cells: Cells,
    seen: Stamps,
    hits: Places,
    starts: Array,
    ends: Array,
    is_hit: Flags,
    stamp: int,
    is_sweep: bool,
) -> None:
    """Free what beams pass through.

    An occupied cell is freed only where a beam has passed close to the place that was hit, and
    well beyond it: else those that graze a wall would open it. In a sweep what is between two
    neighbours is seen as well, as far as the shorter one.

    Args:
        cells: Values of `Cell`, shape ``(rows, columns)``.
        seen: Shape ``(rows, columns)`` [ns].
        hits: Shape ``(rows, columns, 2)``.
        starts: Shape ``(B, 2)``.
        ends: Shape ``(B, 2)``.
        is_hit: Whether something is at the end of a beam, whose cell is not freed then.
        stamp: When the beams were measured [ns].
        is_sweep: See above; occupied cells are freed by a sweep only.
    """
    for i in range(starts.shape[0]):
        x, y, end_x, end_y = starts[i, 0], starts[i, 1], ends[i, 0], ends[i, 1]
        _clear_one(cells, seen, hits, x, y, end_x, end_y, is_hit[i], stamp, is_sweep)
        if not is_sweep or i + 1 == starts.shape[0]:
            continue
        along_x, along_y = end_x - x, end_y - y
        next_x, next_y = ends[i + 1, 0] - starts[i + 1, 0], ends[i + 1, 1] - starts[i + 1, 1]
        length = math.sqrt(along_x * along_x + along_y * along_y)
        next_length = math.sqrt(next_x * next_x + next_y * next_y)
        shorter = min(length, next_length)
        if shorter <= 0.0:
            continue
        along_x, along_y = along_x * shorter / length, along_y * shorter / length
        next_x, next_y = next_x * shorter / next_length, next_y * shorter / next_length
        apart = max(abs(next_x - along_x), abs(next_y - along_y))
        between = int(min(math.ceil(apart), 16.0)) if apart < shorter else 0
        for k in range(1, between):
            part = k / between
            from_x = x + part * (starts[i + 1, 0] - x)
            from_y = y + part * (starts[i + 1, 1] - y)
            to_x = from_x + along_x + part * (next_x - along_x)
            to_y = from_y + along_y + part * (next_y - along_y)
            # Nothing was measured along it: it frees what was unknown, and no more.
            _clear_one(cells, seen, hits, from_x, from_y, to_x, to_y, True, stamp, False)


@allocation_free
def mark(cells: Cells, seen: Stamps, hits: Places, ends: Array, is_hit: Flags, stamp: int) -> None:
    """Occupy the cells in which beams have hit something; arguments as of `clear`."""
    for i in range(ends.shape[0]):
        column, row = math.floor(ends[i, 0]), math.floor(ends[i, 1])
        if is_hit[i] and 0 <= row < cells.shape[0] and 0 <= column < cells.shape[1]:
            cells[row, column], seen[row, column] = _OCCUPIED, stamp
            hits[row, column, 0] = ends[i, 0] - column
            hits[row, column, 1] = ends[i, 1] - row


@inner
def _clear_one(
    cells: Cells,
    seen: Stamps,
    hits: Places,
    x: float,
    y: float,
    end_x: float,
    end_y: float,
    is_hit: bool,
    stamp: int,
    sees_gone: bool,
) -> None:
    """Walk from cell to cell along a beam, within the grid (Amanatides and Woo 1987)."""
    along_x, along_y = end_x - x, end_y - y
    length = math.sqrt(along_x * along_x + along_y * along_y)
    rows, columns = cells.shape
    first, last = _inside(x, along_x, columns, 0.0, 1.0)
    first, last = _inside(y, along_y, rows, first, last)
    if not (first < last and length > 0.0):
        return
    column = min(max(math.floor(x + first * along_x), 0), columns - 1)
    row = min(max(math.floor(y + first * along_y), 0), rows - 1)
    right, up = (1 if along_x > 0.0 else -1), (1 if along_y > 0.0 else -1)
    step_x = abs(1.0 / along_x) if along_x != 0.0 else math.inf
    step_y = abs(1.0 / along_y) if along_y != 0.0 else math.inf
    next_x = (column + (right > 0) - x) / along_x if along_x != 0.0 else math.inf
    next_y = (row + (up > 0) - y) / along_y if along_y != 0.0 else math.inf
    end_column, end_row = math.floor(end_x), math.floor(end_y)
    for _ in range(rows + columns):
        if is_hit and column == end_column and row == end_row:
            return
        if cells[row, column] != _OCCUPIED:
            cells[row, column], seen[row, column] = _FREE, stamp
        elif sees_gone:
            to_x = column + hits[row, column, 0] - x
            to_y = row + hits[row, column, 1] - y
            beside = abs(along_x * to_y - along_y * to_x) / length
            beyond = length - (along_x * to_x + along_y * to_y) / length
            if beside <= _BESIDE and beyond >= _BEYOND:
                cells[row, column], seen[row, column] = _FREE, stamp
        if next_x < next_y:
            column, after = column + right, next_x
            next_x += step_x
        else:
            row, after = row + up, next_y
            next_y += step_y
        if after >= last or not (0 <= row < rows and 0 <= column < columns):
            return


@inner
def _inside(start: float, along: float, size: int, first: float, last: float) -> Any:
    """The part of a beam between two edges of the grid, and within another part of it."""
    if along == 0.0:
        return (first, last) if 0.0 <= start < size else (1.0, 0.0)
    one, other = -start / along, (size - start) / along
    return max(first, min(one, other)), min(last, max(one, other))
