"""Clearance along a plan, stage by stage, for displays; it decides nothing."""

from __future__ import annotations

import numpy as np

from cmpsp_ros.arrays import Array
from cmpsp_ros.guidance.decision import Decision
from cmpsp_ros.guidance.prediction.estimator import ObstacleTracker, as_expected, within_reach
from cmpsp_ros.guidance.settings import LawSettings
from cmpsp_ros.guidance.times import NANOSECONDS
from cmpsp_ros.guidance.world import World


def plan_clearance(settings: LawSettings, world: World, decision: Decision) -> Array:
    """Least clearance ``(N + 1,)`` [m] of a plan from each pose to the next, and at the last.

    From road edges and obstacles, moving ones too, minus the robot's radius; its minimum is the
    decision's `worst_margin` where no command is pending. ValueError for a decision without a plan.
    """
    plan, radius = decision.plan, settings.robot_radius
    if plan is None:
        raise ValueError('decision: found one without a plan, wanted one with a plan')
    # The end is an arc that takes no time.
    durations = np.append(plan.horizon.durations, 0.0)
    twists = (1.0 - decision.wheel_slip) * settings.robot.twist(plan.controls)
    clearance = world.free_space(settings).along(plan.poses, twists, durations)
    if decision.tracks:
        known = settings.moving_obstacles
        begin = plan.poses[0]
        near = within_reach(decision.tracks, begin, settings.robot.max_speed)
        tracks = as_expected(near, settings.control_period)
        moving = ObstacleTracker().update(decision.stamp, begin, tracks, known)
        times = plan.delay / NANOSECONDS + np.cumsum(durations) - durations
        points = settings.footprint.discs
        discs = moving.grown(radius).along(plan.poses, twists, durations, times, points)
        clearance = np.hstack([clearance, discs])
    return np.asarray(clearance.min(axis=1))
