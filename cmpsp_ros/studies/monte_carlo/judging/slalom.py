"""A line that passes each obstacle on the wider side: an initial guess for solvers, not a path."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np

from cmpsp_ros.arrays import Array
from cmpsp_ros.guidance import GuidanceSettings
from cmpsp_ros.studies.paper import Path

_FINE = 2000


def slalom(settings: GuidanceSettings, pose: Array) -> Path:
    """The line, from a pose to the goal at a constant speed.

    Args:
        settings: Road, obstacles, goal and time.
        pose: Shape ``(3,)`` [m, m, rad].

    Returns:
        Poses along it and controls that nearly lead from one to the next; no robot could follow
        its corners.
    """
    road = settings.world.annulus
    start = (float(pose[0]), float(pose[1]))
    ahead = road.angle_between(start, settings.goal)
    knots = [(0.0, math.dist(start, road.center))]
    for each in settings.obstacles:
        along = math.copysign(1.0, ahead) * road.angle_between(start, each.center)
        if 0.0 < along < abs(ahead):
            knots.append((along, _widest(settings, each.center)))
    knots = [*sorted(knots), (abs(ahead), math.dist(settings.goal, road.center))]
    angles, distances = np.array(knots).T
    turned = np.linspace(0.0, abs(ahead), _FINE)
    bearing = math.atan2(start[1] - road.center[1], start[0] - road.center[0])
    bearings = bearing + math.copysign(1.0, ahead) * turned
    away = np.interp(turned, angles, distances)[:, None]
    fine = road.center + away * np.column_stack([np.cos(bearings), np.sin(bearings)])
    return at_constant_speed(settings, pose, fine)


def at_constant_speed(settings: GuidanceSettings, pose: Array, fine: Array) -> Path:
    """A line as a path from a pose, at a constant speed.

    Args:
        settings: Robot and time.
        pose: Shape ``(3,)`` [m, m, rad].
        fine: Points of the line, shape ``(K, 2)`` [m].
    """
    robot = settings.robot
    length = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(fine, axis=0), axis=1))])
    steps = round(settings.final_time / settings.control_period)
    at = np.linspace(0.0, length[-1], steps + 1)
    points = np.column_stack([np.interp(at, length, column) for column in fine.T])
    course = np.arctan2(*np.diff(points, axis=0).T[::-1])
    headings = np.unwrap(np.concatenate([[pose[2]], course]))
    turn_rates = np.diff(headings) / settings.control_period
    speed = np.full(steps, length[-1] / settings.final_time)
    controls = robot.controls(np.column_stack([speed, turn_rates]))
    within = np.clip(controls, -robot.bounds, robot.bounds)
    return Path(settings, np.column_stack([points, headings]), within)


def _widest(settings: GuidanceSettings, center: tuple[float, float]) -> float:
    """Distance from the road's centre to the middle of the widest gap abreast of a point [m]."""
    road = settings.world.annulus
    blocked = [(0.0, road.inner_radius), (road.outer_radius, math.inf)]
    for each in settings.obstacles:
        away = math.dist(each.center, road.center)
        beside = road.angle_between(center, each.center)
        across, ahead = away * math.sin(beside), away * math.cos(beside)
        if abs(across) < each.radius and ahead > 0.0:
            half = math.sqrt(each.radius**2 - across**2)
            blocked.append((ahead - half, ahead + half))
    # What has been passed may reach further than what comes next.
    blocked.sort()
    ends = np.maximum.accumulate([end for _, end in blocked])
    gaps = [
        (later[0] - end, (later[0] + end) / 2.0)
        for (_, later), end in zip(pairwise(blocked), ends, strict=False)
    ]
    return float(max(gaps)[1])
