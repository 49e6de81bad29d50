"""Places on a map that are tight, and runs of a robot 0.35 m wide through them."""

import math
from collections import Counter
from itertools import takewhile

import numpy as np

from cmpsp_ros.guidance import GuidanceSettings, InitialGuess, Safety
from cmpsp_ros.robots import DifferentialDrive
from cmpsp_ros.studies.closed_loop import drive
from cmpsp_ros.world.grids import Cell, GridObstacle, OccupancyGrid
from cmpsp_ros.world.roads import OpenFloor

CELL = 0.05


def map_of(wide, high, *boxes):
    """A map with walls around it; boxes are left, right, low and high [m]."""
    cells = np.zeros((round(high / CELL), round(wide / CELL)), np.uint8)
    cells[:2] = cells[-2:] = cells[:, :2] = cells[:, -2:] = Cell.OCCUPIED
    for box in boxes:
        left, right, low, top = (round(each / CELL) for each in box)
        cells[low:top, left:right] = Cell.OCCUPIED
    return GridObstacle('map', OccupancyGrid((0.0, 0.0, 0.0), CELL, cells))


def task(goal, *obstacles, **changes):
    """Settings of a robot among obstacles, at 0.7 m/s at most."""
    given = {
        'robot': DifferentialDrive(max_wheel_speed=20.0),
        'road': OpenFloor(),
        'goal': goal,
        'obstacles': obstacles,
        'robot_radius': 0.175,
        'safety': Safety(0.02),
        'initial_guess': InitialGuess('road'),
        'final_time': 20.0,
        'may_be_late': True,
    }
    return GuidanceSettings(**(given | changes))


class TightRun:
    """A run of the law with its own model, for a time at most [s].

    Attributes:
        decisions: All of them.
        poses: Of the decisions, and the last.
        levels: Number of decisions of each fallback level.
        miss: Distance from the goal in the end [m].
        clearance: Least clearance of the path [m].
        time: Of the last decision [s].
    """

    def __init__(self, given, pose, longest):
        """Drive from a pose until the law says that the run is over, or for the longest time."""
        pose, period = np.array(pose, dtype=float), given.control_period
        steps = drive(given, pose)
        self.decisions, self.poses, self.clearance = [], [pose], math.inf
        for each in takewhile(lambda decision: decision.stamp <= 1e9 * longest, steps):
            self.decisions.append(each)
            held = each.wheel_speeds[None]
            left = each.time_left if 0.0 < each.time_left < period else period
            swept = given.world.clearance(
                given, pose[None], given.robot.twist(held), seconds := np.array([left])
            )
            self.clearance = min(self.clearance, float(swept.min()))
            pose = given.robot.roll_out(pose, held, seconds)[-1]
            self.poses.append(pose)
        self.levels = Counter(each.level for each in self.decisions)
        self.miss, self.time = math.dist(pose[:2], given.goal), self.decisions[-1].stamp / 1e9
