"""Control histories to start the iterations from, and the pursuit of a path that makes them."""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np

from cmpsp_ros.arrays import Array
from cmpsp_ros.guidance.goals import Target
from cmpsp_ros.guidance.prediction.estimator import PlanStart
from cmpsp_ros.guidance.settings import LawSettings
from cmpsp_ros.mpsp.jit import allocation_free
from cmpsp_ros.robots import Kinematics, drive, fastest_wheel, within_limits
from cmpsp_ros.robots import steer as steer_by
from cmpsp_ros.world.roads import RoadSpace, road_functions

_LOOKAHEAD = 1.0
SHORTEST_LOOKAHEAD: Final = 0.3
"""Nearest point that is pursued [m]."""


def initial_guess(
    settings: LawSettings, start: PlanStart, target: Target, durations: Array
) -> Array:
    """The first control history, as `settings.initial_guess` says.

    Args:
        settings: All settings of the guidance law.
        start: Where it begins.
        target: Where it leads.
        durations: Length of every step, shape ``(N,)`` [s].

    Returns:
        Controls ``(N + 1, r)``.
    """
    if settings.initial_guess.type == 'constant':
        controls = np.empty((len(durations) + 1, 2))
        controls[:] = settings.initial_guess.wheel_speeds
        return controls
    return along_road(settings, start, target, durations)


def along_road(settings: LawSettings, start: PlanStart, target: Target, durations: Array) -> Array:
    """Pursuit of a point ahead on the centre line, so paced as to be at the goal in time.

    Arguments and result as in `initial_guess`.
    """
    controls, poses = guess_arrays(start, durations)
    _follow_road(
        controls,
        poses,
        durations,
        start.world.road_space,
        target.position,
        math.nan if target.heading is None else target.heading,
        start.robot.kinematics,
        largest_turn(settings),
        free_turn_rate(start, target, durations),
        float(start.progress),
    )
    return controls


def guess_arrays(start: PlanStart, durations: Array) -> tuple[Array, Array]:
    """Room for the controls ``(N + 1, r)`` of a guess, and for its poses, of which the first is."""
    controls = np.empty((len(durations) + 1, start.robot.n_controls))
    poses = np.empty((len(durations) + 1, 3))
    poses[0] = start.pose
    return controls, poses


def free_turn_rate(start: PlanStart, target: Target, durations: Array) -> float:
    """Turn rate to the heading of a goal, for a robot whose heading is free meanwhile [rad/s].

    NaN where the goal has none, either.
    """
    if target.heading is None or target.is_line or not start.robot.drives_sideways:
        return math.nan
    return wrapped(target.heading - float(start.pose[2])) / float(durations.sum())


def largest_turn(settings: LawSettings) -> float:
    """Largest turn of a guess in one step [rad]."""
    return settings.solver.heading_trust_region or math.pi / 2.0


@allocation_free
def _follow_road(
    controls: Array,
    poses: Array,
    durations: Array,
    road: RoadSpace,
    goal: tuple[float, float],
    goal_heading: float,
    robot: Kinematics,
    max_turn: float,
    free_turn_rate: float,
    progress: float,
) -> None:
    """Fill the controls, step by step along the poses that they lead to."""
    steps = durations.shape[0]
    left = 0.0
    for k in range(steps):
        left += durations[k]
    progress = road_functions.project(road, poses[0, 0], poses[0, 1], poses[0, 2], progress)
    at_goal = road_functions.project(road, goal[0], goal[1], goal_heading, math.nan)
    for k in range(steps):
        x, y = poses[k, 0], poses[k, 1]
        progress = road_functions.lateral_error(road, 0, x, y, progress)[0]
        target_x, target_y, speed = _lookahead(
            road, x, y, progress, goal, at_goal, left, robot.max_speed
        )
        steer(
            controls,
            poses,
            k,
            durations[k],
            target_x - x,
            target_y - y,
            speed,
            robot,
            max_turn,
            free_turn_rate,
        )
        left -= durations[k]
    for a in range(controls.shape[1]):
        controls[steps, a] = controls[steps - 1, a]


@allocation_free
def _lookahead(
    road: RoadSpace,
    x: float,
    y: float,
    progress: float,
    goal: tuple[float, float],
    at_goal: float,
    left: float,
    top_speed: float,
) -> Any:
    """Point to pursue [m, m] and the speed that gets there in the time left [m/s]."""
    length = road_functions.arc_length_to(road, x, y, progress, goal[0], goal[1], at_goal)
    remaining = abs(length)
    speed = min(remaining / left, top_speed)
    ahead = max(_LOOKAHEAD * speed, SHORTEST_LOOKAHEAD)
    if remaining <= ahead:
        speed = min(math.hypot(goal[0] - x, goal[1] - y) / left, top_speed)
        return goal[0], goal[1], speed
    length = math.copysign(ahead, length)
    target_x, target_y = road_functions.point_ahead(road, x, y, progress, length, goal)
    return target_x, target_y, speed


@allocation_free
def steer(
    controls: Array,
    poses: Array,
    k: int,
    duration: float,
    offset_x: float,
    offset_y: float,
    speed: float,
    robot: Kinematics,
    max_turn: float,
    free_turn_rate: float,
) -> None:
    """Fill control ``k`` and the pose after it: the arc from pose ``k`` through a target.

    Args:
        controls: Shape ``(N + 1, r)``.
        poses: Shape ``(N + 1, 3)`` [m, m, rad].
        k: Number of the step.
        duration: Of the step [s].
        offset_x: Of the target from the pose [m].
        offset_y: See `offset_x`.
        speed: Along the arc [m/s].
        robot: The robot.
        max_turn: Largest turn in the step [rad].
        free_turn_rate: Turn rate of a robot that drives sideways; NaN for as it likes [rad/s].
    """
    distance = max(math.hypot(offset_x, offset_y), SHORTEST_LOOKAHEAD)
    angle = wrapped(math.atan2(offset_y, offset_x) - poses[k, 2])
    trusted = max_turn / duration
    if robot.drives_sideways:
        is_free = math.isnan(free_turn_rate)
        turn_rate = 0.0 if is_free else min(max(free_turn_rate, -trusted), trusted)
        _drive_sideways(controls, k, duration, angle, speed, robot, turn_rate)
        if is_free and fastest_wheel(controls, k, robot) > robot.max_wheel_speed:
            # Sideways it cannot go as fast as ahead: it turns to where it goes.
            turn_rate = min(max(angle / duration, -trusted), trusted)
            _drive_sideways(controls, k, duration, angle, speed, robot, turn_rate)
    else:
        is_ahead = abs(angle) < math.pi / 2.0
        if robot.max_curvature == math.inf:
            bend = math.sin(angle) if is_ahead else math.copysign(1.0, angle)
            turn_rate = min(max(2.0 * speed * bend / distance, -trusted), trusted)
            curvature = 0.0
        else:
            # As far as it goes towards what is beside or behind.
            wanted = 2.0 * math.sin(abs(angle)) / distance if is_ahead else math.inf
            tightest = min(robot.max_curvature, trusted / max(speed, 1e-12))
            curvature = math.copysign(min(wanted, tightest), angle)
            turn_rate = speed * curvature
        steer_by(controls, k, speed, 0.0, turn_rate, curvature, robot)
    within_limits(controls, k, robot)
    drive(poses, controls, k, duration, robot)


@allocation_free
def _drive_sideways(
    controls: Array,
    k: int,
    duration: float,
    angle: float,
    speed: float,
    robot: Kinematics,
    turn_rate: float,
) -> None:
    """Fill the control of a robot that goes at an angle while it turns."""
    course = angle - turn_rate * duration / 2.0
    forward, left = speed * math.cos(course), speed * math.sin(course)
    steer_by(controls, k, forward, left, turn_rate, 0.0, robot)


@allocation_free
def wrapped(angle: float) -> float:
    """The angle between ``-pi`` and ``pi`` that points the same way."""
    return angle - 2.0 * math.pi * round(angle / (2.0 * math.pi))
