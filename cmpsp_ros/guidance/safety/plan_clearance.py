"""Clearance along a plan, stage by stage."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cmpsp_ros.guidance.decision import Decision
from cmpsp_ros.guidance.horizon import NANOSECONDS
from cmpsp_ros.guidance.prediction.obstacle_tracker import ObstacleTracker
from cmpsp_ros.guidance.settings import GuidanceSettings
from cmpsp_ros.world.free_space import FreeSpace

Array = NDArray[np.float64]


class PlanClearance:
    """Clearance along plans, for displays; it decides nothing."""

    def __init__(self, settings: GuidanceSettings) -> None:
        """Take road, obstacles and robot from the settings."""
        self._settings = settings
        distance = settings.robot_radius
        self._space = FreeSpace.of(settings.road, settings.obstacles, distance)

    def along(self, decision: Decision) -> Array:
        """Least clearance of a plan from each pose to the next, and at the last.

        From road edges and obstacles, moving ones too, minus the robot's radius; its minimum is the
        decision's `worst_margin` where no command is pending.

        Args:
            decision: One with a plan of ``N`` stages.

        Returns:
            Shape ``(N + 1,)`` [m].

        Raises:
            ValueError: It has no plan.
        """
        plan, settings = decision.plan, self._settings
        if plan is None:
            raise ValueError('decision: found one without a plan, wanted one with a plan')
        # The end is an arc that takes no time.
        durations = np.append(plan.horizon.durations, 0.0)
        twists = (1.0 - decision.wheel_slip) * settings.robot.twist(plan.controls)
        clearance = self._space.along(plan.poses, twists, durations)
        if decision.tracks:
            moving = ObstacleTracker().update(
                decision.stamp, plan.poses[0], decision.tracks, settings.moving_obstacles
            )
            times = plan.delay / NANOSECONDS + np.cumsum(durations) - durations
            discs = moving.grown(settings.robot_radius)
            clearance = np.hstack([clearance, discs.along(plan.poses, twists, durations, times)])
        least: Array = clearance.min(axis=1)
        return least
