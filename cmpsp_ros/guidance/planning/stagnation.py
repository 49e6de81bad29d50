"""Whether a plan that cannot reach the goal gets the robot any nearer to it: else it waits.

A road that is closed leaves time over. Nothing in the cost keeps a robot from spending it on the
move, to and fro before what is in its way, clear of everything and to no end.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from cmpsp_ros.guidance.decision import Plan
from cmpsp_ros.guidance.horizon import NANOSECONDS
from cmpsp_ros.guidance.planning.candidate import Candidate
from cmpsp_ros.guidance.planning.planning_context import PlanningContext
from cmpsp_ros.world.roads import remaining_arc_length

PATIENCE: Final = 3
"""Control steps for which a plan that gains too little is driven: it may yet be improved."""

# What a plan must gain to be worth driving [m], as a fraction of what the wheels could drive, and
# by when [ns]. What it gains later may be what it only loses first.
_WORTH_WHILE = 0.05
_FRACTION = 0.1
_SOON = NANOSECONDS


def reason_to_wait(
    idle_steps: int, context: PlanningContext, selected: Candidate
) -> tuple[str, int]:
    """Why the robot should rather wait than follow a plan; empty where it should not.

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
    if _gains_enough(context, selected.plan):
        return '', idle_steps
    if idle_steps < PATIENCE:
        return '', idle_steps + 1
    error = selected.terminal_error
    reason = f'The robot waits: no plan soon gets it nearer to the goal, {error:.3g} m off at best.'
    return reason, idle_steps + 1


def _gains_enough(context: PlanningContext, plan: Plan) -> bool:
    """Whether a plan soon gets nearer to the goal: along the road, around a map or straight."""
    start, goal, edges = context.start, context.goal, plan.horizon.edges
    soon = max(1, int(edges.searchsorted(edges[0] + _SOON, side='right')) - 1)
    reach = start.robot.max_speed * float(edges[soon] - edges[0]) / NANOSECONDS
    poses = np.ascontiguousarray(plan.poses[: soon + 1])
    road = start.world.road
    along = np.abs(remaining_arc_length(road, poses, goal.position, goal.heading, start.progress))
    lengths = [along, np.hypot(*(poses[:, :2] - goal.position).T)]
    search = start.world.map_search(context.settings)
    if search is not None:
        around = search.lengths(poses[:, :2], goal.position)
        lengths = [around] if np.isfinite(around[0]) else lengths
    gain = max(float(each[0] - each.min()) for each in lengths)
    return gain >= min(_WORTH_WHILE, _FRACTION * reach)
