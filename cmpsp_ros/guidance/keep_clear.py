"""What the robot's centre keeps to, as the settings ask for it."""

from __future__ import annotations

import math

from cmpsp_ros.guidance.settings import GuidanceSettings
from cmpsp_ros.robot.clear_space import ClearSpace


def along_path(settings: GuidanceSettings) -> ClearSpace:
    """Space for every point of the path: robot radius and margin away from edges and obstacles."""
    distance = settings.robot_radius + settings.safety.margin
    return ClearSpace.of(settings.road, settings.obstacles, distance)


def at_samples(settings: GuidanceSettings, longest: float | None = None) -> ClearSpace:
    """Space for the samples of a plan, such that the path between them stays in `along_path`.

    Without a wheel limit there is no such space that is known beforehand, and it is the same as
    `along_path`; with `safety.between_samples` off it is so by choice.

    Args:
        settings: All settings of the guidance law.
        longest: Longest time between two samples [s]; the control period where it is shorter.
    """
    period = max(settings.control_period, longest or 0.0)
    space = along_path(settings)
    if settings.safety.between_samples and math.isfinite(settings.robot.max_wheel_speed):
        return space.for_samples(settings.robot.twist_limits(), period)
    return space
