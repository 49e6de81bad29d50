"""The homotopy class of a path: on which side of each obstacle it goes."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from cmpsp_ros.guidance.planning.homotopy.gaps import HomotopyClass
from cmpsp_ros.mpsp.jit.compiled import allocation_free
from cmpsp_ros.world.roads.annulus import Annulus

Array = NDArray[np.float64]


def arc_to(road: Annulus, pose: Array, goal: tuple[float, float]) -> tuple[float, float]:
    """Bearing of a pose from the road's centre, and the shorter way round to the goal's [rad]."""
    x, y = road.center
    begin = math.atan2(pose[1] - y, pose[0] - x)
    return begin, math.remainder(math.atan2(goal[1] - y, goal[0] - x) - begin, math.tau)


def class_of(
    road: Annulus, centers: Array, poses: Array, goal: tuple[float, float]
) -> HomotopyClass:
    """On which side a path passes each obstacle between its beginning and the goal.

    Args:
        road: The road.
        centers: Of the obstacles, shape ``(M, 2)`` [m].
        poses: Along the path, shape ``(N + 1, 3)`` [m, m, rad].
        goal: Where the road leads to (x, y) [m].

    Returns:
        0 for an obstacle that lies beside neither the path nor its beginning's way to the goal.
    """
    if not len(centers):
        return ()
    begin, total = arc_to(road, poses[0], goal)
    turned, sides = np.empty(len(poses)), np.zeros(len(centers))
    x, y = road.center
    _unwrap(turned, poses, x, y, math.copysign(1.0, total))
    _find_sides(sides, centers, poses, turned, x, y, begin, total)
    return tuple(int(side) for side in sides.tolist())


def in_words(sides: HomotopyClass, names: Sequence[str]) -> str:
    """A homotopy class for messages; empty where nothing is passed."""
    words = {1: 'left', -1: 'right'}
    parts = [f'{words[side]} of {name}' for side, name in zip(sides, names, strict=True) if side]
    return ' and '.join(filter(None, [', '.join(parts[:-1]), *parts[-1:]]))


@allocation_free
def _unwrap(turned: Array, poses: Array, x: float, y: float, side: float) -> None:
    """Angle from the first pose to each, about the road's centre, the way round to the goal."""
    last = math.atan2(poses[0, 1] - y, poses[0, 0] - x)
    turned[0] = 0.0
    for k in range(1, poses.shape[0]):
        bearing = math.atan2(poses[k, 1] - y, poses[k, 0] - x)
        step = bearing - last
        if step > math.pi:
            step -= math.tau
        elif step < -math.pi:
            step += math.tau
        turned[k] = turned[k - 1] + side * step
        last = bearing


@allocation_free
def _find_sides(
    sides: Array,
    centers: Array,
    poses: Array,
    turned: Array,
    x: float,
    y: float,
    begin: float,
    total: float,
) -> None:
    """Side of each obstacle, by how far from the road's centre the path is beside it."""
    side = 1.0 if total >= 0.0 else -1.0
    for j in range(centers.shape[0]):
        off_x, off_y = centers[j, 0] - x, centers[j, 1] - y
        at = math.atan2(off_y, off_x) - begin
        at = side * (at - math.tau * round(at / math.tau))
        if not 0.0 < at <= abs(total):
            continue
        for k in range(poses.shape[0] - 1):
            if turned[k] < at <= turned[k + 1]:
                here = math.hypot(poses[k, 0] - x, poses[k, 1] - y)
                there = math.hypot(poses[k + 1, 0] - x, poses[k + 1, 1] - y)
                radius = here + (at - turned[k]) / (turned[k + 1] - turned[k]) * (there - here)
                sides[j] = side if radius < math.hypot(off_x, off_y) else -side
                break
