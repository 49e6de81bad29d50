"""Bystanders: what is small and stands alone near the robot may be somebody who sets off.

A tracker confirms motion only after some time, and near the robot there is no time. So among people
a stop has to be clear of where they could be if they have set off, by up to a cell so far.
"""

from typing import Final

import numpy as np

from cmpsp_ros.arrays import Array, BoolArray
from cmpsp_ros.guidance.messages.tracks import Track
from cmpsp_ros.guidance.prediction.obstacle_tracker import time_to_walk
from cmpsp_ros.guidance.world import World
from cmpsp_ros.sensing import Sighting
from cmpsp_ros.world import FreeSpace
from cmpsp_ros.world.grids import Cell, small_groups
from cmpsp_ros.world.roads import OpenFloor

_NEAR: Final = 2.5  # distance up to which they matter [m]
_SIDES: Final = 0.1, 0.7  # longest side of the cells of a leg, and of a person [m]
_KNOWN: Final = 0.15  # distance from a known obstacle up to which it is that what is seen [m]


class Bystander(Track):
    """Somebody who may stand somewhere; the number is of one control step alone."""

    @property
    def name(self) -> str:
        """Name in messages."""
        return 'somebody standing'


def bystanders(
    stamp: int, pose: Array, sighting: Sighting, world: World, acceleration: float
) -> tuple[Bystander, ...]:
    """All that may be a person near a pose ``(3,)`` at a time [ns].

    The disc of each begins where the robot sees it, and lies behind. With an `acceleration`
    [m/s^2] they may have walked since the time stamp of the track.
    """
    grid = sighting.grid.around(pose[None, :2], _NEAR)
    sides = [round(each / grid.resolution) for each in _SIDES]
    since, found = stamp - time_to_walk(grid.resolution, acceleration), list[Bystander]()
    for cells in small_groups(grid.cells == Cell.OCCUPIED, *sides):
        away = grid.centers(*cells.T) - pose[:2]
        distances = np.hypot(*away.T)
        nearest = int(distances.argmin())
        radius = grid.resolution * float(np.ptp(cells, axis=0).max() + 1) / 2.0
        behind = (radius - grid.resolution / 2.0) / max(float(distances[nearest]), 2.0 * radius)
        x, y = (pose[:2] + (1.0 + behind) * away[nearest]).tolist()
        found.append(Bystander(len(found), since, radius, x, y, 0.0, 0.0))
    is_known = _are_known(np.array([(each.x, each.y, each.radius) for each in found]), world)
    return tuple(each for each, known in zip(found, is_known, strict=True) if not known)


def _are_known(discs: Array, world: World) -> BoolArray:
    """True for discs ``(K, 3)`` [m] at which an obstacle is known."""
    if not (len(discs) and world.obstacles):
        return np.zeros(len(discs), dtype=bool)
    known = FreeSpace.of(OpenFloor(), world.obstacles, 0.0)
    return np.asarray(known.at(discs).min(axis=1) <= discs[:, 2] + _KNOWN)
