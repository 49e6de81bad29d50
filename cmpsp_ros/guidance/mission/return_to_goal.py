"""The return to a goal that the robot was moved from: turn to it, drive, turn to its heading."""

import math
from typing import Final

import numpy as np

from cmpsp_ros.arrays import Array
from cmpsp_ros.guidance.decision import Plan
from cmpsp_ros.guidance.goals import Target
from cmpsp_ros.guidance.prediction.estimator import PlanStart
from cmpsp_ros.guidance.settings import LawSettings
from cmpsp_ros.guidance.times import Horizon

_TURN_RATE: Final = 1.0
_FRACTION_OF_LIMIT: Final = 0.5
# Fraction of the tolerance at which the robot sets out: it is back before it is out of tolerance.
_AWAY: Final = 0.5


def turn_rate(settings: LawSettings) -> float:
    """Rate at which the robot is turned where nothing hurries it [rad/s]."""
    robot = settings.robot
    return min(_TURN_RATE, _FRACTION_OF_LIMIT * robot.max_speed / robot.half_track)


def is_away(settings: LawSettings, target: Target, pose: Array) -> bool:
    """True if a robot that holds its position at the goal has been moved away from it."""
    return not settings.tolerates(*target.errors(pose), _AWAY)


def return_time(settings: LawSettings, target: Target, pose: Array) -> float:
    """Duration of the return at walking speed [s]."""
    return sum(steps for steps, _, _ in _parts(settings, target, pose)) * settings.control_period


def return_to_goal(
    settings: LawSettings, target: Target, start: PlanStart, horizon: Horizon, delay: int
) -> Plan:
    """A plan of the return, which is complete at the end of the horizon; `delay` [ns]."""
    robot, durations, k = settings.robot, horizon.durations, 0
    controls = np.zeros((len(durations) + 1, robot.n_controls))
    for steps, length, turn in _parts(settings, target, start.pose):
        inside = slice(k, min(k + steps, len(durations)))
        time = float(durations[inside].sum())
        if time > 0.0:
            controls[inside] = robot.straight_or_turning(length, turn, time)
        k += steps
    poses = start.robot.roll_out(start.pose, controls, durations)
    return Plan(horizon, controls, poses, delay)


def _parts(settings: LawSettings, target: Target, pose: Array) -> list[tuple[int, float, float]]:
    """Control steps, length [m] and turn [rad] of each part: forward or backward, as is shorter."""
    x, y = target.position
    length = math.dist(pose[:2], target.position)
    turn, last = 0.0, 0.0
    if length > 0.0:
        turn = math.remainder(math.atan2(y - pose[1], x - pose[0]) - pose[2], math.tau)
    if abs(turn) > math.pi / 2.0:
        turn, length = math.remainder(turn - math.pi, math.tau), -length
    if target.heading is not None:
        last = math.remainder(target.heading - pose[2] - turn, math.tau)
    period, rate = settings.control_period, turn_rate(settings)
    speed = min(settings.pace, _FRACTION_OF_LIMIT * settings.robot.max_speed)
    return [
        (math.ceil(abs(turn) / rate / period), 0.0, turn),
        (math.ceil(abs(length) / speed / period), length, 0.0),
        (math.ceil(abs(last) / rate / period), 0.0, last),
    ]
