"""Where plans begin that do not go on from another one."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np
from numpy.typing import NDArray

from cmpsp_ros.guidance.formulation.ocp_formulation import Task
from cmpsp_ros.guidance.horizon import Horizon
from cmpsp_ros.guidance.planning.homotopy.gaps import Signature
from cmpsp_ros.guidance.planning.homotopy.path_search import Way, turning_first, ways_through
from cmpsp_ros.guidance.planning.initial_trajectories import along_road, initial_guess
from cmpsp_ros.guidance.planning.planning_context import Moment
from cmpsp_ros.guidance.settings import GuidanceSettings

Array = NDArray[np.float64]


class Guesses:
    """Makes control histories, each of shape ``(N + 1, 2)`` [rad/s]."""

    def __init__(self, settings: GuidanceSettings, most: int) -> None:
        """Take the settings.

        Args:
            settings: All settings of the guidance law.
            most: How many plans are compared; with one, no ways through are looked for.
        """
        self._most, self._task = most, Task(settings)
        self._obstacles = len(settings.obstacles)

    def first(self, moment: Moment) -> list[Array]:
        """Without any plan: as the settings say, and by the ways that there are."""
        settings, start = moment.settings, moment.start
        given = initial_guess(settings, start.pose, moment.horizon.durations, start.near)
        if self._most == 1:
            return [given]
        if settings.initial_guess.type == 'road':
            return self.fresh(moment, self._most)
        return [given, *self.fresh(moment, self._most - 1)]

    def fresh(self, moment: Moment, most: int, without: Collection[Signature] = ()) -> list[Array]:
        """By the most promising ways; along the centre line where there is no choice of them.

        Args:
            moment: What they are for.
            most: How many ways at most.
            without: Signatures of ways that are not wanted.
        """
        road, ways = self._ways(moment, most, without)
        return [way.guess for way in ways] or [road]

    def turning(self, moment: Moment) -> list[Array]:
        """By the most promising ways, but each begins with a turn on the spot."""
        _, ways = self._ways(moment, self._most)
        pose, durations = moment.start.pose, moment.horizon.durations
        return [turning_first(moment.settings, way, pose, durations) for way in ways]

    def _ways(
        self, moment: Moment, most: int, without: Collection[Signature] = ()
    ) -> tuple[Array, list[Way]]:
        """A guess along the centre line, and the most promising ways."""
        settings, pose = moment.settings, moment.start.pose
        durations = moment.horizon.durations
        road = along_road(settings, pose, durations)
        if not self._obstacles and not moment.met.names:
            return road, []
        space = moment.met.taken_from(self._task.standing(road, durations))
        return road, ways_through(settings, space, pose, durations, most, without)


def standing(horizon: Horizon) -> Array:
    """Wheel speeds of a robot that stands still, shape ``(N + 1, 2)`` [rad/s]."""
    return np.zeros((len(horizon.edges), 2))
