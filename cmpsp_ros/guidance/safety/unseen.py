"""Somebody may be where no sensor looks: the robot is at rest before they could be in its way.

The edge of sight is where free cells meet unknown or remembered ones. From each place on it ahead
of the robot something may come at `safety.max_obstacle_speed` from now on.
"""

import math
from typing import Final

import numpy as np

from cmpsp_ros.arrays import Array
from cmpsp_ros.guidance.decision import Plan
from cmpsp_ros.guidance.prediction.estimator import PlanStart
from cmpsp_ros.guidance.safety.reach_check import CREEP
from cmpsp_ros.guidance.settings import LawSettings
from cmpsp_ros.robots import placed
from cmpsp_ros.robots.motion import speeds_and_turns
from cmpsp_ros.world.grids import Cell

PEEP: Final = 0.1  # speed at which the robot looks behind corners, however near they are [m/s]
_BESIDE: Final = 0.25  # distance beyond the robot, where cells are free, at which it looks [m]
_ROUNDING: Final = 1e-9


def watches_unseen(settings: LawSettings, start: PlanStart) -> bool:
    """True if it matters who may be out of sight: always, or once anybody was seen to move."""
    wanted = settings.safety.stop_within_sight
    return wanted == 'moving' or (wanted == 'stationary' and start.among_people)


def is_clear_of_unseen(
    settings: LawSettings, start: PlanStart, controls: Array, durations: Array, delay: float = 0.0
) -> bool:
    """True if the robot looks where it drives, and rests before anything out of sight comes.

    `controls` is a path to rest ``(K, r)``, which begins after a `delay` [s]; with `stationary`
    the second is not asked.
    """
    twists = start.robot.twist(controls)
    speeds = np.abs(speeds_and_turns(twists)[:, 0])
    if speeds[0] <= CREEP + _ROUNDING:
        return True
    poses = start.robot.roll_out(start.pose, controls, durations)
    if not looks_ahead(settings, start, poses, twists[0]):
        return False
    if settings.safety.stop_within_sight != 'moving' or speeds[0] <= PEEP + _ROUNDING:
        return True
    speed, seconds = settings.moving_obstacles.max_speed, delay + float(durations.sum())
    reach = float(speeds @ durations) + settings.circumscribed_radius + speed * seconds
    edge = _edge(start, reach)
    x, y, heading = start.pose
    course = heading + _bearing(twists[0])
    ahead = (edge - [x, y]) @ [math.cos(course), math.sin(course)] > 0.0
    if not ahead.any():
        return True
    for pose, time in zip(poses[1:], (delay + np.cumsum(durations)).tolist(), strict=True):
        away = edge[ahead][:, None] - placed(settings.footprint.discs, pose)
        if np.linalg.norm(away, axis=-1).min() < settings.robot_radius + speed * time:
            return False
    return True


def drives_blind(settings: LawSettings, plan: Plan, start: PlanStart) -> bool:
    """True if a plan drives backward to where nothing has been seen: sensors look ahead."""
    world, is_back = start.world, start.robot.twist(plan.controls[:-1])[:, 0] < -PEEP
    if world.seen is None or not is_back.any():
        return False
    x, y, heading = plan.poses[1:][is_back].T
    # As much farther as it needs to turn round.
    beyond = 2.0 * settings.circumscribed_radius
    behind = np.column_stack([x - beyond * np.cos(heading), y - beyond * np.sin(heading)])
    cells = world.seen.grid.at(behind)
    if world.map is not None:
        cells = np.where(cells == Cell.UNKNOWN, world.map.grid.at(behind), cells)
    return bool((cells == Cell.UNKNOWN).any())


def looks_ahead(settings: LawSettings, start: PlanStart, poses: Array, twist: Array) -> bool:
    """True if what is right ahead of a robot that drives as in a twist is in sight at poses."""
    seen = start.world.seen
    if seen is None:
        return True
    away = settings.circumscribed_radius + _BESIDE
    courses = poses[:, 2] + _bearing(twist)
    ahead = poses[:, :2] + away * np.column_stack([np.cos(courses), np.sin(courses)])
    return not (seen.grid.at(ahead) == Cell.REMEMBERED).any()


def _bearing(twist: Array) -> float:
    """Direction in which a robot drives under a twist, from its heading [rad]."""
    u, v = (*twist[:2].tolist(),) if len(twist) > 2 else (float(twist[0]), 0.0)
    return math.atan2(v, u)


def _edge(start: PlanStart, reach: float) -> Array:
    """Centres of cells out of sight beside ones in sight, up to `reach` [m] away, ``(K, 2)`` [m].

    A cell that the map knows as free is out of sight all the same, and so is all beyond the grid.
    """
    world = start.world
    if world.seen is None:
        return np.empty((0, 2))
    near = world.seen.grid.around(start.pose[None, :2], reach)
    cells = np.pad(near.cells, 2, constant_values=Cell.UNKNOWN)
    free, inner = cells == Cell.FREE, cells[1:-1, 1:-1]
    beside = free[:-2, 1:-1] | free[2:, 1:-1] | free[1:-1, :-2] | free[1:-1, 2:]
    hidden = (inner == Cell.UNKNOWN) | (inner == Cell.REMEMBERED)
    rows, columns = np.nonzero(hidden & beside)
    places = near.centers(rows - 1, columns - 1)
    if world.map is None:
        return places
    return np.asarray(places[world.map.grid.at(places) != Cell.OCCUPIED])
