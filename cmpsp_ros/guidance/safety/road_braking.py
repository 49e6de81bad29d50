"""Braking along the road, which may be clear where a plan's own last arc leads off it."""

import math
from collections.abc import Iterator
from typing import Final

import numpy as np

from cmpsp_ros.arrays import Array
from cmpsp_ros.guidance.prediction.estimator import PlanStart
from cmpsp_ros.robots.motion import braking
from cmpsp_ros.world.roads import lookahead_points

_AHEAD: Final = 1.0  # time in which the point that is pursued would be reached [s]
_BESIDE: Final = (0.0, 0.25, -0.25)  # paths to brake on: road widths left of the centre line


def brakings_on_road(
    start: PlanStart, first: Array, held: float, period: float, max_change: float
) -> Iterator[Array]:
    """Commands as of `braking` to stop on the centre line, to its left and to its right.

    The first one, ``(r,)``, is `held` for a time, the others for a period [s].
    """
    road, robot = start.world.road, start.robot
    speed = float(robot.twist(first)[0])
    begin = robot.roll_out(start.pose, first[None], np.array([held]))[-1]
    ahead = np.array([1.0, -1.0]) * max(_AHEAD * abs(speed), robot.half_track)
    steps = math.ceil(2.0 * abs(speed) / (robot.braking * period))
    durations = np.append(held, np.full(steps, period))
    for part in _BESIDE:
        controls, pose, beside = [first], begin, part * road.width
        for _ in range(steps):
            away = lookahead_points(road, pose, ahead, (math.nan, math.nan)) - pose[:2]
            course = float(pose[2]) + (math.pi if speed < 0.0 else 0.0)
            x, y = away[int(np.argmax(away @ [math.cos(course), math.sin(course)]))]
            x, y = x - beside * math.sin(course), y + beside * math.cos(course)
            bend = 2.0 * math.sin(math.atan2(y, x) - course) / math.hypot(x, y)
            controls.append(robot.limited(robot.controls(np.array([speed, abs(speed) * bend]))))
            pose = robot.roll_out(pose, controls[-1][None], np.array([period]))[-1]
        plan = np.array([*controls, robot.stopped(controls[-1])])
        yield braking(plan, durations, period, max_change, robot.time_scaling, along=True)
