"""Ways through: on which side each obstacle may be passed, and a first plan for each choice.

The side is a discrete choice that no iteration revisits: a plan that aims at the middle of an
obstacle stays there, where both sides pull alike. So the choices are found by a search, over what
the obstacles leave free of the road at stations along its arc, and each becomes a guess of its own.
"""

from __future__ import annotations

import math
from collections.abc import Collection
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from cmpsp_ros.guidance.planning.homotopy.gaps import (
    SPACING,
    Disc,
    Signature,
    free,
    search,
    stretches_of,
)
from cmpsp_ros.guidance.planning.homotopy.homotopy_class import arc_to
from cmpsp_ros.guidance.planning.homotopy.lateral_profile import draw_taut, follow, lengths, relax
from cmpsp_ros.guidance.planning.initial_trajectories import SHORTEST_LOOKAHEAD
from cmpsp_ros.guidance.settings import GuidanceSettings
from cmpsp_ros.world.free_space import FreeSpace
from cmpsp_ros.world.roads.road import Annulus

Array = NDArray[np.float64]
MOST_WAYS = 8

_MOST_STATIONS = 400
# Kept from what a gap is bounded by, where it is wide enough.
_ROOM = 0.08
_ROOM_PART = 0.25
# What a way that is too long for the time left costs [m^2] for every metre too much.
_TOO_LONG = 100.0


@dataclass(frozen=True)
class Way:
    """One way through the obstacles ahead.

    Attributes:
        signature: On which side it passes each obstacle.
        guess: Wheel speeds that follow it, shape ``(N + 1, 2)`` [rad/s].
        radii: Its distance from the road's centre at stations along the arc ``(K,)`` [m].
        cost: Squared distance to the centre line along it, and what it is too long even when drawn
            taut [m^3].
    """

    signature: Signature
    guess: Array
    radii: Array
    cost: float


def ways_through(
    settings: GuidanceSettings,
    space: FreeSpace,
    pose: Array,
    durations: Array,
    most: int = MOST_WAYS,
    without: Collection[Signature] = (),
) -> list[Way]:
    """The most promising ways from a pose to the goal, best first.

    Args:
        settings: All settings of the guidance law.
        space: What the samples of a plan keep to; where it changes along the horizon, its median
            counts.
        pose: Where they begin, shape ``(3,)`` [m, m, rad].
        durations: Length of every step, shape ``(N,)`` [s].
        most: How many of them at most.
        without: Signatures of ways that are not wanted.

    Returns:
        Ways of different signatures; none where everything is closed, or nothing is left to drive.

    Raises:
        ValueError: The road does not lie between two circles.
    """
    road = settings.annulus
    begin, total = arc_to(road, pose, settings.goal)
    length = abs(total) * road.center_radius
    if length < 2.0 * SPACING:
        return []
    count = min(math.ceil(length / SPACING), _MOST_STATIONS) + 1
    turned = np.linspace(0.0, abs(total), count)
    side = math.copysign(1.0, total)
    discs = _discs(road, space, begin, side, _straddled(settings))
    inner, outer = (float(np.median(each)) for each in (space.annulus.inner, space.annulus.outer))
    gaps = free(discs, turned, inner, outer)
    ends = (math.dist(pose[:2], road.center), math.dist(settings.goal, road.center))
    stretches = stretches_of(gaps, discs, turned, ends)
    trails = search(stretches, discs, ends[0], road.center_radius)
    if not trails:
        # From a pocket, such as between an obstacle and an edge, the way leads back and around.
        stretches[0] = replace(stretches[0], gaps=gaps[0])
        trails = search(stretches, discs, ends[0], road.center_radius)
    if not trails:
        return []
    stations = [each.stations for each in stretches]
    corridors = np.repeat([trail.gaps for trail in trails], stations, axis=1)
    spare = np.minimum(_ROOM, _ROOM_PART * (corridors[:, :, 1] - corridors[:, :, 0]))
    low, high = corridors[:, :, 0] + spare, corridors[:, :, 1] - spare
    # A beginning or a goal off the road is no place to lead along.
    on_road = (min(max(ends[0], inner), outer), min(max(ends[1], inner), outer))
    profiles = relax(low, high, on_road, road.center_radius, turned[1])
    reach = settings.model.max_speed * float(durations.sum())
    # Where time is scarce the centre line does not matter.
    scarce = lengths(profiles, turned[1]).sum(axis=1) > reach
    if scarce.any():
        profiles[scarce] = draw_taut(low[scarce], high[scarce], on_road, turned[1])
    costs = _costs(profiles, turned[1], road.center_radius, reach)
    signatures = [tuple(int(-side) * each for each in trail.signature) for trail in trails]
    wanted = [i for i, each in enumerate(signatures) if each not in without]
    wanted.sort(key=lambda i: (costs[i], signatures[i]))
    return [
        Way(
            signatures[i],
            follow(settings, pose, durations, begin, total, profiles[i]),
            profiles[i],
            costs[i],
        )
        for i in wanted[:most]
    ]


def turning_first(settings: GuidanceSettings, way: Way, pose: Array, durations: Array) -> Array:
    """A guess that turns on the spot towards where a way leads, and follows it from there.

    `Way.guess` turns while it drives, and needs room for that.

    Args:
        settings: All settings of the guidance law.
        way: The way.
        pose: Where it begins, shape ``(3,)`` [m, m, rad].
        durations: Length of every step, shape ``(N,)`` [s].

    Returns:
        Wheel speeds, shape ``(N + 1, 2)`` [rad/s].
    """
    robot, road = settings.model, settings.annulus
    begin, total = arc_to(road, pose, settings.goal)
    stations = np.linspace(0.0, abs(total), len(way.radii))
    there = SHORTEST_LOOKAHEAD / float(way.radii[0])
    radius = float(np.interp(there, stations, way.radii))
    bearing = begin + math.copysign(min(there, abs(total)), total)
    x = road.center[0] + radius * math.cos(bearing) - pose[0]
    y = road.center[1] + radius * math.sin(bearing) - pose[1]
    turn = _wrapped(math.atan2(y, x) - float(pose[2]))
    fastest = robot.max_speed / robot.half_track * settings.control_period
    most = min(settings.solver.heading_trust_region or math.pi / 2.0, fastest)
    steps = min(math.ceil(abs(turn) / most), len(durations) - 1)
    if steps == 0:
        return way.guess
    time = float(durations[:steps].sum())
    rim = turn / time * robot.half_track / robot.wheel_radius
    turned = np.array([pose[0], pose[1], pose[2] + turn])
    rest = follow(settings, turned, durations[steps:], begin, total, way.radii)
    return np.concatenate([np.tile([rim, -rim], (steps, 1)), rest])


def _straddled(settings: GuidanceSettings) -> float:
    """How far from the nearest sample a path may pass an obstacle: it may do so between two [m]."""
    if not settings.safety.between_samples or math.isinf(settings.model.max_speed):
        return 0.0
    return settings.model.max_speed * settings.control_period / 2.0


def _discs(
    road: Annulus, space: FreeSpace, begin: float, side: float, straddled: float
) -> list[Disc]:
    radii = space.radii if space.radii.ndim == 1 else np.median(space.radii, axis=0)
    # Samples keep farther away than the path between them comes.
    radii = np.sqrt(np.maximum(radii**2 - straddled**2, 0.0)) * np.sign(radii)
    # What is no disc counts as the disc around it.
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
    return angle - math.tau * round(angle / math.tau)
