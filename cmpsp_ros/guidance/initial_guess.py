"""Control histories to start from when there is no plan yet."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from cmpsp_ros.guidance.settings import GuidanceSettings

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
    center = np.asarray(road.center)
    goal = np.asarray(settings.goal)
    goal_bearing = math.atan2(goal[1] - center[1], goal[0] - center[0])
    controls = np.empty((len(durations) + 1, 2))
    time_left = np.append(np.cumsum(durations[::-1])[::-1], 0.0)
    for k, duration in enumerate(durations):
        out = pose[:2] - center
        bearing = math.atan2(out[1], out[0])
        angle_left = math.remainder(goal_bearing - bearing, math.tau)
        speed = min(road.center_radius * abs(angle_left) / time_left[k], robot.max_speed)
        ahead = max(_LOOKAHEAD * speed, _SHORTEST_LOOKAHEAD)
        if abs(angle_left) * road.center_radius <= ahead:
            target = goal
            speed = min(math.dist(goal, pose[:2]) / time_left[k], robot.max_speed)
        else:
            turned = bearing + math.copysign(ahead / road.center_radius, angle_left)
            target = center + road.center_radius * np.array([math.cos(turned), math.sin(turned)])
        controls[k] = _toward(settings, pose, target, speed, duration)
        pose = robot.roll_out(pose, controls[k : k + 1], durations[k : k + 1])[-1]
    controls[-1] = controls[-2]
    return controls


def _toward(
    settings: GuidanceSettings, pose: Array, target: Array, speed: float, duration: float
) -> Array:
    """Wheel speeds of the arc from the pose through the target, turning no faster than trusted."""
    robot = settings.robot
    offset = target - pose[:2]
    distance = max(math.hypot(*offset), _SHORTEST_LOOKAHEAD)
    angle = math.remainder(math.atan2(offset[1], offset[0]) - pose[2], math.tau)
    bend = math.sin(angle) if abs(angle) < math.pi / 2.0 else math.copysign(1.0, angle)
    turn_rate = 2.0 * speed * bend / distance
    trusted = (settings.solver.heading_trust_region or math.pi / 2.0) / duration
    turn_rate = min(max(turn_rate, -trusted), trusted)
    wheels = robot.wheel_speeds(np.array([speed, turn_rate]))
    slowed: Array = wheels * min(1.0, robot.max_wheel_speed / max(np.abs(wheels).max(), 1e-12))
    return slowed
