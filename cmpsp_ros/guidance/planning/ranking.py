"""How good a plan is: violated constraints by their priority, then its cost."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from cmpsp_ros.arrays import Array
from cmpsp_ros.guidance.decision import Plan
from cmpsp_ros.guidance.formulation.priorities import BY_PRIORITY
from cmpsp_ros.guidance.horizon import NANOSECONDS
from cmpsp_ros.guidance.planning.candidate import Candidate
from cmpsp_ros.guidance.planning.initial_trajectories import wrapped
from cmpsp_ros.guidance.prediction.estimator import PlanStart
from cmpsp_ros.guidance.settings import LawSettings
from cmpsp_ros.mpsp.jit import allocation_free
from cmpsp_ros.robots import Kinematics, fastest_wheel
from cmpsp_ros.world.roads import RoadSpace, road_functions

# A plan is replaced only by one that leaves less than half of a flaw, or costs so much less: two
# plans that are about as good must not take turns.
_CLEARLY_LESS = 0.5
_CLEARLY_CHEAPER = 0.8
# A plan that costs so much more will not be selected while the other one is without a flaw.
_HOPELESSLY_DEAR = 2.0

# Fraction of the wheels' limit that a plan should leave over, and what is clearly more or less.
_ENOUGH = 0.1
_SCARCE = 0.04
_MORE, _LESS = 0.015, 0.01

# Accuracy to which an active constraint of a linearisation is met [m].
_TOUCH = 1e-3


class Score(NamedTuple):
    """What plans are compared by, in this order; what is violated in that of `BY_PRIORITY`.

    Attributes:
        admissible: Whether the plan may be followed at all.
        obstacle: How deep it is in an obstacle or the margin kept from it [m]; 0 for not.
        edge: How far it is off the road or in the margin kept from its edges [m]; 0 for not.
        terminal_error: How far from the goal it ends [m]; 0 within the tolerance.
        elastic: Whether its last iteration needed slack.
        slack: How much, where nothing else is measured [m]; otherwise 0.
        turns: How often it winds around itself.
        reserve: Fraction of the time left that it could do without, were its wheels always at
            their limit; what is more than enough does not count.
        cost: The cost (95) of its path and its controls, without the proximal term.
    """

    admissible: bool
    obstacle: float = 0.0
    edge: float = 0.0
    terminal_error: float = 0.0
    elastic: bool = False
    slack: float = 0.0
    turns: int = 0
    reserve: float = 0.0
    cost: float = 0.0

    @property
    def flawed(self) -> bool:
        """Whether another plan should be looked for."""
        misses = self.obstacle > 0.0 or self.edge > 0.0 or self.terminal_error > 0.0
        return not self.admissible or self.elastic or misses or self.turns > 0

    def beats(self, other: Score) -> bool:
        """Whether to replace another plan: only for one that is clearly better."""
        if self.admissible != other.admissible:
            return self.admissible
        for each in BY_PRIORITY:
            mine, its = getattr(self, each), getattr(other, each)
            if mine < _CLEARLY_LESS * its:
                return True
            if mine > its:
                return False
        if self.elastic != other.elastic:
            return other.elastic
        if self.slack != other.slack:
            return self.slack < _CLEARLY_LESS * other.slack
        if self.turns != other.turns:
            return self.turns < other.turns
        if abs(self.reserve - other.reserve) > (_MORE if self.reserve > other.reserve else _LESS):
            return self.reserve > other.reserve
        return self.cost < _CLEARLY_CHEAPER * other.cost

    def is_worse_than(self, other: Score) -> bool:
        """Whether it has no advantage over the plan followed for the time being."""
        return self.flawed or self.cost > other.cost

    def outclasses(self, other: Score) -> bool:
        """Whether the other plan is not worth being kept beside this one."""
        return not self.flawed and (other.flawed or other.cost > _HOPELESSLY_DEAR * self.cost)


class Ranking:
    """Scores plans for one set of settings; by slack alone where only one plan is kept."""

    def __init__(self, settings: LawSettings, *, compares: bool) -> None:
        """Take limits and weights from the settings.

        Args:
            settings: All settings of the guidance law.
            compares: Whether several plans are compared.
        """
        self._settings, self._compares = settings, compares
        # A plan that uses up the margin for the goal's sake is unsafe before it touches anything.
        self._kept = settings.safety.margin

    def score(self, candidate: Candidate, start: PlanStart) -> Score:
        """Score of an improved and audited plan, which begins there."""
        result, verdict = candidate.result, candidate.verdict
        if not self._compares:
            return Score(candidate.admissible, elastic=result.elastic, slack=result.slack)
        error = candidate.terminal_error
        winding, off_center = _along(candidate.plan.poses, start.world.road_space)
        return Score(
            candidate.admissible,
            _depth(verdict.obstacle_margin - self._kept),
            _depth(verdict.edge_margin - self._kept),
            0.0 if error <= self._settings.goal_tolerance else error,
            result.elastic,
            0.0,
            _turns(winding),
            min(self._reserve(candidate.plan), _ENOUGH),
            self._cost(candidate.plan, start.previous_control, off_center),
        )

    def needs_replanning(self, candidate: Candidate, start: PlanStart) -> bool:
        """Whether a candidate has a flaw, or hardly anything in reserve."""
        if not self._compares or not candidate.feasible:
            return not candidate.feasible
        return (
            candidate.verdict.worst_margin < -_TOUCH
            or candidate.terminal_error > self._settings.goal_tolerance
            or _turns(_along(candidate.plan.poses, start.world.road_space)[0]) > 0
            or self._reserve(candidate.plan) < _SCARCE
        )

    def _reserve(self, plan: Plan) -> float:
        """Fraction of the time left that a plan could do without at full speed; 1 if unlimited.

        A disturbance costs time, and nothing in the cost keeps any.
        """
        edges = plan.horizon.edges
        robot = self._settings.robot.kinematics
        needed = _turned(plan.controls, plan.horizon.durations, robot)
        left = (edges.item(-1) - edges.item(0)) / NANOSECONDS
        return 1.0 - needed / robot.max_wheel_speed / left

    def _cost(self, plan: Plan, previous_control: Array, off_center: float) -> float:
        controls, weights = plan.controls, self._settings.weights
        cost = weights.road_center * off_center
        if weights.control_effort > 0.0:
            cost += weights.control_effort * float((controls**2).sum())
        if weights.control_rate > 0.0:
            changes = np.diff(controls, axis=0, prepend=previous_control[None])
            cost += weights.control_rate * float((changes**2).sum())
        return cost / 2.0


def _turns(winding: float) -> int:
    """Full turns; turning round at first is none."""
    return int(abs(winding) / math.tau + 0.25) if math.isfinite(winding) else 0


@allocation_free
def _turned(controls: Array, durations: Array, robot: Kinematics) -> float:
    """Angle that the fastest wheel of each step turns, in all [rad]."""
    total = 0.0
    for k in range(durations.shape[0]):
        total += fastest_wheel(controls, k, robot) * durations[k]
    return total


@allocation_free
def _along(poses: Array, road: RoadSpace) -> Any:
    """By how much the heading turns beside the road's [rad], and squared lateral errors [m^2]."""
    last = poses.shape[0] - 1
    beside, total, before = poses[last, 2] - poses[0, 2], 0.0, math.nan
    progress = road_functions.project(road, poses[0, 0], poses[0, 1], poses[0, 2], math.nan)
    for k in range(poses.shape[0]):
        x, y = poses[k, 0], poses[k, 1]
        progress, off, _, _ = road_functions.lateral_error(road, 0, x, y, progress)
        across_x, across_y, _, _, _, _, _ = road_functions.gradients(road, x, y, progress)
        bearing = math.atan2(across_y, across_x)
        if k > 0:
            beside -= wrapped(bearing - before)
        before = bearing
        total += off * off
    return beside, total


def _depth(margin: float) -> float:
    """Penetration of a path; a path that is not finite is infinitely deep."""
    return -margin if margin < -_TOUCH else 0.0
