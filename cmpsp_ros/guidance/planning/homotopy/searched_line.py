"""The shortest clear line on a grid, for where no way leads ahead station by station.

A robot in a dead end has to turn back first, and one whose goal is in a dead end to go beyond it.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from cmpsp_ros.arrays import Array
from cmpsp_ros.guidance.planning.homotopy.road_frame import SPACING
from cmpsp_ros.world import FreeSpace
from cmpsp_ros.world.grids import NARROW, cells_from, costs_of, evenly_spaced, lengths_to

# Cells of the grid, at least and at most so many along either side [m], and what it has beside
# start, goal and shapes [m].
_CELL: Final = 0.1
_MAX_CELLS: Final = 160
_AROUND: Final = 1.0
_SMOOTHINGS: Final = 6


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
    # Where half a cell is longer than `_AROUND`, an end may round to beyond the last node.
    ends = (np.round((each - low) / cell).astype(np.int64) for each in (start, goal))
    first, last = (np.minimum(each, np.array(clearance.shape) - 1) for each in ends)
    costs = costs_of(clearance)
    # Where the robot stands, and where it is to stand, is not for the search to judge.
    for place in (first, last):
        costs[tuple(place)] = min(costs[tuple(place)], 1.0 + NARROW)
    places = cells_from(lengths_to(costs, last), first)
    if not len(places):
        return np.empty((0, 2))
    inner = points[tuple(places[1:-1].T)]
    return evenly_spaced(np.vstack([start, inner, goal]), SPACING, _SMOOTHINGS)
