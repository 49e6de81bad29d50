"""Control histories to start from when there is no plan yet."""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from cmpsp_ros.guidance.settings import GuidanceSettings
from cmpsp_ros.mpsp.jit.compiled import allocation_free
from cmpsp_ros.robots.differential_drive import drive
from cmpsp_ros.world.roads import road_functions
from cmpsp_ros.world.roads.road_space import RoadSpace

Array = NDArray[np.float64]

_LOOKAHEAD = 1.0
SHORTEST_LOOKAHEAD: Final = 0.3
"""Nearest point that is pursued [m]."""


def initial_guess(
    settings: GuidanceSettings, pose: Array, durations: Array, near: float = math.nan
) -> Array:
    """The first control history, as `settings.initial_guess` says.

    Args:
        settings: All settings of the guidance law.
        pose: Present pose, shape ``(3,)`` [m, m, rad].
        durations: Length of every step, shape ``(N,)`` [s].
        near: Progress of a place near the pose, not a number where none is known [m].

    Returns:
        Wheel speeds ``(N + 1, 2)`` [rad/s].
    """
    if settings.initial_guess.type == 'constant':
        return np.tile(settings.initial_guess.wheel_speeds, (len(durations) + 1, 1))
    return along_road(settings, pose, durations, near)


def along_road(
    settings: GuidanceSettings, pose: Array, durations: Array, near: float = math.nan
) -> Array:
    """Pursuit of a point ahead on the centre line, so paced as to be at the goal in time.

    Arguments and result as in `initial_guess`.
    """
    robot = settings.model
    controls, poses = np.empty((len(durations) + 1, 2)), np.empty((len(durations) + 1, 3))
    poses[0] = pose
    _follow(
        controls,
        poses,
        durations,
        settings.road.space(0.0),
        settings.goal,
        math.nan if settings.goal_heading is None else settings.goal_heading,
        robot.wheel_radius,
        robot.half_track,
        robot.max_wheel_speed,
        settings.solver.heading_trust_region or math.pi / 2.0,
        float(near),
    )
    return controls


@allocation_free
def _follow(
    controls: Array,
    poses: Array,
    durations: Array,
    road: RoadSpace,
    goal: tuple[float, float],
    goal_heading: float,
    wheel_radius: float,
    half_track: float,
    max_wheel_speed: float,
    most_turn: float,
    near: float,
) -> None:
    """Fill the controls, step by step along the poses that they lead to."""
    steps = durations.shape[0]
    left = 0.0
    for k in range(steps):
        left += durations[k]
    progress = road_functions.find(road, poses[0, 0], poses[0, 1], poses[0, 2], near)
    at_goal = road_functions.find(road, goal[0], goal[1], goal_heading, math.nan)
    for k in range(steps):
        progress = road_functions.measure(road, 0, poses[k, 0], poses[k, 1], progress)[0]
        target_x, target_y, speed = _aim(
            road,
            poses[k, 0],
            poses[k, 1],
            progress,
            goal,
            at_goal,
            left,
            wheel_radius * max_wheel_speed,
        )
        turn_rate = pursue(target_x - poses[k, 0], target_y - poses[k, 1], poses[k, 2], speed)
        trusted = most_turn / durations[k]
        rim = min(max(turn_rate, -trusted), trusted) * half_track
        right, slow = (speed + rim) / wheel_radius, (speed - rim) / wheel_radius
        # Both wheels are slowed alike where one would exceed its limit.
        slowed = min(1.0, max_wheel_speed / max(abs(right), abs(slow), 1e-12))
        controls[k, 0], controls[k, 1] = right * slowed, slow * slowed
        drive(poses, controls, k, durations[k], wheel_radius, half_track)
        left -= durations[k]
    controls[steps, 0], controls[steps, 1] = controls[steps - 1, 0], controls[steps - 1, 1]


@allocation_free
def _aim(
    road: RoadSpace,
    x: float,
    y: float,
    progress: float,
    goal: tuple[float, float],
    at_goal: float,
    left: float,
    most: float,
) -> Any:
    """Point to pursue [m, m] and the speed that gets there in the time left [m/s]."""
    way = road_functions.way_to(road, x, y, progress, goal[0], goal[1], at_goal)
    way_left = abs(way)
    speed = min(way_left / left, most)
    ahead = max(_LOOKAHEAD * speed, SHORTEST_LOOKAHEAD)
    if way_left <= ahead:
        speed = min(math.hypot(goal[0] - x, goal[1] - y) / left, most)
        return goal[0], goal[1], speed
    way = math.copysign(ahead, way)
    target_x, target_y = road_functions.ahead(road, x, y, progress, way, goal)
    return target_x, target_y, speed


def ways_left(settings: GuidanceSettings, poses: Array, near: float = math.nan) -> Array:
    """Length of the centre line from beside each pose of a path to beside the goal.

    Args:
        settings: Settings with the goal.
        poses: Along the path, shape ``(K, 3)`` [m, m, rad].
        near: Progress of a place near the first, not a number where none is known [m].

    Returns:
        Negative where the goal is behind, shape ``(K,)`` [m].
    """
    ways = np.empty(len(poses))
    heading = math.nan if settings.goal_heading is None else settings.goal_heading
    _leave(ways, settings.road.space(0.0), poses, *settings.goal, heading, float(near))
    return ways


@allocation_free
def _leave(
    ways: Array,
    road: RoadSpace,
    poses: Array,
    goal_x: float,
    goal_y: float,
    goal_heading: float,
    near: float,
) -> None:
    progress = road_functions.find(road, poses[0, 0], poses[0, 1], poses[0, 2], near)
    at_goal = road_functions.find(road, goal_x, goal_y, goal_heading, math.nan)
    for k in range(poses.shape[0]):
        x, y = poses[k, 0], poses[k, 1]
        progress = road_functions.measure(road, 0, x, y, progress)[0]
        ways[k] = road_functions.way_to(road, x, y, progress, goal_x, goal_y, at_goal)


@allocation_free
def pursue(offset_x: float, offset_y: float, heading: float, speed: float) -> float:
    """Turn rate [rad/s] of the arc from the pose through a target at an offset [m]."""
    distance = max(math.hypot(offset_x, offset_y), SHORTEST_LOOKAHEAD)
    angle = wrapped(math.atan2(offset_y, offset_x) - heading)
    bend = math.sin(angle) if abs(angle) < math.pi / 2.0 else math.copysign(1.0, angle)
    return 2.0 * speed * bend / distance


@allocation_free
def wrapped(angle: float) -> float:
    """The angle between ``-pi`` and ``pi`` that points the same way."""
    return angle - 2.0 * math.pi * round(angle / (2.0 * math.pi))
