"""Candidates: plans after their iterations and the trajectory check, and how they compare."""

from __future__ import annotations

import math
from typing import Any, Final, NamedTuple

import numpy as np

from cmpsp_ros.arrays import Array
from cmpsp_ros.guidance.decision import Plan
from cmpsp_ros.guidance.formulation.ocp_formulation import BY_PRIORITY
from cmpsp_ros.guidance.goals import Target
from cmpsp_ros.guidance.planning.homotopy.road_frame import wrapped
from cmpsp_ros.guidance.prediction.estimator import PlanStart
from cmpsp_ros.guidance.safety.unseen import drives_blind
from cmpsp_ros.guidance.safety.validation import TOUCHING, Validation, Validator
from cmpsp_ros.guidance.settings import LawSettings
from cmpsp_ros.guidance.times import NANOSECONDS
from cmpsp_ros.mpsp.jit import allocation_free
from cmpsp_ros.robots.motion import Kinematics, fastest_wheel
from cmpsp_ros.world.roads import RoadSpace, road_functions

# Hysteresis: a plan is replaced only by one that leaves less than half of a flaw, or costs so much
# less. Two plans that are about as good must not take turns.
_CLEARLY_LESS: Final = 0.5
_CLEARLY_CHEAPER: Final = 0.8
_HOPELESSLY_DEAR: Final = 2.0  # relative cost of a plan that another one without a flaw rules out
_ENOUGH: Final = 0.1  # reserve that a plan should leave, as a fraction of the limit
_SCARCE: Final = 0.04  # the same at which it is replanned
_MORE, _LESS = 0.015, 0.01  # differences of reserve that are clear
_TOUCH: Final = 1e-3  # accuracy to which an active constraint of a linearisation is met [m]


class SolveResult(NamedTuple):
    """A plan after its iterations."""

    plan: Plan
    solved: bool  # whether the subproblem of the last iteration was solved
    elastic: bool  # whether slack was needed in it
    slack: float  # largest violation that the slack stands for [m]
    # indices of the path constraints with slack, outer and inner edge first
    slack_where: tuple[int, ...]
    slack_terminal: bool  # whether the terminal constraint has slack
    iterations: int  # done
    qp_iterations: int  # iterations of the QP back end in the last one
    active_rows: int  # constraints active in the last one
    reason: str  # status of the last one, in words
    work: int = 0  # visits of a stage that the iterations took; 0 if they are not counted
    brakes_late: bool = False  # whether there is no time left to come to rest within the jerk limit


class Candidate(NamedTuple):
    """A plan that may be followed."""

    plan: Plan
    result: SolveResult
    verdict: Validation  # validation on it and on the path to its beginning
    admissible: bool  # whether it may be followed at all
    feasible: bool  # whether it meets every constraint, too
    is_relaxed: bool  # whether some constraint is not met, now or in the linearised plan
    terminal_error: float  # distance of its end from the goal [m]
    heading_error: float | None  # error of its last heading [rad]; None where any will do

    @classmethod
    def of(cls, result: SolveResult, verdict: Validation, target: Target) -> Candidate:
        """The candidate that a checked result is."""
        plan, elastic = result.plan, result.elastic
        admissible = result.solved and verdict.passed
        flags = admissible, admissible and not elastic, elastic or verdict.margin < -TOUCHING
        return cls(plan, result, verdict, *flags, *target.errors(plan.poses[-1]))

    def reaches_goal(self, settings: LawSettings, tolerances: float = 1.0) -> bool:
        """True if the plan ends within so many tolerances of the goal and its heading."""
        return settings.tolerates(self.terminal_error, self.heading_error, tolerances)

    def describe(self, validator: Validator, settings: LawSettings, start: PlanStart) -> str:
        """Sentence on it for when it is followed."""
        result, verdict, error = self.result, self.verdict, self.terminal_error
        off = self.heading_error or 0.0
        if result.elastic:
            where = validator.names(result.slack_where, start.world, start.moving)
            parts, ending = [where] if where else [], ''
            if result.slack_terminal:
                parts.append('the goal')
                turned = (
                    f', {off:.3g} rad off its heading' if off > settings.heading_tolerance else ''
                )
                ending = f' The plan ends {error:.3g} m from the goal{turned}.'
            return (
                f'The constraints contradict each other: {result.slack:.3g} m of slack at'
                f' {" and ".join(parts)}.{ending}'
            )
        flaw = ''
        if verdict.worst_margin < 0.0:
            begins = verdict.margin < -TOUCHING
            how = 'the way begins' if begins else 'later on the plan still comes'
            flaw = f'{how} {-verdict.worst_margin:.3g} m too close to {verdict.nearest}'
        elif error > settings.goal_tolerance:
            flaw = f'the plan still ends {error:.3g} m from the goal'
        elif off > settings.heading_tolerance:
            flaw = f"the plan still ends {off:.3g} rad off the goal's heading"
        return f'No slack was needed, but {flaw}.' if flaw else 'The plan meets every constraint.'


class Score(NamedTuple):
    """Criteria by which plans are compared, in this order; violations in that of `BY_PRIORITY`."""

    admissible: bool = True  # whether the plan may be followed at all
    obstacle: float = 0.0  # depth in an obstacle or the margin kept from it [m]; 0 for none
    edge: float = 0.0  # distance off the road or in the margin kept from its edges [m]; 0 for none
    terminal_error: float = 0.0  # distance of its end from the goal [m]; 0 within the tolerance
    elastic: bool = False  # whether its last iteration needed slack
    slack: float = 0.0  # amount of slack, where nothing else is measured [m]; otherwise 0
    turns: int = 0  # number of times it winds around itself
    blind: bool = False  # whether it drives backward to where nothing has been seen
    reserve: float = 0.0  # fraction of the time left to spare at full speed; at most `_ENOUGH`
    cost: float = 0.0  # cost (95) of its path and its controls, without the proximal term

    @property
    def flawed(self) -> bool:
        """True if another plan should be looked for."""
        misses = self.obstacle > 0.0 or self.edge > 0.0 or self.terminal_error > 0.0
        return not self.admissible or self.elastic or misses or self.turns > 0 or self.blind

    def beats(self, other: Score) -> bool:
        """True if it is clearly better than another plan, and should replace it."""
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
        if self.blind != other.blind:
            return other.blind
        if abs(self.reserve - other.reserve) > (_MORE if self.reserve > other.reserve else _LESS):
            return self.reserve > other.reserve
        return self.cost < _CLEARLY_CHEAPER * other.cost

    def is_worse_than(self, other: Score) -> bool:
        """True if it has no advantage over the plan followed at present."""
        return self.flawed or self.cost > other.cost

    def outclasses(self, other: Score) -> bool:
        """True if the other plan is not worth keeping as an alternative."""
        return not self.flawed and (other.flawed or other.cost > _HOPELESSLY_DEAR * self.cost)


class Ranking:
    """Scores plans for one set of settings; by slack alone where only one plan is kept."""

    def __init__(self, settings: LawSettings, *, compares: bool) -> None:
        self._settings, self._compares = settings, compares
        self._goal_tolerance = settings.goal_tolerance

    def score(self, candidate: Candidate, start: PlanStart) -> Score:
        """Score of an improved and checked plan, which begins there."""
        result, verdict = candidate.result, candidate.verdict
        if not self._compares:
            return Score(candidate.admissible, elastic=result.elastic, slack=result.slack)
        # A plan that uses up the margin for the goal's sake is unsafe before it touches anything.
        margin, error = self._settings.safety.margin, candidate.terminal_error
        winding, off_center = _along(candidate.plan.poses, start.world.road_space)
        return Score(
            admissible=candidate.admissible,
            obstacle=_depth(verdict.obstacle_margin - margin),
            edge=_depth(verdict.edge_margin - margin),
            terminal_error=0.0 if error <= self._goal_tolerance else error,
            elastic=result.elastic,
            turns=_turns(winding),
            blind=drives_blind(self._settings, candidate.plan, start),
            reserve=min(reserve(candidate.plan, self._settings.robot.kinematics), _ENOUGH),
            cost=self._cost(candidate.plan, start.previous_control, off_center),
        )

    def needs_replanning(self, candidate: Candidate, start: PlanStart) -> bool:
        """True if a candidate has a flaw, or hardly any reserve."""
        if not self._compares or not candidate.feasible:
            return not candidate.feasible
        plan = candidate.plan
        return (
            candidate.verdict.worst_margin < -_TOUCH
            or candidate.terminal_error > self._goal_tolerance
            or _turns(_along(plan.poses, start.world.road_space)[0]) > 0
            or reserve(plan, self._settings.robot.kinematics) < _SCARCE
            or (start.world.seen is not None and drives_blind(self._settings, plan, start))
        )

    def _cost(self, plan: Plan, previous_control: Array, off_center: float) -> float:
        """Cost (95) without its proximal term, with the weights of controls and their changes."""
        controls, weights = plan.controls, self._settings.plan_weights
        cost = weights.road_center * off_center
        if weights.control_effort > 0.0:
            cost += weights.control_effort * float((controls**2).sum())
        if weights.control_rate > 0.0:
            changes = np.diff(controls, axis=0, prepend=previous_control[None])
            cost += weights.control_rate * float((changes**2).sum())
        return cost / 2.0


def reserve(plan: Plan, robot: Kinematics) -> float:
    """Fraction of the time left over at full speed, 1 - sum_k max_i |w_ki| dt_k / (w_max T)."""
    edges = plan.horizon.edges
    needed = _turned(plan.controls, plan.horizon.durations, robot)
    left = (edges.item(-1) - edges.item(0)) / NANOSECONDS
    return 1.0 - needed / robot.max_wheel_speed / left


def _turns(winding: float) -> int:
    """Full turns; turning round at the beginning is none."""
    return int(abs(winding) / math.tau + 0.25) if math.isfinite(winding) else 0


@allocation_free
def _turned(controls: Array, durations: Array, robot: Kinematics) -> float:
    """Sum of the angles that the fastest wheel of each step turns [rad]."""
    total = 0.0
    for k in range(durations.shape[0]):
        total += fastest_wheel(controls, k, robot) * durations[k]
    return total


@allocation_free
def _along(poses: Array, road: RoadSpace) -> Any:
    """Turn of the heading relative to the road [rad], and sum of squared lateral errors [m^2]."""
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
    """Penetration of a path [m]; infinite for a path that is not finite."""
    return -margin if margin < -_TOUCH else 0.0
