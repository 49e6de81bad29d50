"""How good a plan is: what it touches comes first, then the goal, then what it costs."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cmpsp_ros.guidance.decision import Plan
from cmpsp_ros.guidance.horizon import NANOSECONDS
from cmpsp_ros.guidance.planning.candidate import Candidate
from cmpsp_ros.guidance.settings import GuidanceSettings
from cmpsp_ros.mpsp.jit.compiled import allocation_free

Array = NDArray[np.float64]

# A plan changes over only to one that leaves less than half of a flaw, or costs so much less:
# two plans that are about as good must not take turns.
_CLEARLY_LESS = 0.5
_CLEARLY_CHEAPER = 0.8
# So much dearer a plan has no prospect of being followed, while the other one is sound.
_HOPELESSLY_DEAR = 2.0

# Part of the wheels' limit that a plan should leave over, and what is clearly more or less of it.
_ENOUGH = 0.1
_SCARCE = 0.04
_MORE, _LESS = 0.015, 0.01

# As far as an active constraint of a linearisation may be off.
_TOUCH = 1e-3


class Merit(NamedTuple):
    """What plans are compared by, in this order.

    Attributes:
        usable: Whether the plan may be followed at all.
        obstacle: How deep it is in an obstacle or the margin kept from it [m]; 0 for not.
        edge: How far it is off the road or in the margin kept from its edges [m]; 0 for not.
        miss: How far from the goal it ends [m]; 0 within the tolerance.
        elastic: Whether its last iteration needed slack.
        turns: How often it winds around itself.
        reserve: Part of the time left that it could do without, were its wheels always at their
            limit; what is more than enough does not count.
        cost: The cost (95) of its path and its controls, without the proximal term.
    """

    usable: bool
    obstacle: float
    edge: float
    miss: float
    elastic: bool
    turns: int
    reserve: float
    cost: float

    @property
    def flawed(self) -> bool:
        """Whether another plan should be looked for."""
        touches = self.obstacle > 0.0 or self.edge > 0.0
        return not self.usable or self.elastic or touches or self.miss > 0.0 or self.turns > 0

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
        if self.turns != other.turns:
            return self.turns < other.turns
        if abs(self.reserve - other.reserve) > (_MORE if self.reserve > other.reserve else _LESS):
            return self.reserve > other.reserve
        return self.cost < _CLEARLY_CHEAPER * other.cost

    def is_worse_than(self, other: Merit) -> bool:
        """Whether it has no advantage over the plan followed for the time being."""
        return self.flawed or self.cost > other.cost

    def outclasses(self, other: Merit) -> bool:
        """Whether the other plan is not worth being kept beside this one."""
        return not self.flawed and (other.flawed or other.cost > _HOPELESSLY_DEAR * self.cost)


class Judge:
    """Measures the merit of plans for one set of settings, on a road between two circles."""

    def __init__(self, settings: GuidanceSettings) -> None:
        """Take limits, road, obstacles and weights from the settings."""
        self._settings = settings
        # Who takes a bit of the margin for the goal's sake is unsafe before it touches anything.
        self._kept = settings.safety.margin

    def aim(self, settings: GuidanceSettings) -> None:
        """Take another goal; nothing else of the settings may differ."""
        self._settings = settings

    def merit(self, candidate: Candidate, held: Array) -> Merit:
        """Merit of a candidate.

        Args:
            candidate: The plan, improved and audited.
            held: Wheel speeds commanded until now, shape ``(2,)`` [rad/s].
        """
        plan, verdict, settings = candidate.plan, candidate.verdict, self._settings
        miss = math.dist(plan.poses[-1, :2], settings.goal)
        return Merit(
            candidate.usable,
            _depth(verdict.obstacle_margin - self._kept),
            _depth(verdict.edge_margin - self._kept),
            0.0 if miss <= settings.goal_tolerance else miss,
            candidate.improvement.elastic,
            self._turns(plan.poses),
            min(self._reserve(plan), _ENOUGH),
            self._cost(plan.poses, plan.controls, held),
        )

    def is_wanting(self, candidate: Candidate) -> bool:
        """Whether a candidate has a flaw, or hardly anything to spare; without all its merit."""
        miss = math.dist(candidate.plan.poses[-1, :2], self._settings.goal)
        touches = candidate.verdict.worst_margin < -_TOUCH
        winds = self._turns(candidate.plan.poses) > 0
        if not candidate.flawless or touches or winds or miss > self._settings.goal_tolerance:
            return True
        return self._reserve(candidate.plan) < _SCARCE

    def _turns(self, poses: Array) -> int:
        """Full turns of the heading beside those of the road; turning round at first is none."""
        x, y = self._settings.annulus.center
        (x_0, y_0, before), (x_N, y_N, after) = poses[0].tolist(), poses[-1].tolist()
        way = math.atan2(y_N - y, x_N - x) - math.atan2(y_0 - y, x_0 - x)
        beside = after - before - math.remainder(way, math.tau)
        return int(abs(beside) / math.tau + 0.25) if math.isfinite(beside) else 0

    def _reserve(self, plan: Plan) -> float:
        """Part of the time left that a plan could do without at full speed; 1 without a limit.

        What is disturbed costs time, and nothing in the cost keeps any.
        """
        horizon = plan.horizon
        needed = _turned(plan.controls, horizon.durations)
        left = float(horizon.edges[-1] - horizon.edges[0]) / NANOSECONDS
        return 1.0 - needed / self._settings.robot.max_wheel_speed / left

    def _cost(self, poses: Array, controls: Array, held: Array) -> float:
        road, weights = self._settings.annulus, self._settings.weights
        cost = weights.road_center * _off_center(poses, *road.center, road.center_radius)
        if weights.control_effort > 0.0:
            cost += weights.control_effort * float((controls**2).sum())
        if weights.control_rate > 0.0:
            changes = np.diff(controls, axis=0, prepend=held[None])
            cost += weights.control_rate * float((changes**2).sum())
        return cost / 2.0


@allocation_free
def _turned(controls: Array, durations: Array) -> float:
    """Angle that the faster wheel of each step turns, in all [rad]."""
    total = 0.0
    for k in range(durations.shape[0]):
        total += max(abs(controls[k, 0]), abs(controls[k, 1])) * durations[k]
    return total


@allocation_free
def _off_center(poses: Array, x: float, y: float, radius: float) -> float:
    """Squared distances from a circle, in all [m^2]."""
    total = 0.0
    for k in range(poses.shape[0]):
        total += (math.hypot(poses[k, 0] - x, poses[k, 1] - y) - radius) ** 2
    return total


def _depth(margin: float) -> float:
    """Of a path in what it comes too close to; a path that is not finite is infinitely deep."""
    return -margin if margin < -_TOUCH else 0.0
