"""The robot makes way for what comes at it, where its plan leads into that."""

from __future__ import annotations

import math
from typing import NamedTuple

from cmpsp_ros.guidance.commands.decision_builder import DecisionBuilder
from cmpsp_ros.guidance.decision import Decision, FallbackLevel, Plan
from cmpsp_ros.guidance.planning.candidate import Candidate
from cmpsp_ros.guidance.planning.planning_context import PlanningContext
from cmpsp_ros.guidance.planning.retreat import RetreatPlanner
from cmpsp_ros.guidance.prediction.estimator import Observation
from cmpsp_ros.guidance.safety.approach import Approach, Contact
from cmpsp_ros.guidance.safety.validation import Validation, Validator
from cmpsp_ros.guidance.settings import LawSettings
from cmpsp_ros.guidance.state import LawState


class Choice(NamedTuple):
    """The plan to follow, before it is slowed down."""

    level: FallbackLevel
    reason: str  # why that level
    plan: Plan
    verdict: Validation  # of its check
    ahead: Contact | None  # the first thing that it leads into
    standby: Plan | None = None  # the plan to the goal, where this one makes way; None otherwise


class Checks(NamedTuple):
    """Parts that every choice of a plan needs."""

    validator: Validator
    approach: Approach  # slows plans down before obstacles
    decisions: DecisionBuilder


class MakingWay:
    """Chooses a retreat where the plan to the goal, and standing, would both end in contact."""

    def __init__(self, settings: LawSettings, checks: Checks) -> None:
        """Take what checks plans, and what decides on them."""
        self._retreats = RetreatPlanner(settings)
        self._longest_wait = math.ceil(self._retreats.seconds / settings.control_period)
        self._validator, self._approach, self._decisions = checks

    def choose(
        self, state: LawState, seen: Observation, context: PlanningContext, selected: Candidate
    ) -> Choice | Decision | None:
        """Make way, or wait until it has passed; None if nothing comes at the robot.

        Where people keep passing it goes on after a while, and makes way again if it has to.
        """
        following, start, known = state.following, context.start, state.following.refuge
        waited, following.refuge, following.waited = following.waited, None, 0
        threats = self._retreats.threats(start)
        if not threats.names:
            return None
        for_long, plan = known is not None, selected.plan
        is_blocked = self._retreats.is_blocked(plan, start, threats, for_long=for_long)
        if selected.result.solved and not is_blocked:
            return None
        threat = self._retreats.touched_at_rest(start, threats)
        if not threat and (known is None or waited >= self._longest_wait):
            return None
        following.wait(selected.plan)
        if not threat:
            following.refuge, following.waited = known, waited + 1
            reason = 'The robot has made way, and waits until its path is clear.'
            return self._decisions.stop(state, seen.stamp, seen.pose, reason, moving=start.moving)
        found = self._retreats.find(start, context.horizon, context.delay, threats, known)
        if found is None:
            return None
        plan, following.refuge = found
        durations = context.horizon.durations
        verdict = self._validator.check(start, plan.controls, durations, context.pending)
        ahead = self._approach.contact(plan, start, verdict.worst_margin)
        x, y = following.refuge
        reason = f'The robot makes way for {threat}, to ({x:.2f}, {y:.2f}).'
        return Choice(FallbackLevel.ELASTIC, reason, plan, verdict, ahead, selected.plan)
