"""Control histories to start from when there is no plan yet."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from cmpsp_ros.guidance.settings import GuidanceSettings
from cmpsp_ros.robot.differential_drive import DifferentialDrive

Array = NDArray[np.float64]

_LOOKAHEAD = 1.0
_SHORTEST_LOOKAHEAD = 0.3


def initial_guess(settings: GuidanceSettings, pose: Array, durations: Array) -> Array:
    """The first control history, as `settings.initial_guess` says.

    Args:
        settings: All settings of the guidance law.
        pose: Present pose, shape ``(3,)`` [m, m, rad].
        durations: Length of every step, shape ``(N,)`` [s].

    Returns:
        Wheel speeds ``(N + 1, 2)`` [rad/s].
    """
    if settings.initial_guess.type == 'constant':
        return np.tile(settings.initial_guess.wheel_speeds, (len(durations) + 1, 1))
    return along_road(settings, pose, durations)


def along_road(settings: GuidanceSettings, pose: Array, durations: Array) -> Array:
    """Pursuit of a point ahead on the centre line, so paced as to be at the goal in time.

    Arguments and result as in `initial_guess`.
    """
    robot, road = settings.robot, settings.road
    center_x, center_y = road.center
    goal_x, goal_y = settings.goal
    goal_bearing = math.atan2(goal_y - center_y, goal_x - center_x)
    controls = np.empty((len(durations) + 1, 2))
    time_left = np.cumsum(durations[::-1])[::-1].tolist()
    for k, left in enumerate(time_left):
        x, y, heading = pose.tolist()
        bearing = math.atan2(y - center_y, x - center_x)
        angle_left = math.remainder(goal_bearing - bearing, math.tau)
        way_left = road.center_radius * abs(angle_left)
        speed = min(way_left / left, robot.max_speed)
        ahead = max(_LOOKAHEAD * speed, _SHORTEST_LOOKAHEAD)
        if way_left <= ahead:
            target_x, target_y = goal_x, goal_y
            speed = min(math.hypot(goal_x - x, goal_y - y) / left, robot.max_speed)
        else:
            turned = bearing + math.copysign(ahead / road.center_radius, angle_left)
            target_x = center_x + road.center_radius * math.cos(turned)
            target_y = center_y + road.center_radius * math.sin(turned)
        turn_rate = _pursue(target_x - x, target_y - y, heading, speed)
        trusted = (settings.solver.heading_trust_region or math.pi / 2.0) / float(durations[k])
        controls[k] = _within_limits(robot, speed, min(max(turn_rate, -trusted), trusted))
        pose = robot.roll_out(pose, controls[k : k + 1], durations[k : k + 1])[-1]
    controls[-1] = controls[-2]
    return controls


def _pursue(offset_x: float, offset_y: float, heading: float, speed: float) -> float:
    """Turn rate [rad/s] of the arc from the pose through a target at an offset [m]."""
    distance = max(math.hypot(offset_x, offset_y), _SHORTEST_LOOKAHEAD)
    angle = math.remainder(math.atan2(offset_y, offset_x) - heading, math.tau)
    bend = math.sin(angle) if abs(angle) < math.pi / 2.0 else math.copysign(1.0, angle)
    return 2.0 * speed * bend / distance


def _within_limits(robot: DifferentialDrive, speed: float, turn_rate: float) -> tuple[float, float]:
    """Wheel speeds [rad/s] of a twist, both slowed alike where one would exceed its limit."""
    rim = turn_rate * robot.half_track
    right, left = (speed + rim) / robot.wheel_radius, (speed - rim) / robot.wheel_radius
    slowed = min(1.0, robot.max_wheel_speed / max(abs(right), abs(left), 1e-12))
    return right * slowed, left * slowed
