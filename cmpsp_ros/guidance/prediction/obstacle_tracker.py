"""What moves, as plans see it: brought to one instant, each in a slot that it keeps."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from cmpsp_ros.guidance.horizon import NANOSECONDS
from cmpsp_ros.guidance.messages.peer_trajectories import OtherPlan, Seen
from cmpsp_ros.guidance.settings import MovingObstacles
from cmpsp_ros.world.obstacles.moving_discs import NOTHING_MOVES, MovingDiscs

Array = NDArray[np.float64]


class Lookout:
    """Keeps each obstacle in its slot from one control step to the next.

    So the constraints of a plan stay those that they were, and its warm start is worth something.

    Attributes:
        surprised: Whether the last look showed an obstacle that the one before did not.
    """

    def __init__(self) -> None:
        """Nothing is in sight."""
        self._slots: dict[int | str, int] = {}
        self._numbers: frozenset[int | str] = frozenset()
        self.surprised = False

    def forget(self) -> None:
        """Begin again."""
        if self._numbers:
            self._slots, self._numbers = {}, frozenset()

    def at(
        self, stamp: int, pose: Array, tracks: Sequence[Seen], settings: MovingObstacles
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
        states = np.array([_state(each, stamp, settings) for each in tracks])
        ways = {
            index: each.way(stamp)
            for index, each in enumerate(tracks)
            if isinstance(each, OtherPlan)
        }
        names = tuple(each.name for each in tracks)
        slots = np.full(len(tracks), -1, dtype=np.int64)
        discs = MovingDiscs(names, states, settings.growth, slots, ways)
        clearance = discs.clearance(pose).tolist()
        nearest = sorted(range(len(tracks)), key=lambda i: (clearance[i], i))
        self._assign([tracks[i].id for i in nearest[: settings.room]], settings.room)
        slots[:] = [self._slots.get(each.id, -1) for each in tracks]
        return discs

    def _assign(self, numbers: Sequence[int | str], capacity: int) -> None:
        kept = {each: self._slots[each] for each in numbers if each in self._slots}
        free = iter(sorted(set(range(capacity)) - set(kept.values())))
        # Those that were there before stay in the order of their slots.
        self._slots = {each: kept[each] if each in kept else next(free) for each in numbers}


def _state(seen: Seen, stamp: int, settings: MovingObstacles) -> tuple[float, ...]:
    """Centre, velocity and radius of what was seen, at an instant [ns]."""
    age = (stamp - seen.stamp) / NANOSECONDS
    if isinstance(seen, OtherPlan):
        # A robot that stands is where it said, however long ago.
        grown = 0.0 if seen.stands else settings.growth * age
        return (*seen.place(stamp), 0.0, 0.0, settings.others_radius + grown)
    x, y = seen.x + age * seen.vx, seen.y + age * seen.vy
    return x, y, seen.vx, seen.vy, seen.radius + settings.growth * age
