"""A robot that is slowed down for somebody out of sight turns on the spot to look."""

import math
from typing import Final

import numpy as np

from cmpsp_ros.guidance.commands.recovery import turn_round
from cmpsp_ros.guidance.decision import Plan
from cmpsp_ros.guidance.planning.planning_context import PlanningContext
from cmpsp_ros.guidance.safety.reach_check import CREEP, LOST
from cmpsp_ros.guidance.safety.unseen import looks_ahead
from cmpsp_ros.guidance.safety.validation import Validation, Validator
from cmpsp_ros.robots.motion import speeds_and_turns

_SOON: Final = 2.0
"""Time in which somebody must be able to reach the robot to be looked for [s]."""


def turn_to_look(
    validator: Validator, context: PlanningContext, slowed: Plan
) -> tuple[Plan, Validation, str] | None:
    """Turn towards whoever may reach the robot soon from where no sensor looks, and a remark.

    None if nobody may, if the robot cannot turn there, or if the plan is faster than creeping.
    """
    settings, start, durations = context.settings, context.start, context.horizon.durations
    speed = abs(float(speeds_and_turns(start.robot.twist(slowed.controls[0]))[0]))
    if speed > CREEP or not start.robot.turns_on_the_spot:
        return None
    reachable = start.reachable
    near = reachable.within(start.pose, settings.circumscribed_radius, _SOON)
    doubt = reachable.states[near, 4] - start.touchable.states[near, 4]
    away = reachable.states[near, :2] - start.pose[:2]
    angles = np.arctan2(away[:, 1], away[:, 0]) - start.pose[2]
    for k in np.argsort(np.hypot(away[:, 0], away[:, 1]), kind='stable').tolist():
        angle = math.remainder(float(angles[k]), math.tau)
        towards = np.array([math.cos(angle), math.sin(angle), 0.0])
        if doubt[k] <= LOST or looks_ahead(settings, start, start.pose[None], towards):
            continue
        plan = turn_round(context, angle)
        verdict = validator.check(start, plan.controls, durations, context.pending)
        if verdict.passed:
            return plan, verdict, f' It turns to look for {reachable.names[near[k]]}.'
    return None
