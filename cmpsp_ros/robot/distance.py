"""Distances from points to centres with their gradients: roads and obstacles are made of them."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from cmpsp_ros.mpsp.compiled import compiled

Array = NDArray[np.float64]


def distances(points: Array, centers: Array) -> tuple[Array, Array]:
    """Distance of every point to every centre, and its gradient by the point.

    Args:
        points: Shape ``(K, 2)`` [m].
        centers: Shape ``(M, 2)`` [m].

    Returns:
        Distances ``(K, M)`` [m] and unit gradients ``(K, M, 2)``. At a centre itself, where
        there is no gradient, it points along x so that a solver can leave.
    """
    distance = np.empty((len(points), len(centers)))
    gradient = np.empty((len(points), len(centers), 2))
    _distances(distance, gradient, points, centers)
    return distance, gradient


@compiled
def _distances(distance: Array, gradient: Array, points: Array, centers: Array) -> None:
    for k in range(points.shape[0]):
        for i in range(centers.shape[0]):
            dx, dy = points[k, 0] - centers[i, 0], points[k, 1] - centers[i, 1]
            d = math.hypot(dx, dy)
            distance[k, i] = d
            gradient[k, i, 0] = dx / d if d > 0.0 else 1.0
            gradient[k, i, 1] = dy / d if d > 0.0 else 0.0
