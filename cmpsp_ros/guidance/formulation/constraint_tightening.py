"""What the robot's centre keeps to, as the settings ask for it."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np

from cmpsp_ros.guidance.formulation.ocp_functions import EDGES
from cmpsp_ros.guidance.settings import GuidanceSettings
from cmpsp_ros.world.free_space import FreeSpace


def along_path(settings: GuidanceSettings) -> FreeSpace:
    """Space for every point of the path: robot radius and margin away from edges and obstacles."""
    distance = settings.robot_radius + settings.safety.margin
    return FreeSpace.of(settings.road, settings.obstacles, distance)


def at_samples(settings: GuidanceSettings, longest: float | None = None) -> FreeSpace:
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
        return space.tightened(settings.robot.twist_limits(), period)
    return space


def at_goal(settings: GuidanceSettings, longest: float | None = None) -> FreeSpace | None:
    """Space for a plan's last sample where the goal is nearer to something than samples may be.

    From that alone the last sample keeps what every point of the path does. The bound between
    samples is for whatever comes after a sample, in any direction: after the last goal comes
    nothing, and the audit sees whether the arc that leads there is clear. Where the robot drives
    on, which takes it a while to turn, the bound stays.

    Args:
        settings: All settings of the guidance law.
        longest: Time from the sample before the last to the last [s].

    Returns:
        None where the goal is as far from everything as samples must be, or nearer to something
        than the path may be, or not the last.
    """
    if settings.drives_on or settings.follow is not None:
        return None
    heading = math.nan if settings.goal_heading is None else settings.goal_heading
    goal = np.array([[*settings.goal, heading]])
    samples, path = at_samples(settings, longest), along_path(settings)
    near = samples.at(goal)[0] < 0.0
    if not near.any() or path.at(goal).min() < 0.0:
        return None
    road: Any = path.road if near[:EDGES].any() else samples.road
    return replace(samples, road=road, radii=np.where(near[EDGES:], path.radii, samples.radii))
