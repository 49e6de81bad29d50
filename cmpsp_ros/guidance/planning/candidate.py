"""What the guidance law chooses from: where a plan can begin, and plans that may be followed."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cmpsp_ros.guidance.decision import Plan
from cmpsp_ros.guidance.formulation.ocp_functions import EDGES
from cmpsp_ros.guidance.planning.solve_result import Improvement
from cmpsp_ros.guidance.safety.audit import Audit, Verdict
from cmpsp_ros.guidance.settings import GuidanceSettings
from cmpsp_ros.world.obstacles.moving_discs import NOTHING_MOVES, MovingDiscs

Array = NDArray[np.float64]

_CLEARLY_LESS = 0.5

TOUCHING = 1e-3
"""What is nearer than nothing by less than this is said to touch [m]: odometry errs by more."""


class Start(NamedTuple):
    """Where a plan begins.

    Attributes:
        pose: Where the robot will be when the command decided now takes effect.
        way: Verdict on the way there, under commands given before; None when there is none.
        moving: What moves, as it will be then.
        near: Progress along the road of a place near the pose, not a number where the road has no
            need of it [m].
    """

    pose: Array
    way: Verdict | None = None
    moving: MovingDiscs = NOTHING_MOVES
    near: float = math.nan


def inside(pose: Array, audit: Audit) -> str:
    """Why nothing may begin at a pose: it is inside an obstacle, which the robot cannot be.

    A robot that is under way already is not stopped for it, but led out; and so is one that
    something has moved upon.

    Args:
        pose: Where the robot is, shape ``(3,)`` [m, m, rad].
        audit: Knows the obstacles.

    Returns:
        A sentence, empty where the pose is inside none.
    """
    away = audit.at(pose)[EDGES:]
    if not away.size or not away.min() < -TOUCHING:
        return ''
    name = audit.names([EDGES + int(away.argmin())])
    return f'The robot is {-away.min():.3g} m inside {name}: nothing is begun there.'


class Candidate(NamedTuple):
    """A plan that may be followed.

    Attributes:
        improvement: How it was made.
        verdict: On it and on the way to its beginning.
    """

    improvement: Improvement
    verdict: Verdict

    @property
    def plan(self) -> Plan:
        """The plan itself."""
        return self.improvement.plan

    @property
    def usable(self) -> bool:
        """Whether it may be followed at all."""
        return self.improvement.solved and self.verdict.passed

    @property
    def flawless(self) -> bool:
        """Whether it meets every constraint, too."""
        return self.usable and not self.improvement.elastic

    @property
    def gives_way(self) -> bool:
        """Whether some constraint is not met, now or in the linearised plan."""
        return self.improvement.elastic or self._begins_too_close

    @property
    def _begins_too_close(self) -> bool:
        return self.verdict.margin < -TOUCHING

    def beats(self, other: Candidate) -> bool:
        """Whether to change over from another plan: only for one that is clearly better."""
        if self.usable != other.usable:
            return self.usable
        if self.improvement.elastic != other.improvement.elastic:
            return other.improvement.elastic
        return self.improvement.slack < _CLEARLY_LESS * other.improvement.slack

    def describe(
        self, audit: Audit, settings: GuidanceSettings, moving: MovingDiscs = NOTHING_MOVES
    ) -> str:
        """What is to be said of it when it is followed, in a sentence."""
        improvement, verdict = self.improvement, self.verdict
        miss = settings.miss(self.plan.poses[-1])
        if improvement.elastic:
            where = audit.names(improvement.slack_where, moving)
            parts = [where] if where else []
            miss_said = ''
            if improvement.slack_terminal:
                parts.append('the goal')
                miss_said = f' The plan ends {miss:.3g} m from the goal.'
            return (
                f'The constraints contradict each other: {improvement.slack:.3g} m of slack at'
                f' {" and ".join(parts)}.{miss_said}'
            )
        if verdict.worst_margin < 0.0:
            how = 'the way begins' if self._begins_too_close else 'later on the plan still comes'
            return (
                f'No slack was needed, but {how} {-verdict.worst_margin:.3g} m too close to'
                f' {verdict.nearest}.'
            )
        if miss > settings.goal_tolerance:
            return f'No slack was needed, but the plan still ends {miss:.3g} m from the goal.'
        off = settings.heading_miss(self.plan.poses[-1])
        if off is not None and off > settings.heading_tolerance:
            where = f"{off:.3g} rad off the goal's heading"
            return f'No slack was needed, but the plan still ends {where}.'
        return 'The plan meets every constraint.'
