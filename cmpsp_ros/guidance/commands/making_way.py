"""Reasons not to follow the plan: the robot makes way for what comes at it, or waits."""

import math
from typing import Final, NamedTuple

from cmpsp_ros.guidance.commands.decision_builder import DecisionBuilder, Step
from cmpsp_ros.guidance.decision import Decision, FallbackLevel, Plan
from cmpsp_ros.guidance.planning.candidate import Candidate
from cmpsp_ros.guidance.planning.planning_context import PlanningContext
from cmpsp_ros.guidance.planning.retreat import RetreatPlanner
from cmpsp_ros.guidance.prediction.estimator import PlanStart
from cmpsp_ros.guidance.safety.approach import Approach, Contact
from cmpsp_ros.guidance.safety.validation import Validation, Validator
from cmpsp_ros.guidance.settings import LawSettings

PATIENCE: Final = 3  # steps for which a plan that gains too little is driven: it may improve
_TINY: Final = 1e-6  # tolerance of lengths and of angles [m, rad]
_SOON: Final = 2.0  # time within which a moving obstacle must be met for it to matter [s]
_FAST: Final = 4.0  # speed of a robot without a limit, for that [m/s]


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
        self._retreats = RetreatPlanner(settings)
        self._longest_wait = math.ceil(self._retreats.seconds / settings.control_period)
        self._validator, self._approach, self._decisions = checks

    def choose(self, step: Step, selected: Candidate) -> Choice | Decision | None:
        """Make way, or wait until it has passed; None if nothing comes at the robot.

        Where people keep passing it goes on after a while, and makes way again if it has to.
        """
        state, _, _, context = step
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
            return self._decisions.stand(step, reason)
        found = self._retreats.find(context, threats, known)
        if found is None:
            return None
        plan, following.refuge = found
        verdict = self._validator.check(
            start, plan.controls, context.horizon.durations, context.pending
        )
        ahead = self._approach.contact(plan, start, verdict.worst_margin)
        x, y = following.refuge
        reason = f'The robot makes way for {threat}, to ({x:.2f}, {y:.2f}).'
        return Choice(FallbackLevel.ELASTIC, reason, plan, verdict, ahead, selected.plan)


def meets_soon(settings: LawSettings, start: PlanStart) -> bool:
    """True if something that moves may soon be where the robot may be."""
    if not start.moving.names:
        return False
    reach = settings.circumscribed_radius + settings.safety.margin
    reach += _SOON * min(settings.robot.max_speed, _FAST)
    return bool(len(start.moving.within(start.pose, reach, _SOON)))


def reason_to_wait(
    idle_steps: int, context: PlanningContext, selected: Candidate
) -> tuple[str, int]:
    """Reason to wait rather than follow a plan that makes no progress, '' if none, and idle steps.

    Nothing in the cost keeps a robot from driving to and fro before a closed road. Idle steps, this
    one included, are those without progress since a plan could reach the goal.
    """
    if not selected.result.slack_terminal or selected.reaches_goal(context.settings):
        return '', 0
    # Patience comes back with the goal only: else it would be spent on driving to and fro.
    if context.is_gaining(selected.plan):
        return '', idle_steps
    if idle_steps < PATIENCE:
        return '', idle_steps + 1
    error = selected.terminal_error
    reason = f'The robot waits: no plan soon gets it nearer to the goal, {error:.3g} m off at best.'
    return reason, idle_steps + 1


def turns(plan: Plan) -> bool:
    """True if a plan begins with a turn on the spot: no progress, but more is seen."""
    along = math.dist(plan.poses[0, :2], plan.poses[1, :2])
    return along < _TINY < abs(float(plan.poses[1, 2] - plan.poses[0, 2]))
