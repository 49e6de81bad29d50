"""Where a plan begins: the state at which the command decided now takes effect."""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cmpsp_ros.robots.robot import Robot
from cmpsp_ros.world.obstacles.moving_discs import NOTHING_MOVES, MovingDiscs

AT_REST: Final = np.zeros(2)


class PlanStart(NamedTuple):
    """The initial state of a plan, and the models that predict it on from there.

    Attributes:
        pose: Pose, shape ``(3,)`` [m, m, rad].
        robot: Kinematics, with the slip that is estimated.
        moving: Moving obstacles, from then on.
        progress: Arc length along the road of a place near the pose, NaN if not needed [m].
        previous_control: Control commanded until then, shape ``(r,)``.
    """

    pose: NDArray[np.float64]
    robot: Robot
    moving: MovingDiscs = NOTHING_MOVES
    progress: float = math.nan
    previous_control: NDArray[np.float64] = AT_REST
