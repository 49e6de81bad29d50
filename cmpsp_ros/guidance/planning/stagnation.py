"""Whether a plan that cannot reach the goal gets the robot any nearer to it: else it waits.

A road that is closed leaves time over. Nothing in the cost keeps a robot from spending it on the
move, to and fro before what is in its way, clear of everything and to no end.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from cmpsp_ros.guidance.goals import Target
from cmpsp_ros.guidance.horizon import NANOSECONDS
from cmpsp_ros.guidance.planning.candidate import Candidate
from cmpsp_ros.guidance.prediction.plan_start import PlanStart
from cmpsp_ros.world.roads.arc_length import remaining_arc_length
from cmpsp_ros.world.roads.road import Road

PATIENCE: Final = 3
"""Control steps for which a plan that gains too little is driven: it may yet be improved."""

# What a plan must gain to be worth driving [m], as a fraction of what the wheels could drive, and
# by when [ns]. What it gains later may be what it only loses first.
_WORTH_WHILE = 0.05
_FRACTION = 0.1
_SOON = NANOSECONDS


def gains_enough(road: Road, start: PlanStart, target: Target, candidate: Candidate) -> bool:
    """Whether a plan soon gets nearer to the goal, along the road or straight.

    Args:
        road: The road.
        start: Where the plan begins.
        target: The goal.
        candidate: The plan.
    """
    plan, edges = candidate.plan, candidate.plan.horizon.edges
    soon = max(1, int(edges.searchsorted(edges[0] + _SOON, side='right')) - 1)
    reach = start.robot.max_speed * float(edges[soon] - edges[0]) / NANOSECONDS
    poses = np.ascontiguousarray(plan.poses[: soon + 1])
    along = np.abs(
        remaining_arc_length(road, poses, target.position, target.heading, start.progress)
    )
    straight = np.hypot(*(poses[:, :2] - target.position).T)
    gain = float(max(along[0] - along.min(), straight[0] - straight.min()))
    return gain >= min(_WORTH_WHILE, _FRACTION * reach)
