"""The homotopy class of a path: on which side of each obstacle it goes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from cmpsp_ros.arrays import Array
from cmpsp_ros.guidance.planning.homotopy.gaps import HomotopyClass
from cmpsp_ros.guidance.planning.homotopy.road_frame import RoadFrame, locate
from cmpsp_ros.mpsp.jit import allocation_free

_NAMED: Final = 6
"""As many sides a message has, the last of which may stand for the rest."""


def class_of(frame: RoadFrame, centers: tuple[Array, Array], poses: Array) -> HomotopyClass:
    """On which side a path passes each obstacle between its beginning and the goal.

    Args:
        frame: Road coordinates from where the path begins to the goal.
        centers: Of the obstacles, by `RoadFrame.coordinates`.
        poses: Along the path, shape ``(N + 1, 3)`` [m, m, rad].

    Returns:
        0 for an obstacle that lies beside neither the path nor its beginning's way to the goal.
    """
    if not len(centers[0]):
        return ()
    sides, path = np.zeros(len(centers[0])), np.empty((len(poses), 2))
    _locate_all(path, frame, np.ascontiguousarray(poses))
    _find_sides(sides, *centers, path, frame.stations.item(-1), frame.left)
    return tuple(int(side) for side in sides.tolist())


def in_words(sides: HomotopyClass, names: Sequence[str]) -> str:
    """A homotopy class for messages; empty where nothing is passed. It names the first few."""
    words = {1: 'left', -1: 'right'}
    parts = [f'{words[side]} of {name}' for side, name in zip(sides, names, strict=True) if side]
    if len(parts) > _NAMED:
        parts[_NAMED - 1 :] = [f'past {len(parts) - _NAMED + 1} more']
    return ' and '.join(filter(None, [', '.join(parts[:-1]), *parts[-1:]]))


@allocation_free
def _locate_all(path: Array, frame: RoadFrame, poses: Array) -> None:
    """Station and lateral position of each pose, the first one at station 0."""
    at, bearing = 0.0, frame.begin
    for k in range(poses.shape[0]):
        at, path[k, 1], bearing = locate(frame, poses[k, 0], poses[k, 1], at, bearing)
        path[k, 0] = at


@allocation_free
def _find_sides(
    sides: Array, stations: Array, lateral: Array, path: Array, end: float, left: float
) -> None:
    """Side of each obstacle, by where the path is when it is beside its centre."""
    for j in range(stations.shape[0]):
        at = stations[j]
        if not 0.0 < at <= end:
            continue
        for k in range(path.shape[0] - 1):
            if path[k, 0] < at <= path[k + 1, 0]:
                here, there = path[k, 1], path[k + 1, 1]
                part = (at - path[k, 0]) / (path[k + 1, 0] - path[k, 0])
                sides[j] = left if here + part * (there - here) > lateral[j] else -left
                break
