"""Somebody may step out of what no sensor has seen: the robot is at rest before they are there.

The edge of what is seen is where free space ends in cells that are unknown. From each place on it,
ahead of the robot, something may come at `safety.max_obstacle_speed` from now on.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from cmpsp_ros.arrays import Array
from cmpsp_ros.guidance.decision import Plan
from cmpsp_ros.guidance.prediction.estimator import PlanStart
from cmpsp_ros.guidance.settings import LawSettings
from cmpsp_ros.robots import placed, speeds_and_turns
from cmpsp_ros.world.grids import Cell

PEEP: Final = 0.1
"""Speed at which the robot looks behind corners, however near they are [m/s]."""


def is_clear_of_unseen(
    settings: LawSettings, start: PlanStart, controls: Array, durations: Array
) -> bool:
    """True if nothing out of sight can reach the robot on a path to rest.

    `controls` ``(K, r)``, `durations` ``(K,)`` [s].
    """
    twists = start.robot.twist(controls)
    speeds = np.abs(speeds_and_turns(twists)[:, 0])
    if speeds[0] <= PEEP + 1e-9:
        return True
    speed, seconds = settings.moving_obstacles.max_speed, float(durations.sum())
    reach = float(speeds @ durations) + settings.circumscribed_radius + speed * seconds
    edge = _edge(start, reach)
    x, y, heading = start.pose
    sense = np.sign(twists[0, 0]) or 1.0
    ahead = (edge - [x, y]) @ [np.cos(heading), np.sin(heading)] * sense > 0.0
    if not ahead.any():
        return True
    poses = start.robot.roll_out(start.pose, controls, durations)[1:]
    for pose, time in zip(poses, np.cumsum(durations).tolist(), strict=True):
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


def _edge(start: PlanStart, reach: float) -> Array:
    """Centres of unknown cells beside free ones, as near as `reach` [m], shape ``(K, 2)`` [m]."""
    world = start.world
    if world.seen is None:
        return np.empty((0, 2))
    near = world.seen.grid.around(start.pose[None, :2], reach)
    if world.map is not None:
        near = near.completed_by(world.map.grid)
    cells = np.pad(near.cells, 1, constant_values=Cell.OCCUPIED)
    free = cells == Cell.FREE
    beside = free[:-2, 1:-1] | free[2:, 1:-1] | free[1:-1, :-2] | free[1:-1, 2:]
    return near.centers(*np.nonzero((near.cells == Cell.UNKNOWN) & beside))
