"""Reasons to wait rather than to follow a plan."""

from __future__ import annotations

import math
from typing import Final

from cmpsp_ros.guidance.decision import Plan
from cmpsp_ros.guidance.planning.candidate import Candidate
from cmpsp_ros.guidance.planning.planning_context import PlanningContext
from cmpsp_ros.guidance.prediction.estimator import PlanStart
from cmpsp_ros.guidance.settings import LawSettings

PATIENCE: Final = 3
"""Control steps for which a plan that gains too little is driven: it may yet be improved."""

_TINY: Final = 1e-6
"""Tolerance of lengths and of angles [m, rad]."""

_SOON: Final = 2.0
"""Time within which the robot must be able to meet a moving obstacle for that to matter [s]."""
_FAST: Final = 4.0
"""Speed of a robot without a limit, for that [m/s]."""


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
