"""People who have stopped: sensors count them as static, yet they may set off again."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from cmpsp_ros.arrays import Array
from cmpsp_ros.guidance.messages.tracks import MovingObject, Track
from cmpsp_ros.sensing import Sighting
from cmpsp_ros.world.grids import Cell

_CERTAIN: Final = 3.0
"""Standard deviations of its velocity within which somebody whose track has ended may stand."""
_BESIDE: Final = 1.5
"""Distance from a cell that was occupied before, at which another shows nothing new [cells]."""


class StandingPeople:
    """Remembers seen people whose tracks end where the grid has somebody stand from then on.

    Moving obstacles mark no cell: occupied cells beside a track belong to something else.
    """

    def __init__(self) -> None:
        """Start with nobody."""
        self._slow: dict[int, Track] = {}
        self._beside: dict[int, Array] = {}
        self.standing: tuple[Track, ...] = ()

    def update(self, stamp: int, tracks: Sequence[MovingObject], sighting: Sighting) -> None:
        """Note who moves and who has stopped at a time [ns].

        They stand where they were last tracked, as uncertain as their velocity was then.
        """
        moving = {each.id: each for each in tracks if isinstance(each, Track) and each.is_seen}
        known = {each.id: each for each in self.standing} | self._slow
        self.standing = tuple(
            replace(each, stamp=stamp)
            for number, each in known.items()
            if number not in moving and self._is_there(each, sighting)
        )
        self._slow = {
            number: replace(each, vx=0.0, vy=0.0, position_stddev=0.0)
            for number, each in moving.items()
            if math.hypot(each.vx, each.vy) <= _CERTAIN * each.velocity_stddev
        }
        beside = {number: _occupied(each, sighting) for number, each in self._slow.items()}
        self._beside = {each.id: self._beside[each.id] for each in self.standing} | beside

    def _is_there(self, person: Track, sighting: Sighting) -> bool:
        """True if a newly occupied cell touches the place of a person."""
        occupied = _occupied(person, sighting)
        apart = np.linalg.norm(occupied[:, None] - self._beside[person.id], axis=-1)
        is_new = apart.min(axis=1, initial=math.inf) > _BESIDE * sighting.grid.resolution
        return bool(is_new.any())


def _occupied(person: Track, sighting: Sighting) -> Array:
    """Occupied cells that touch the place of a person, ``(K, 2)`` [m]."""
    center, grid = np.array([[person.x, person.y]]), sighting.grid
    near = grid.around(center, person.radius)
    occupied = near.centers(*np.nonzero(near.cells == Cell.OCCUPIED))
    touching: Array = occupied[np.hypot(*(occupied - center).T) <= person.radius]
    return touching
