"""Whether a plan that cannot reach the goal gets the robot any nearer to it: else it waits.

A road that is closed leaves time over. Nothing in the cost keeps a robot from spending it on the
move, to and fro before what is in its way, clear of everything and to no end.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from cmpsp_ros.guidance.horizon import NANOSECONDS
from cmpsp_ros.guidance.planning.candidate import Candidate
from cmpsp_ros.guidance.planning.initial_trajectories import ways_left
from cmpsp_ros.guidance.settings import GuidanceSettings

Array = NDArray[np.float64]

# What a plan must gain to be worth driving [m], as a part of what the wheels could drive, and by
# when [ns]. What it gains later may be what it only loses first.
_WORTH_WHILE = 0.05
_PART = 0.1
_SOON = NANOSECONDS
# Control steps for which a plan that gains less is driven all the same: it may yet be improved.
_PATIENCE = 3


class Progress:
    """Counts control steps without a prospect."""

    def __init__(self, settings: GuidanceSettings) -> None:
        """Take road, goal and robot from the settings."""
        self._settings = settings
        self.forget()

    def aim(self, settings: GuidanceSettings) -> None:
        """Take another goal; nothing else of the settings may differ."""
        self._settings = settings

    def forget(self) -> None:
        """Begin again."""
        self._without = 0

    def stand(self) -> None:
        """Note that the robot stands: then there is no time to be lost by waiting."""
        self._without = _PATIENCE

    def reason_to_wait(self, candidate: Candidate, near: float = math.nan) -> str:
        """Why the robot should rather stand still than follow a plan; empty where it should not.

        Args:
            candidate: The plan chosen at this control step.
            near: Progress of a place near its beginning, not a number where none is known [m].
        """
        improvement = candidate.improvement
        if not (improvement.elastic and improvement.slack_terminal):
            self.forget()
            return ''
        plan, settings = candidate.plan, self._settings
        edges = plan.horizon.edges
        soon = max(1, int(edges.searchsorted(edges[0] + _SOON, side='right')) - 1)
        reach = settings.model.max_speed * float(edges[soon] - edges[0]) / NANOSECONDS
        if self._gain(plan.poses[: soon + 1], near) >= min(_WORTH_WHILE, _PART * reach):
            # Patience comes back with the goal only: else it would be spent on driving to and fro.
            return ''
        self._without += 1
        if self._without <= _PATIENCE:
            return ''
        miss = math.dist(plan.poses[-1, :2], settings.goal)
        return (
            f'The robot waits: no plan soon gets it nearer to the goal, {miss:.3g} m off at best.'
        )

    def _gain(self, poses: Array, near: float) -> float:
        """By how much a path gets nearer to the goal, along the road or straight [m]."""
        along = np.abs(ways_left(self._settings, np.ascontiguousarray(poses), near))
        straight = np.hypot(*(poses[:, :2] - self._settings.goal).T)
        return float(max(along[0] - along.min(), straight[0] - straight.min()))
