"""Exact distances along rays to edges and discs: what a laser scanner measures."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from itertools import pairwise

import numpy as np

from cmpsp_ros.arrays import Array
from cmpsp_ros.mpsp.jit import allocation_free
from cmpsp_ros.world.grids import GridObstacle
from cmpsp_ros.world.obstacles import Shape

# Two edges that share a corner must leave no gap there for a ray.
_OVERLAP = 1e-9


def edges_of(shapes: Sequence[Shape], lines: Iterable[Array] = ()) -> Array:
    """Straight edges of shapes, and those of lines.

    Args:
        shapes: Each with its radius around its corners.
        lines: Points of each, shape ``(K, 2)`` [m].

    Returns:
        Both ends of each edge (x, y, x, y), shape ``(S, 4)`` [m].
    """
    edges = []
    for shape in shapes:
        ring = [*shape.corners, shape.corners[0]] if len(shape.corners) > 1 else []
        for (ax, ay), (bx, by) in pairwise(ring):
            outward = shape.radius / math.hypot(bx - ax, by - ay)
            dx, dy = outward * (by - ay), outward * (ax - bx)
            edges.append((ax + dx, ay + dy, bx + dx, by + dy))
    maps = [each for each in shapes if isinstance(each, GridObstacle)]
    for line in [*lines, *(line for each in maps for line in each.walls())]:
        edges += [(*before, *after) for before, after in pairwise(line.tolist())]
    return np.array(edges, dtype=float).reshape(-1, 4)


def discs_of(shapes: Iterable[Shape]) -> Array:
    """Discs around the corners of shapes (x, y, vx, vy, radius), shape ``(D, 5)`` [m, m/s, m]."""
    discs = [
        (*corner, 0.0, 0.0, each.radius)
        for each in shapes
        if each.radius
        for corner in each.corners
    ]
    return np.array(discs, dtype=float).reshape(-1, 5)


@allocation_free
def cast(ranges: Array, rays: Array, times: Array, edges: Array, discs: Array) -> None:
    """Distance along each ray to the first edge or disc; infinite where there is none.

    Args:
        ranges: Where the distances go, shape ``(R,)`` [m].
        rays: Origin and heading of each (x, y, heading), shape ``(R, 3)`` [m, m, rad].
        times: When each is cast, shape ``(R,)`` [s].
        edges: Both ends of each (x, y, x, y), shape ``(S, 4)`` [m].
        discs: Centre at time 0, velocity and radius of each, shape ``(D, 5)`` [m, m/s, m]. From
            within one the distance is 0.
    """
    for i in range(rays.shape[0]):
        x, y, cosine, sine = rays[i, 0], rays[i, 1], math.cos(rays[i, 2]), math.sin(rays[i, 2])
        least = math.inf
        for j in range(edges.shape[0]):
            from_x, from_y = edges[j, 0] - x, edges[j, 1] - y
            along_x, along_y = edges[j, 2] - edges[j, 0], edges[j, 3] - edges[j, 1]
            across = cosine * along_y - sine * along_x
            if across == 0.0:
                continue
            distance = (from_x * along_y - from_y * along_x) / across
            part = (from_x * sine - from_y * cosine) / across
            if 0.0 <= distance < least and -_OVERLAP <= part <= 1.0 + _OVERLAP:
                least = distance
        for j in range(discs.shape[0]):
            to_x = discs[j, 0] + times[i] * discs[j, 2] - x
            to_y = discs[j, 1] + times[i] * discs[j, 3] - y
            ahead, beside = cosine * to_x + sine * to_y, cosine * to_y - sine * to_x
            squared = discs[j, 4] * discs[j, 4]
            if to_x * to_x + to_y * to_y <= squared:
                least = 0.0
            elif ahead > 0.0 and beside * beside <= squared:
                least = min(least, ahead - math.sqrt(squared - beside * beside))
        ranges[i] = least
