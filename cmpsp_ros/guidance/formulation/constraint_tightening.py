"""What the robot's discs keep to: the free space, tightened by what happens between samples."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np

from cmpsp_ros.guidance.formulation.ocp_functions import N_EDGE_CONSTRAINTS
from cmpsp_ros.guidance.goals import Target
from cmpsp_ros.guidance.settings import LawSettings
from cmpsp_ros.guidance.world import World
from cmpsp_ros.world import FreeSpace


def path_space(settings: LawSettings, world: World) -> FreeSpace:
    """Space for every point of the path: robot radius and margin away from edges and obstacles."""
    return world.free_space(settings, settings.safety.margin)


def sample_space(settings: LawSettings, world: World, longest: float = 0.0) -> FreeSpace:
    """Space for the samples of a plan, such that the path between them stays in `path_space`.

    Without a wheel limit no such space is known beforehand, and it is the same as `path_space`;
    with `safety.between_samples` off it is so by choice.

    Args:
        settings: All settings of the guidance law.
        world: Road and static obstacles.
        longest: Longest time between two samples [s]; the control period if it is shorter.
    """
    period = max(settings.control_period, longest)
    space = path_space(settings, world)
    if settings.safety.between_samples and math.isfinite(settings.robot.max_wheel_speed):
        return space.tightened(settings.footprint.twist_limits(settings.robot), period)
    return space


def goal_space(
    settings: LawSettings, world: World, target: Target, longest: float = 0.0
) -> FreeSpace | None:
    """Space for a plan's last sample where the goal is nearer to something than samples may be.

    From that alone the last sample keeps what every point of the path does. The bound between
    samples is for the motion after a sample, in any direction: after the last goal there is none,
    and the audit sees whether the arc that leads there is clear. Where the robot drives on, which
    takes it a while to turn, the bound stays.

    Args:
        settings: All settings of the guidance law.
        world: Road and static obstacles.
        target: What is to be met at the end.
        longest: Time from the sample before the last to the last [s].

    Returns:
        None where the goal is as far from everything as samples must be, or nearer to something
        than the path may be, or not the last.
    """
    if target.drives_on or target.is_line:
        return None
    heading = math.nan if target.heading is None else target.heading
    goal = np.array([[*target.position, heading]])
    samples, path = sample_space(settings, world, longest), path_space(settings, world)
    # NaN where a disc is beside the reference point, and the heading may be any.
    near = ~(samples.at(goal)[0] >= 0.0)
    if not near.any() or path.at(goal).min() < 0.0:
        return None
    road: Any = path.road if near[:N_EDGE_CONSTRAINTS].any() else samples.road
    return replace(
        samples, road=road, radii=np.where(near[N_EDGE_CONSTRAINTS:], path.radii, samples.radii)
    )
