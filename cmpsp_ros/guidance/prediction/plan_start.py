"""Where a plan begins: the state at which the command decided now takes effect."""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np

from cmpsp_ros.arrays import Array
from cmpsp_ros.guidance.world import World
from cmpsp_ros.robots import Robot
from cmpsp_ros.world.obstacles import NOTHING_MOVES, MovingDiscs

AT_REST: Final = np.zeros(2)


class PlanStart(NamedTuple):
    """The initial state of a plan, and the models that predict it on from there.

    Attributes:
        pose: Pose, shape ``(3,)`` [m, m, rad].
        robot: Kinematics, with the slip that is estimated.
        world: Road and static obstacles.
        moving: Moving obstacles, from then on.
        progress: Arc length along the road of a place near the pose, NaN if not needed [m].
        previous_control: Control commanded until then, shape ``(r,)``.
    """

    pose: Array
    robot: Robot
    world: World
    moving: MovingDiscs = NOTHING_MOVES
    progress: float = math.nan
    previous_control: Array = AT_REST
