"""The search for homotopy classes: on which side each obstacle may be passed, and a guess each.

The side is a discrete choice that no iteration revisits: a plan that leads to the middle of an
obstacle stays there, where both sides pull alike. So the choices are found by a search, over what
the obstacles leave free of the road at stations along its arc, and each becomes a guess of its own.
"""

from __future__ import annotations

import math
from collections.abc import Collection
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from cmpsp_ros.guidance.goals import Target
from cmpsp_ros.guidance.planning.homotopy.gaps import (
    SPACING,
    Disc,
    HomotopyClass,
    free,
    search,
    stretches_of,
)
from cmpsp_ros.guidance.planning.homotopy.homotopy_class import arc_to
from cmpsp_ros.guidance.planning.homotopy.lateral_profile import (
    elastic_band,
    follow_profile,
    lengths,
    shortest_path,
)
from cmpsp_ros.guidance.planning.initial_trajectories import SHORTEST_LOOKAHEAD, largest_turn
from cmpsp_ros.guidance.prediction.plan_start import PlanStart
from cmpsp_ros.guidance.settings import GuidanceSettings
from cmpsp_ros.robots.differential_drive import DifferentialDrive
from cmpsp_ros.world.free_space import FreeSpace
from cmpsp_ros.world.roads.annulus import Annulus

Array = NDArray[np.float64]
MAX_CLASSES = 8

_MAX_STATIONS = 400
# Kept from the bounds of a gap [m], at most so great a fraction of its width.
_CLEARANCE = 0.08
_CLEARANCE_FRACTION = 0.25
# Cost of a path that is too long for the time left, for every metre too much [m^2].
_TOO_LONG = 100.0


@dataclass(frozen=True)
class GuidePath:
    """A path past the obstacles ahead, one for a homotopy class.

    Attributes:
        homotopy_class: On which side it passes each obstacle.
        guess: Wheel speeds that follow it, shape ``(N + 1, 2)`` [rad/s].
        radii: Its distance from the road's centre at stations along the arc ``(K,)`` [m].
        cost: Squared distance to the centre line along it, and what it is too long even as the
            shortest path [m^3].
    """

    homotopy_class: HomotopyClass
    guess: Array
    radii: Array
    cost: float


def guide_paths(
    settings: GuidanceSettings,
    space: FreeSpace,
    start: PlanStart,
    target: Target,
    durations: Array,
    limit: int = MAX_CLASSES,
    without: Collection[HomotopyClass] = (),
) -> list[GuidePath]:
    """The most promising paths from a pose to the goal, best first.

    Args:
        settings: All settings of the guidance law.
        space: What the samples of a plan keep to; where it changes along the horizon, its median
            counts.
        start: Where they begin.
        target: Where they end.
        durations: Length of every step, shape ``(N,)`` [s].
        limit: How many of them at most.
        without: Homotopy classes that are not wanted.

    Returns:
        Paths of different classes; none where everything is closed, or nothing is left to drive.

    Raises:
        ValueError: The road does not lie between two circles.
    """
    pose, goal = start.pose, target.position
    road = settings.annulus
    begin, total = arc_to(road, pose, goal)
    length = abs(total) * road.center_radius
    if length < 2.0 * SPACING:
        return []
    count = min(math.ceil(length / SPACING), _MAX_STATIONS) + 1
    turned = np.linspace(0.0, abs(total), count)
    side = math.copysign(1.0, total)
    discs = _discs(road, space, begin, side, _straddled(settings, start.robot))
    inner, outer = (float(np.median(each)) for each in (space.annulus.inner, space.annulus.outer))
    gaps = free(discs, turned, inner, outer)
    ends = (math.dist(pose[:2], road.center), math.dist(goal, road.center))
    stretches = stretches_of(gaps, discs, turned, ends)
    trails = search(stretches, discs, ends[0], road.center_radius)
    if not trails:
        # From a pocket, such as between an obstacle and an edge, the path leads back and around.
        stretches[0] = replace(stretches[0], gaps=gaps[0])
        trails = search(stretches, discs, ends[0], road.center_radius)
    if not trails:
        return []
    stations = [each.stations for each in stretches]
    corridors = np.repeat([trail.gaps for trail in trails], stations, axis=1)
    spare = np.minimum(_CLEARANCE, _CLEARANCE_FRACTION * (corridors[:, :, 1] - corridors[:, :, 0]))
    low, high = corridors[:, :, 0] + spare, corridors[:, :, 1] - spare
    # A beginning or a goal off the road is no place to lead along.
    on_road = (min(max(ends[0], inner), outer), min(max(ends[1], inner), outer))
    profiles = elastic_band(low, high, on_road, road.center_radius, turned[1])
    reach = start.robot.max_speed * float(durations.sum())
    # Where time is scarce the centre line does not matter.
    scarce = lengths(profiles, turned[1]).sum(axis=1) > reach
    if scarce.any():
        profiles[scarce] = shortest_path(low[scarce], high[scarce], on_road, turned[1])
    costs = _costs(profiles, turned[1], road.center_radius, reach)
    classes = [tuple(int(-side) * each for each in trail.sides) for trail in trails]
    wanted = [i for i, each in enumerate(classes) if each not in without]
    wanted.sort(key=lambda i: (costs[i], classes[i]))
    return [
        GuidePath(
            classes[i],
            follow_profile(settings, start, durations, begin, total, profiles[i]),
            profiles[i],
            costs[i],
        )
        for i in wanted[:limit]
    ]


def turning_first(
    settings: GuidanceSettings,
    path: GuidePath,
    start: PlanStart,
    target: Target,
    durations: Array,
) -> Array:
    """A guess that turns on the spot towards where a path leads, and follows it from there.

    `GuidePath.guess` turns while it drives, and needs space for that. Arguments as of
    `guide_paths`.

    Returns:
        Wheel speeds, shape ``(N + 1, 2)`` [rad/s].
    """
    robot, road, pose = start.robot, settings.annulus, start.pose
    begin, total = arc_to(road, pose, target.position)
    stations = np.linspace(0.0, abs(total), len(path.radii))
    there = SHORTEST_LOOKAHEAD / float(path.radii[0])
    radius = float(np.interp(there, stations, path.radii))
    bearing = begin + math.copysign(min(there, abs(total)), total)
    x = road.center[0] + radius * math.cos(bearing) - pose[0]
    y = road.center[1] + radius * math.sin(bearing) - pose[1]
    turn = _wrapped(math.atan2(y, x) - float(pose[2]))
    fastest = robot.max_speed / robot.half_track * settings.control_period
    steps = min(math.ceil(abs(turn) / min(largest_turn(settings), fastest)), len(durations) - 1)
    if steps == 0:
        return path.guess
    time = float(durations[:steps].sum())
    rim = turn / time * robot.half_track / robot.wheel_radius
    turned = np.array([pose[0], pose[1], pose[2] + turn])
    rest = follow_profile(
        settings, start._replace(pose=turned), durations[steps:], begin, total, path.radii
    )
    return np.concatenate([np.tile([rim, -rim], (steps, 1)), rest])


def _straddled(settings: GuidanceSettings, robot: DifferentialDrive) -> float:
    """How far from the nearest sample a path may pass an obstacle: it may do so between two [m]."""
    if not settings.safety.between_samples or math.isinf(robot.max_speed):
        return 0.0
    return robot.max_speed * settings.control_period / 2.0


def _discs(
    road: Annulus, space: FreeSpace, begin: float, side: float, straddled: float
) -> list[Disc]:
    radii = space.radii if space.radii.ndim == 1 else np.median(space.radii, axis=0)
    # Samples keep farther away than the path between them comes.
    radii = np.sqrt(np.maximum(radii**2 - straddled**2, 0.0)) * np.sign(radii)
    # A shape that is no disc counts as the disc around it.
    radii, offsets = radii + space.reaches, space.centers - road.center
    return [
        Disc(side * _wrapped(math.atan2(y, x) - begin), math.hypot(x, y), radius)
        for (x, y), radius in zip(offsets.tolist(), radii.tolist(), strict=True)
    ]


def _costs(profiles: Array, step: float, middle: float, reach: float) -> list[float]:
    length = lengths(profiles, step).sum(axis=1)
    squares = ((profiles - middle) ** 2).sum(axis=1) + (np.diff(profiles) ** 2).sum(axis=1)
    costs: list[float] = (
        squares * step * middle + _TOO_LONG * np.maximum(0.0, length - reach)
    ).tolist()
    return costs


def _wrapped(angle: float) -> float:
    """The angle between ``-pi`` and ``pi`` that points the same way."""
    return angle - math.tau * round(angle / math.tau)
