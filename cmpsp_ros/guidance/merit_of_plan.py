"""How good a plan is: what it touches comes first, then the goal, then what it costs."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from cmpsp_ros.guidance.audit import Audit
from cmpsp_ros.guidance.candidate import Candidate
from cmpsp_ros.guidance.settings import GuidanceSettings
from cmpsp_ros.robot.road import Annulus

Array = NDArray[np.float64]

# A plan changes over only to one that leaves less than half of a flaw, or costs so much less:
# two plans that are about as good must not take turns.
_CLEARLY_LESS = 0.5
_CLEARLY_CHEAPER = 0.8

# As far as an active constraint of a linearisation may be off.
_TOUCH = 1e-3

_NO_ROAD = 1e6


@dataclass(frozen=True)
class Merit:
    """What plans are compared by, in this order.

    Attributes:
        usable: Whether the plan may be followed at all.
        obstacle: How deep it is in an obstacle [m]; 0 for none.
        edge: How far it is off the road [m]; 0 for not.
        miss: How far from the goal it ends [m]; 0 within the tolerance.
        elastic: Whether its last iteration needed slack.
        cost: The cost (95) of its path and its controls, without the proximal term.
    """

    usable: bool
    obstacle: float
    edge: float
    miss: float
    elastic: bool
    cost: float

    @property
    def flawed(self) -> bool:
        """Whether another plan should be looked for."""
        touches = self.obstacle > 0.0 or self.edge > 0.0
        return not self.usable or self.elastic or touches or self.miss > 0.0

    def beats(self, other: Merit) -> bool:
        """Whether to change over from another plan: only for one that is clearly better."""
        if self.usable != other.usable:
            return self.usable
        flaws = (
            (self.obstacle, other.obstacle),
            (self.edge, other.edge),
            (self.miss, other.miss),
        )
        for mine, its in flaws:
            if mine < _CLEARLY_LESS * its:
                return True
            if mine > its:
                return False
        if self.elastic != other.elastic:
            return other.elastic
        return self.cost < _CLEARLY_CHEAPER * other.cost


class Judge:
    """Measures the merit of plans for one set of settings."""

    def __init__(self, settings: GuidanceSettings) -> None:
        """Take limits, road, obstacles and weights from the settings."""
        self._settings = settings
        boundless = Annulus(settings.road.center, -_NO_ROAD, _NO_ROAD)
        self._road = Audit(replace(settings, obstacles=()))
        self._obstacles = Audit(replace(settings, road=boundless))

    def merit(self, candidate: Candidate, held: Array) -> Merit:
        """Merit of a candidate.

        Args:
            candidate: The plan, improved and audited.
            held: Wheel speeds commanded until now, shape ``(2,)`` [rad/s].
        """
        plan, settings = candidate.plan, self._settings
        swept = plan.poses[0], plan.controls, plan.horizon.durations
        miss = math.dist(plan.poses[-1, :2], settings.goal)
        return Merit(
            candidate.usable,
            _depth(self._obstacles.check(*swept).worst_margin) if settings.obstacles else 0.0,
            _depth(self._road.check(*swept).worst_margin),
            0.0 if miss <= settings.goal_tolerance else miss,
            candidate.improvement.elastic,
            self._cost(plan.poses, plan.controls, held),
        )

    def is_flawed(self, candidate: Candidate) -> bool:
        """`Merit.flawed` of a candidate, without the rest of its merit."""
        miss = math.dist(candidate.plan.poses[-1, :2], self._settings.goal)
        touches = candidate.verdict.worst_margin < -_TOUCH
        return not candidate.flawless or touches or miss > self._settings.goal_tolerance

    def _cost(self, poses: Array, controls: Array, held: Array) -> float:
        road, weights = self._settings.road, self._settings.weights
        off = np.hypot(poses[:, 0] - road.center[0], poses[:, 1] - road.center[1])
        cost = weights.road_center * float(((off - road.center_radius) ** 2).sum())
        if weights.control_effort > 0.0:
            cost += weights.control_effort * float((controls**2).sum())
        if weights.control_rate > 0.0:
            changes = np.diff(controls, axis=0, prepend=held[None])
            cost += weights.control_rate * float((changes**2).sum())
        return cost / 2.0


def _depth(margin: float) -> float:
    """Of a path in what it comes too close to; a path that is not finite is infinitely deep."""
    return -margin if margin < -_TOUCH else 0.0
