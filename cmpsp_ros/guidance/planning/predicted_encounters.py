"""Where a robot on its way meets what moves, for the choice on which side to pass it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from cmpsp_ros.guidance.decision import Plan
from cmpsp_ros.guidance.horizon import Horizon, shift
from cmpsp_ros.guidance.planning.candidate import Start
from cmpsp_ros.guidance.planning.initial_trajectories import along_road
from cmpsp_ros.guidance.settings import GuidanceSettings
from cmpsp_ros.world.free_space import FreeSpace

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Met:
    """Discs that move, held still where and when they are met.

    Attributes:
        names: What messages call them.
        centers: Shape ``(M, 2)`` [m].
        radii: With all that is kept from them, shape ``(M,)`` [m].
    """

    names: tuple[str, ...]
    centers: Array
    radii: Array

    def taken_from(self, space: FreeSpace) -> FreeSpace:
        """A space without them, where there are any, as at one instant."""
        if not self.names:
            return space
        still = space if space.radii.ndim == 1 else replace(space, radii=np.median(space.radii, 0))
        taken = still.with_points(self.centers[None], self.radii[None])
        return replace(taken, radii=taken.radii[0])


_NOT_MET = Met((), np.empty((0, 2)), np.empty(0))


def meet(settings: GuidanceSettings, start: Start, plan: Plan | None, horizon: Horizon) -> Met:
    """Where each disc is when the robot comes nearest to it.

    Args:
        settings: All settings of the guidance law.
        start: Where the robot is, and what moves.
        plan: What it follows; None where it goes along the road.
        horizon: From now on.
    """
    if not len(start.moving):
        return _NOT_MET
    durations = horizon.durations
    controls = (
        along_road(settings, start.pose, durations)
        if plan is None
        else shift(plan.controls, plan.horizon, horizon)
    )
    poses = settings.robot.roll_out(start.pose, controls, durations)
    centers, radii = start.moving.at_times(np.concatenate([[0.0], np.cumsum(durations)]))
    away = centers - poses[:, None, :2]
    nearest = np.argmin(np.hypot(away[..., 0], away[..., 1]) - radii, axis=0)
    each = np.arange(len(start.moving))
    kept = settings.robot_radius + settings.safety.margin
    return Met(start.moving.names, centers[nearest, each], radii[nearest, each] + kept)
