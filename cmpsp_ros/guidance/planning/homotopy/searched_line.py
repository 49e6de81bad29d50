"""The shortest clear line on a grid, for where no way leads ahead station by station.

A robot in a dead end has to turn back first, and one whose goal is in a dead end to go beyond it.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from cmpsp_ros.guidance.planning.homotopy.road_frame import SPACING
from cmpsp_ros.mpsp.jit.compiled import allocation_free
from cmpsp_ros.world.free_space import FreeSpace

Array = NDArray[np.float64]

# Cells of the grid, at least and at most so many along either side [m], and what it has beside
# start, goal and shapes [m].
_CELL: Final = 0.1
_MAX_CELLS: Final = 160
_AROUND: Final = 1.0
# A cell costs up to so much more where there is less clearance than this [m].
_ROOM: Final = 0.4
_NARROW: Final = 2.0
_SMOOTHINGS: Final = 6
_NEIGHBOURS: Final = np.array(
    [[-1, -1], [-1, 0], [-1, 1], [0, -1], [0, 1], [1, -1], [1, 0], [1, 1]], dtype=np.int64
)


def searched_line(space: FreeSpace, start: Array, goal: Array) -> Array:
    """Points of a line from start to goal, evenly spaced, shape ``(K, 2)`` [m].

    Args:
        space: What it keeps to.
        start: Where it begins, shape ``(2,)`` [m].
        goal: Where it ends, shape ``(2,)`` [m].

    Returns:
        Nothing, shape ``(0, 2)``, where no line is clear.
    """
    reached = np.repeat(space.reaches + space.radii, 2).reshape(-1, 2)
    marks = np.vstack([start, goal, space.centers - reached, space.centers + reached])
    low, high = np.nanmin(marks, axis=0) - _AROUND, np.nanmax(marks, axis=0) + _AROUND
    cell = max(_CELL, float((high - low).max()) / _MAX_CELLS)
    across, up = (np.arange(low[axis], high[axis], cell) for axis in range(2))
    points = np.stack(np.meshgrid(across, up, indexing='ij'), axis=-1)
    poses = np.column_stack([points.reshape(-1, 2), np.full(points[..., 0].size, math.nan)])
    clearance = space.at(poses).min(axis=1).reshape(points.shape[:2])
    first, last = (np.round((each - low) / cell).astype(np.int64) for each in (start, goal))
    costs = 1.0 + _NARROW * np.clip(1.0 - clearance / _ROOM, 0.0, 1.0)
    costs[clearance < 0.0] = math.inf
    # Where the robot stands, and where it is to stand, is not for the search to judge.
    for place in (first, last):
        costs[tuple(place)] = min(costs[tuple(place)], 1.0 + _NARROW)
    lengths = np.full(costs.shape, math.inf)
    lengths[tuple(last)] = 0.0
    while _sweep(lengths, costs, _NEIGHBOURS):
        pass
    if not math.isfinite(lengths[tuple(first)]):
        return np.empty((0, 2))
    places = [first]
    while lengths[tuple(places[-1])] > 0.0:
        beside = places[-1] + _NEIGHBOURS
        beside = beside[((beside >= 0) & (beside < costs.shape)).all(axis=1)]
        places.append(beside[np.argmin(lengths[beside[:, 0], beside[:, 1]])])
    inner = [points[tuple(each)] for each in places[1:-1]]
    return _even(np.array([start, *inner, goal]))


def _even(line: Array) -> Array:
    """The line with corners smoothed, at even distances."""
    for _ in range(_SMOOTHINGS):
        line[1:-1] += (line[:-2] - 2.0 * line[1:-1] + line[2:]) / 4.0
    along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(line, axis=0).T))])
    at = np.linspace(0.0, along[-1], max(math.ceil(along[-1] / SPACING), 1) + 1)
    return np.column_stack([np.interp(at, along, each) for each in line.T])


@allocation_free
def _sweep(lengths: Array, costs: Array, neighbours: NDArray[np.int64]) -> bool:
    """Shorten the lengths to the goal over the grid, in four orders; whether any has changed."""
    rows, columns, changed = lengths.shape[0], lengths.shape[1], False
    for order in range(4):
        for a in range(rows):
            i = a if order % 2 == 0 else rows - 1 - a
            for b in range(columns):
                j = b if order < 2 else columns - 1 - b
                if math.isinf(costs[i, j]):
                    continue
                best = lengths[i, j]
                for k in range(neighbours.shape[0]):
                    m, n = i + neighbours[k, 0], j + neighbours[k, 1]
                    if 0 <= m < rows and 0 <= n < columns:
                        step = math.sqrt(float(neighbours[k, 0] ** 2 + neighbours[k, 1] ** 2))
                        best = min(best, lengths[m, n] + step * costs[i, j])
                if best < lengths[i, j]:
                    lengths[i, j], changed = best, True
    return changed
