"""Whether a plan that cannot reach the goal gets the robot any nearer to it: else it waits.

A road that is closed leaves time over. Nothing in the cost keeps a robot from spending it on the
move, to and fro before what is in its way, clear of everything and to no end.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from cmpsp_ros.guidance.candidate import Candidate
from cmpsp_ros.guidance.initial_guess import way_left
from cmpsp_ros.guidance.settings import GuidanceSettings

Array = NDArray[np.float64]

# What a plan must gain to be worth driving [m], and as a part of what the wheels could drive in the
# time that is left.
_WORTH_WHILE = 0.05
_PART = 0.1
# Control steps for which a plan that gains less is driven all the same: it may yet be improved.
_PATIENCE = 3


class Progress:
    """Counts control steps without a prospect."""

    def __init__(self, settings: GuidanceSettings) -> None:
        """Take road, goal and robot from the settings."""
        self._settings = settings
        self._road = settings.road.space(0.0)
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

    def reason_to_wait(self, candidate: Candidate) -> str:
        """Why the robot should rather stand still than follow a plan; empty where it should not.

        Args:
            candidate: The plan chosen at this control step.
        """
        improvement = candidate.improvement
        if not (improvement.elastic and improvement.slack_terminal):
            self._without = 0
            return ''
        plan, settings = candidate.plan, self._settings
        left = float(plan.horizon.durations.sum())
        worth_while = min(_WORTH_WHILE, _PART * settings.model.max_speed * left)
        self._without = self._without + 1 if self._gain(plan.poses) < worth_while else 0
        if self._without <= _PATIENCE:
            return ''
        miss = math.dist(plan.poses[-1, :2], settings.goal)
        return f'The robot waits: no plan gets it nearer to the goal than {miss:.3g} m.'

    def _gain(self, poses: Array) -> float:
        """By how much the end of a path is nearer than its beginning, along the road or not [m]."""
        goal = self._settings.goal

        def left(x: float, y: float, heading: float) -> tuple[float, float]:
            along = way_left(self._road, x, y, heading, *goal)
            return abs(along), math.dist((x, y), goal)

        now, then = left(*poses[0]), left(*poses[-1])
        return max(now[0] - then[0], now[1] - then[1])
