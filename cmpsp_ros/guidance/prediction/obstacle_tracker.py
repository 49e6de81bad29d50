"""Moving obstacles as plans see them: brought to one instant, each in a slot that it keeps."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cmpsp_ros.arrays import Array
from cmpsp_ros.guidance.horizon import NANOSECONDS
from cmpsp_ros.guidance.messages.tracks import MovingObject, PeerTrajectory
from cmpsp_ros.guidance.solver_settings import MovingObstacles
from cmpsp_ros.world.obstacles import NOTHING_MOVES, MovingDiscs


class ObstacleTracker:
    """Keeps each obstacle in its slot from one control step to the next.

    So the constraints of a plan stay those that they were, and its warm start is worth something.

    Attributes:
        new_obstacle_seen: Whether the last update had an obstacle that the one before had not.
    """

    def __init__(self) -> None:
        """Nothing is known."""
        self._slots: dict[int | str, int] = {}
        self._numbers: frozenset[int | str] = frozenset()
        self.new_obstacle_seen = False

    def update(
        self, stamp: int, pose: Array, tracks: Sequence[MovingObject], settings: MovingObstacles
    ) -> MovingDiscs:
        """Where moving obstacles are at an instant.

        Args:
            stamp: The instant [ns].
            pose: Where the robot is, shape ``(3,)`` [m, m, rad]: of too many obstacles the nearer
                ones have slots.
            tracks: What is known, none of it later than that.
            settings: How many are considered, and how fast their radii grow.
        """
        if not tracks:
            self.new_obstacle_seen = False
            if self._numbers:
                self._slots, self._numbers = {}, frozenset()
            return NOTHING_MOVES
        numbers = frozenset(each.id for each in tracks)
        self.new_obstacle_seen, self._numbers = not numbers <= self._numbers, numbers
        states = np.array([_state(each, stamp, settings) for each in tracks])
        ways = {
            index: each.path(stamp)
            for index, each in enumerate(tracks)
            if isinstance(each, PeerTrajectory)
        }
        names = tuple(each.name for each in tracks)
        slots = np.full(len(tracks), -1, dtype=np.int64)
        discs = MovingDiscs(names, states, settings.growth, slots, ways)
        clearance = discs.clearance(pose).tolist()
        nearest = sorted(range(len(tracks)), key=lambda i: (clearance[i], i))
        self._assign([tracks[i].id for i in nearest[: settings.slots]], settings.slots)
        slots[:] = [self._slots.get(each.id, -1) for each in tracks]
        return discs

    def _assign(self, numbers: Sequence[int | str], capacity: int) -> None:
        kept = {each: self._slots[each] for each in numbers if each in self._slots}
        free = iter(sorted(set(range(capacity)) - set(kept.values())))
        # Those that were there before stay in the order of their slots.
        self._slots = {each: kept[each] if each in kept else next(free) for each in numbers}


def _state(seen: MovingObject, stamp: int, settings: MovingObstacles) -> tuple[float, ...]:
    """Centre, velocity and radius of what was seen, at an instant [ns]."""
    age = (stamp - seen.stamp) / NANOSECONDS
    if isinstance(seen, PeerTrajectory):
        # A robot that stands is where it said, however long ago.
        grown = 0.0 if seen.at_rest else settings.growth * age
        return (*seen.position(stamp), 0.0, 0.0, settings.others_radius + grown)
    x, y = seen.x + age * seen.vx, seen.y + age * seen.vy
    return x, y, seen.vx, seen.vy, seen.radius + settings.growth * age
