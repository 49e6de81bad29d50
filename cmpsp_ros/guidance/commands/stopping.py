"""When the robot had better stop than follow a plan that it may follow."""

from __future__ import annotations

import math
from typing import Final

from cmpsp_ros.guidance.decision import Plan
from cmpsp_ros.guidance.planning.candidate import Candidate
from cmpsp_ros.guidance.planning.planning_context import PlanningContext
from cmpsp_ros.guidance.safety.approach import STANDSTILL, Approach, Contact
from cmpsp_ros.guidance.safety.audit import TOUCHING
from cmpsp_ros.guidance.state import LawState

PATIENCE: Final = 3
"""Control steps for which a plan that gains too little is driven: it may yet be improved."""

_TINY: Final = 1e-6
"""Of lengths and of angles [m, rad]."""


def closed_ahead(
    state: LawState, approach: Approach, context: PlanningContext, selected: Candidate
) -> Contact | None:
    """What closes the road; it is not looked for while plans lead to the goal.

    Args:
        state: Of the law, which keeps it.
        approach: Knows how fast the robot may be before it.
        context: The control step.
        selected: The plan that is selected.
    """
    settings, closed_road, start = context.settings, state.closed_road, context.start
    if len(start.moving):
        return None
    if not selected.feasible or selected.verdict.worst_margin < -TOUCHING:
        closed_road.look(settings, start, context.goal)
    return closed_road.ahead(settings, approach, start, state.now)


def reason_to_stop(
    state: LawState,
    context: PlanningContext,
    selected: Candidate,
    ahead: Contact | None,
    closed: Contact | None,
) -> str:
    """Why to stop rather than follow an admissible plan, in a sentence; empty for no reason.

    Args:
        state: Of the law, which counts what leads nowhere.
        context: The control step.
        selected: The plan that is selected.
        ahead: What it leads into.
        closed: What closes the road.
    """
    settings, why = context.settings, ''
    is_near = closed is not None and closed.speed < settings.robot.max_speed
    # Before a moving obstacle it is not safe to wait.
    if not len(context.start.moving):
        idle_steps = PATIENCE if is_near else state.idle_steps
        why, state.idle_steps = reason_to_wait(idle_steps, context, selected)
    if closed is not None:
        if why and is_near:
            return state.closed_road.wait_before(closed)
        return state.closed_road.reason_to_wait(closed, state.now) or why
    if not why and ahead is not None and ahead.speed < STANDSTILL and not _turns(selected.plan):
        return f'The robot stops: {ahead}'
    return why


def reason_to_wait(
    idle_steps: int, context: PlanningContext, selected: Candidate
) -> tuple[str, int]:
    """Reason to wait rather than follow a plan that soon gets no nearer to the goal, or empty.

    A closed road leaves time over. Nothing in the cost keeps a robot from spending it on the move,
    to and fro before what is in its way, clear of everything and to no end.

    Args:
        idle_steps: Control steps that brought the goal no nearer, since a plan could reach it.
        context: The control step.
        selected: The plan that is selected.

    Returns:
        The reason, and the idle steps with this one.
    """
    if not (selected.result.elastic and selected.result.slack_terminal):
        return '', 0
    # Patience comes back with the goal only: else it would be spent on driving to and fro.
    if context.is_gaining(selected.plan):
        return '', idle_steps
    if idle_steps < PATIENCE:
        return '', idle_steps + 1
    error = selected.terminal_error
    reason = f'The robot waits: no plan soon gets it nearer to the goal, {error:.3g} m off at best.'
    return reason, idle_steps + 1


def _turns(plan: Plan) -> bool:
    """Whether a plan begins with a turn on the spot: nothing comes nearer, and more is seen."""
    along = math.dist(plan.poses[0, :2], plan.poses[1, :2])
    return along < _TINY < abs(float(plan.poses[1, 2] - plan.poses[0, 2]))
