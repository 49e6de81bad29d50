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

from cmpsp_ros.arrays import Array
from cmpsp_ros.guidance.goals import Target
from cmpsp_ros.guidance.planning.homotopy.free_gaps import between_samples, free_gaps
from cmpsp_ros.guidance.planning.homotopy.gaps import HomotopyClass, search, stretches_of
from cmpsp_ros.guidance.planning.homotopy.homotopy_class import class_of
from cmpsp_ros.guidance.planning.homotopy.lateral_profile import (
    elastic_band,
    follow_profile,
    lengths,
    shortest_path,
)
from cmpsp_ros.guidance.planning.homotopy.road_frame import (
    SPACING,
    RoadFrame,
    frame_along,
    point_at,
    road_frame,
    stretch_at,
)
from cmpsp_ros.guidance.planning.homotopy.searched_line import searched_line
from cmpsp_ros.guidance.planning.initial_trajectories import (
    SHORTEST_LOOKAHEAD,
    free_turn_rate,
    largest_turn,
    wrapped,
)
from cmpsp_ros.guidance.prediction.plan_start import PlanStart
from cmpsp_ros.guidance.settings import LawSettings
from cmpsp_ros.robots import Robot
from cmpsp_ros.world import FreeSpace

MAX_CLASSES = 8

# Kept from the bounds of a gap [m], at most so great a fraction of its width.
_CLEARANCE = 0.08
_CLEARANCE_FRACTION = 0.25
# Cost of a path that is too long for the time left, for every metre too much [m^2].
_TOO_LONG = 100.0
# A path on a grid is longer than it need be by less than this.
_ROUGHLY = 1.1


@dataclass(frozen=True)
class GuidePath:
    """A path past the obstacles ahead, one for a homotopy class.

    Attributes:
        homotopy_class: On which side it passes each obstacle.
        guess: Controls that follow it, shape ``(N + 1, r)``.
        frame: Road coordinates of its way.
        profile: Its lateral positions at their stations, shape ``(K,)`` [m].
        cost: Squared distance to the centre line along it, and what it is too long even as the
            shortest path [m^3].
    """

    homotopy_class: HomotopyClass
    guess: Array
    frame: RoadFrame
    profile: Array
    cost: float


def guide_paths(
    settings: LawSettings,
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
    """
    frame = road_frame(settings, start, target)
    if frame.length < 2.0 * SPACING:
        return []
    space = between_samples(space, _straddled(settings, start.robot))
    gaps, edges = free_gaps(frame, space)
    at, lateral = (each.tolist() for each in frame.coordinates(space.landmarks))
    stretches = stretches_of(frame, gaps, at)
    trails = search(frame, stretches, lateral)
    if not trails and (found := searched_paths(settings, space, start, target, durations)):
        return [path for path in found if path.homotopy_class not in without]
    if not trails:
        # From a pocket, such as between an obstacle and an edge, the path leads back and around.
        stretches[0] = replace(stretches[0], gaps=gaps[0])
        trails = search(frame, stretches, lateral)
    if not trails:
        return []
    stations = [each.stations for each in stretches]
    corridors = np.repeat([trail.gaps for trail in trails], stations, axis=1)
    spare = np.minimum(_CLEARANCE, _CLEARANCE_FRACTION * (corridors[:, :, 1] - corridors[:, :, 0]))
    low, high = corridors[:, :, 0] + spare, corridors[:, :, 1] - spare
    # A beginning or a goal off the road is no place to lead along.
    ends = (
        min(max(frame.ends[0], edges[0][0]), edges[0][1]),
        min(max(frame.ends[1], edges[-1][0]), edges[-1][1]),
    )
    profiles = elastic_band(frame, low, high, ends)
    reach = start.robot.max_speed * float(durations.sum())
    # Where time is scarce the centre line does not matter, nor where there is none.
    scarce = lengths(frame, profiles).sum(axis=1) > reach
    scarce |= not start.world.road.has_center_line
    if scarce.any():
        profiles[scarce] = shortest_path(frame, low[scarce], high[scarce], ends)
    costs = _costs(frame, profiles, reach)
    wanted = [i for i, each in enumerate(trails) if each.sides not in without]
    turn_rate = free_turn_rate(start, target, durations)
    wanted.sort(key=lambda i: (costs[i], trails[i].sides))
    return [
        GuidePath(
            trails[i].sides,
            follow_profile(settings, start, durations, frame, profiles[i], turn_rate),
            frame,
            profiles[i],
            costs[i],
        )
        for i in wanted[:limit]
    ]


def searched_paths(
    settings: LawSettings, space: FreeSpace, start: PlanStart, target: Target, durations: Array
) -> list[GuidePath]:
    """The path out of a dead end, or into one, if there is any that the time is enough for.

    In polar coordinates none is searched. Arguments as of `guide_paths`.
    """
    frame = road_frame(settings, start, target)
    if frame.polar:
        return []
    if (search := start.world.map_search(settings)) is not None:
        points = search.line(start.pose[:2], target.position, SPACING)
    else:
        around = between_samples(space, 0.0)
        points = searched_line(around, start.pose[:2], np.array(target.position))
    if len(points) < 2:
        return []
    line, profile = frame_along(points), np.zeros(len(points))
    if line.length > _ROUGHLY * start.robot.max_speed * float(durations.sum()):
        return []
    poses = np.column_stack([points, np.zeros(len(points))])
    homotopy_class = class_of(frame, frame.coordinates(space.landmarks), poses)
    guess = follow_profile(
        settings, start, durations, line, profile, free_turn_rate(start, target, durations)
    )
    return [GuidePath(homotopy_class, guess, line, profile, line.length)]


def turning_first(
    settings: LawSettings, path: GuidePath, start: PlanStart, durations: Array
) -> Array:
    """A guess that turns on the spot towards where a path leads, and follows it from there.

    `GuidePath.guess` turns while it drives, and needs space for that. Arguments as of
    `guide_paths`.

    Returns:
        Wheel speeds, shape ``(N + 1, 2)`` [rad/s].
    """
    robot, frame, pose = start.robot, path.frame, start.pose
    if settings.max_wheel_change < math.inf:
        return path.guess
    stretch = stretch_at(frame, 0.0, float(path.profile[0]))
    there = SHORTEST_LOOKAHEAD / max(stretch, SHORTEST_LOOKAHEAD)
    lateral = float(np.interp(there, frame.stations, path.profile))
    x, y = point_at(frame, min(there, frame.stations.item(-1)), lateral)
    turn = wrapped(math.atan2(y - pose[1], x - pose[0]) - float(pose[2]))
    fastest = robot.max_speed / robot.half_track * settings.control_period
    steps = min(math.ceil(abs(turn) / min(largest_turn(settings), fastest)), len(durations) - 1)
    if steps == 0:
        return path.guess
    time = float(durations[:steps].sum())
    rim = turn / time * robot.half_track / robot.wheel_radius
    turned = np.array([pose[0], pose[1], pose[2] + turn])
    facing = start._replace(pose=turned)
    rest = follow_profile(settings, facing, durations[steps:], frame, path.profile)
    return np.concatenate([np.tile([rim, -rim], (steps, 1)), rest])


def _straddled(settings: LawSettings, robot: Robot) -> float:
    """How far from the nearest sample a path may pass an obstacle: it may do so between two [m]."""
    if not settings.safety.between_samples or math.isinf(robot.max_speed):
        return 0.0
    return robot.max_speed * settings.control_period / 2.0


def _costs(frame: RoadFrame, profiles: Array, reach: float) -> list[float]:
    length = lengths(frame, profiles).sum(axis=1)
    squares = ((profiles - frame.middle) ** 2).sum(axis=1) + (np.diff(profiles) ** 2).sum(axis=1)
    costs: list[float] = (
        squares * frame.spacing + _TOO_LONG * np.maximum(0.0, length - reach)
    ).tolist()
    return costs
