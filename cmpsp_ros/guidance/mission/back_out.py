"""Plans that lead a robot out of where it is stuck: back along its trail, or a turn on the spot."""

from __future__ import annotations

import itertools
import math
from typing import Final

import numpy as np

from cmpsp_ros.arrays import Array
from cmpsp_ros.guidance.decision import Plan
from cmpsp_ros.guidance.mission.return_to_goal import turn_rate
from cmpsp_ros.guidance.prediction.estimator import PlanStart
from cmpsp_ros.guidance.settings import LawSettings
from cmpsp_ros.guidance.times import Horizon

_SPEED: Final = 0.3
"""Speed of a robot that backs out, at most [m/s], and half of its pace."""
_AHEAD: Final = 0.12
"""Distance of the point of its trail that it drives to [m]."""
_EDGE: Final = 0.1
_RATES: Final = -0.5, -0.25, 0.0, 0.25, 0.5
"""Speed [m/s] and turn rates [rad/s] of a robot that edges away from something."""
_ALIGNED: Final = 0.6
"""Angle from its trail up to which it drives rather than turns on the spot [rad]."""


def back_out(
    settings: LawSettings, start: PlanStart, horizon: Horizon, delay: int, trail: Array
) -> Plan:
    """Plan back along a trail ``(K, 2)``, the nearest point first [m]; `delay` [ns]."""
    robot, durations = start.robot, horizon.durations
    controls = np.zeros((len(durations) + 1, robot.n_controls))
    pose, reached = start.pose, 0
    for k, duration in enumerate(durations.tolist()):
        while reached < len(trail) and math.dist(pose[:2], trail[reached]) < _AHEAD:
            reached += 1
        if reached == len(trail):
            break
        twist = _twist_to(settings, pose, trail[reached], duration)
        controls[k] = robot.limited(robot.controls(twist))
        pose = robot.roll_out(pose, controls[k : k + 1], durations[k : k + 1])[-1]
    return _plan(settings, start, horizon, delay, controls)


def turn_round(
    settings: LawSettings, start: PlanStart, horizon: Horizon, delay: int, angle: float = math.pi
) -> Plan:
    """Plan of a turn on the spot, to the side of an angle [rad]; `delay` [ns]."""
    robot, rate = start.robot, math.copysign(turn_rate(settings), angle)
    controls = np.zeros((len(horizon.durations) + 1, robot.n_controls))
    controls[:-1] = robot.limited(robot.straight_or_turning(0.0, rate, 1.0))
    return _plan(settings, start, horizon, delay, controls)


def edge_away(settings: LawSettings, start: PlanStart, horizon: Horizon, delay: int) -> list[Plan]:
    """Plans that move for one control step and stop; the first one stands still."""
    robot, plans = start.robot, []
    speeds = (-_EDGE, 0.0, _EDGE) if robot.turns_on_the_spot else (-_EDGE, _EDGE)
    for speed, rate in [(0.0, 0.0), *itertools.product(speeds, _RATES)]:
        twist = np.array([speed, 0.0, rate] if robot.drives_sideways else [speed, rate])
        controls = np.zeros((len(horizon.durations) + 1, robot.n_controls))
        controls[:1] = robot.limited(robot.controls(twist))
        plans.append(_plan(settings, start, horizon, delay, controls))
    return plans


def _plan(
    settings: LawSettings, start: PlanStart, horizon: Horizon, delay: int, controls: Array
) -> Plan:
    controls = start.followed(settings, controls, horizon.durations)
    return Plan(
        horizon, controls, start.robot.roll_out(start.pose, controls, horizon.durations), delay
    )


def _twist_to(settings: LawSettings, pose: Array, point: Array, duration: float) -> Array:
    """Twist towards a point, with whichever end is nearer to it ahead."""
    robot, distance = settings.robot, math.dist(pose[:2], point)
    angle = math.remainder(math.atan2(point[1] - pose[1], point[0] - pose[0]) - pose[2], math.tau)
    speed = min(_SPEED, settings.pace / 2.0, distance / duration)
    if robot.drives_sideways:
        return np.array([speed * math.cos(angle), speed * math.sin(angle), 0.0])
    if abs(angle) > math.pi / 2.0:
        angle, speed = math.remainder(angle - math.pi, math.tau), -speed
    if robot.turns_on_the_spot and abs(angle) > _ALIGNED:
        rate = min(turn_rate(settings), abs(angle) / duration)
        return np.array([0.0, math.copysign(rate, angle)])
    curvature = math.copysign(2.0 * math.sin(abs(angle)) / distance, angle * speed)
    curvature = min(max(curvature, -robot.max_curvature), robot.max_curvature)
    return np.array([speed, speed * curvature])
