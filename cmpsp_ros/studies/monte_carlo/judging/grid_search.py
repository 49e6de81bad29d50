"""The shortest clear path on a grid: an initial guess for solvers on any road."""

from __future__ import annotations

import math

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import dijkstra

from cmpsp_ros.arrays import Array
from cmpsp_ros.guidance import GuidanceSettings
from cmpsp_ros.world import FreeSpace

_CELL = 0.08
_AROUND = 3.0
_NEIGHBOURS = ((1, 0), (0, 1), (1, 1), (1, -1))


def grid_path(settings: GuidanceSettings, pose: Array, spare: float) -> Array:
    """Points from a pose to the goal, shape ``(K, 2)`` [m]; none where no path is clear.

    Args:
        settings: Road, obstacles, goal and margin.
        pose: Initial pose, shape ``(3,)`` [m, m, rad].
        spare: Additional clearance of the path [m].
    """
    ends = np.array([pose[:2], settings.goal])
    low, high = ends.min(axis=0) - _AROUND, ends.max(axis=0) + _AROUND
    across, up = (np.arange(low[axis], high[axis], _CELL) for axis in range(2))
    points = np.stack(np.meshgrid(across, up, indexing='ij'), axis=-1)
    rows, columns = len(across), len(up)
    number = np.arange(rows * columns).reshape(rows, columns)
    distance = settings.robot_radius + settings.safety.margin + spare
    space = FreeSpace.of(settings.road, settings.obstacles, distance)
    cells = points.reshape(-1, 2)
    poses = np.column_stack([cells, np.full(len(cells), math.nan)])
    free = (space.at(poses).min(axis=1) > 0.0).reshape(number.shape)
    links = []
    for i, j in _NEIGHBOURS:
        here = np.s_[: rows - i, max(0, -j) : columns - max(0, j)]
        there = np.s_[i:, max(0, j) : columns + min(0, j)]
        both = free[here] & free[there]
        links.append((number[here][both], number[there][both], _CELL * math.hypot(i, j)))
    first, second = (np.concatenate([link[side] for link in links]) for side in (0, 1))
    weights = np.concatenate([np.full(len(link[0]), link[2]) for link in links])
    graph = coo_array((weights, (first, second)), shape=(number.size, number.size)).tocsr()
    begin, end = (int(((cells - each) ** 2).sum(axis=1).argmin()) for each in ends)
    found = dijkstra(graph, directed=False, indices=begin, return_predecessors=True)
    if not math.isfinite(found[0][end]):
        return np.empty((0, 2))
    path = [end]
    while path[-1] != begin:
        path.append(int(found[1][path[-1]]))
    return np.vstack([ends[:1], cells[path[-2:0:-1]], ends[1:]])


def shortest_length(settings: GuidanceSettings, pose: Array) -> float:
    """Length of the shortest clear path from a pose to the goal, or a little more [m].

    It is that on the grid, drawn taut: from each corner straight to the last point in sight.
    Infinite where no path is clear; arguments as of `grid_path`.
    """
    points = grid_path(settings, pose, 0.0)
    distance = settings.robot_radius + settings.safety.margin
    space = FreeSpace.of(settings.road, settings.obstacles, distance)
    here, length = 0, 0.0 if len(points) else math.inf
    while here < len(points) - 1:
        offsets = points[here + 1 :] - points[here]
        lengths, headings = np.hypot(*offsets.T), np.arctan2(offsets[:, 1], offsets[:, 0])
        begins = np.column_stack([np.tile(points[here], (len(offsets), 1)), headings])
        twists = np.column_stack([lengths, np.zeros(len(offsets))])
        clear = space.along(begins, twists, np.ones(len(offsets))).min(axis=1) >= 0.0
        farthest = int(np.flatnonzero(clear).max(initial=0))
        here, length = here + 1 + farthest, length + float(lengths[farthest])
    return length
