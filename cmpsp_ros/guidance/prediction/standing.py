"""People who have stopped: sensors count them as static, yet they may set off again."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from cmpsp_ros.guidance.messages.tracks import MovingObject, Track
from cmpsp_ros.sensing import Sighting
from cmpsp_ros.world.grids import Cell

_SLOW: Final = 0.3
"""Speed up to which somebody whose track has ended may have stopped [m/s]."""


class StandingPeople:
    """Remembers seen people whose tracks end where the grid has somebody stand from then on."""

    def __init__(self) -> None:
        """Start with nobody."""
        self._moving: dict[int, Track] = {}
        self.standing: tuple[Track, ...] = ()

    def update(self, stamp: int, tracks: Sequence[MovingObject], sighting: Sighting) -> None:
        """Note who moves and who has stopped at a time [ns].

        They stand where they were last tracked, with the doubt about their velocity at that time:
        that covers what they do until it is seen.
        """
        moving = {each.id: each for each in tracks if isinstance(each, Track) and each.is_seen}
        known = {each.id: each for each in self.standing} | {
            number: replace(each, vx=0.0, vy=0.0, position_stddev=0.0)
            for number, each in self._moving.items()
            if math.hypot(each.vx, each.vy) <= _SLOW
        }
        self.standing = tuple(
            replace(each, stamp=stamp)
            for number, each in known.items()
            if number not in moving and _is_there(each, sighting)
        )
        self._moving = moving


def _is_there(person: Track, sighting: Sighting) -> bool:
    """True if anything in the grid touches the place of a person."""
    center, grid = np.array([[person.x, person.y]]), sighting.grid
    near = grid.around(center, person.radius)
    occupied = near.centers(*np.nonzero(near.cells == Cell.OCCUPIED))
    return bool((np.hypot(*(occupied - center).T) <= person.radius).any())
