"""What moves, as plans see it: tracks brought to one instant, each in a slot that it keeps."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from cmpsp_ros.guidance.horizon import NANOSECONDS
from cmpsp_ros.guidance.settings import MovingObstacles
from cmpsp_ros.guidance.tracks import Track
from cmpsp_ros.robot.moving_discs import NOTHING_MOVES, MovingDiscs

Array = NDArray[np.float64]


class Lookout:
    """Keeps each obstacle in its slot from one control step to the next.

    So the constraints of a plan stay those that they were, and its warm start is worth something.

    Attributes:
        surprised: Whether the last look showed an obstacle that the one before did not.
    """

    def __init__(self) -> None:
        """Nothing is in sight."""
        self._slots: dict[int, int] = {}
        self._numbers: frozenset[int] = frozenset()
        self.surprised = False

    def forget(self) -> None:
        """Begin again."""
        if self._numbers:
            self._slots, self._numbers = {}, frozenset()

    def at(
        self, stamp: int, pose: Array, tracks: Sequence[Track], settings: MovingObstacles
    ) -> MovingDiscs:
        """Where what moves is at an instant.

        Args:
            stamp: The instant [ns].
            pose: Where the robot is, shape ``(3,)`` [m, m, rad]: of too many obstacles the nearer
                ones have slots.
            tracks: What is known, none of it later than that.
            settings: How many, and how fast what is known grows old.
        """
        if not tracks:
            self.surprised = False
            self.forget()
            return NOTHING_MOVES
        numbers = frozenset(each.id for each in tracks)
        self.surprised, self._numbers = not numbers <= self._numbers, numbers
        ages = np.array([(stamp - each.stamp) / NANOSECONDS for each in tracks])
        states = np.array([(each.x, each.y, each.vx, each.vy, each.radius) for each in tracks])
        states[:, :2] += ages[:, None] * states[:, 2:4]
        states[:, 4] += settings.growth * ages
        names = tuple(each.name for each in tracks)
        discs = MovingDiscs(names, states, settings.growth, np.full(len(tracks), -1))
        clearance = discs.clearance(pose).tolist()
        order = sorted(range(len(tracks)), key=lambda i: (clearance[i], tracks[i].id))
        self._assign([tracks[i].id for i in order[: settings.capacity]], settings.capacity)
        slots = np.array([self._slots.get(each.id, -1) for each in tracks], dtype=np.int64)
        return MovingDiscs(names, states, settings.growth, slots)

    def _assign(self, numbers: Sequence[int], capacity: int) -> None:
        kept = {each: self._slots[each] for each in numbers if each in self._slots}
        free = iter(sorted(set(range(capacity)) - set(kept.values())))
        # Those that were there before stay in the order of their slots.
        self._slots = {each: kept[each] if each in kept else next(free) for each in numbers}
