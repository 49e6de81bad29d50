"""Where the robot's centre may be: the road shrunk and the obstacles grown by what it needs."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cmpsp_ros.mpsp.compiled import allocation_free
from cmpsp_ros.robot import road_functions
from cmpsp_ros.robot.annulus_functions import AnnulusSpace
from cmpsp_ros.robot.arcs import arc_from, reach
from cmpsp_ros.robot.between_samples import TwistLimits, at_ends, outside, outside_known
from cmpsp_ros.robot.obstacles import Obstacle
from cmpsp_ros.robot.road import Road, RoadSpace

Array = NDArray[np.float64]

# Between two arcs [m]; beyond it the second has nothing to do with where on the road the first was.
_JUMP = 0.1


@dataclass(frozen=True)
class ClearSpace:
    """A road with discs taken out of it; all of it may change along a horizon.

    Attributes:
        road: Where on the road the robot's centre may be.
        centers: Centres of the discs, shape ``(M, 2)`` [m].
        radii: Radii of the discs, shape ``(M,)`` or ``(K, M)`` [m].
    """

    road: RoadSpace
    centers: Array
    radii: Array

    @classmethod
    def of(cls, road: Road, obstacles: Sequence[Obstacle], distance: float) -> ClearSpace:
        """Space whose every point is at least ``distance`` [m] from road edges and obstacles."""
        return cls(
            road.space(distance),
            np.array([obstacle.center for obstacle in obstacles]).reshape(-1, 2),
            np.array([obstacle.radius + distance for obstacle in obstacles]),
        )

    @property
    def annulus(self) -> AnnulusSpace:
        """The road, for what is about roads between two circles only.

        Raises:
            ValueError: It is another.
        """
        if not isinstance(self.road, AnnulusSpace):
            found = type(self.road).__name__
            raise ValueError(f'road: found {found}, wanted AnnulusSpace')  # noqa: TRY004
        return self.road

    def for_samples(self, limits: TwistLimits, period: float) -> ClearSpace:
        """Space to keep to at samples so that any arcs between them stay within this one.

        Args:
            limits: What the robot can drive.
            period: Time between two samples [s].
        """
        return ClearSpace(
            self.road.for_samples(limits, period),
            self.centers,
            np.array([outside(radius, limits, period) for radius in self.radii.tolist()]),
        )

    def for_samples_of(self, twists: Array, period: float) -> ClearSpace:
        """Space to keep to at the samples of one plan so that its own arcs stay within this one.

        Args:
            twists: Speed and turn rate between samples, shape ``(N, 2)`` [m/s, rad/s].
            period: Time between two samples [s].

        Returns:
            A space for each of the ``N + 1`` samples, between two arcs each.
        """
        return ClearSpace(
            self.road.for_samples_of(twists, period),
            self.centers,
            at_ends(np.maximum, outside_known(self.radii, twists, period)),
        )

    def at(self, poses: Array) -> Array:
        """Clearance of single poses.

        Args:
            poses: Shape ``(K, 3)`` [m, m, rad]; the samples, where the space is one for each.

        Returns:
            To both edges of the road and to each disc, negative where violated; shape
            ``(K, 2 + M)`` [m].
        """
        edges = np.empty((len(poses), 2))
        _edges_at(edges, self.road, np.ascontiguousarray(poses))
        away = np.linalg.norm(poses[:, None, :2] - self.centers, axis=2)
        return np.column_stack([edges, away - self.radii])

    def along(self, poses: Array, twists: Array, durations: Array) -> Array:
        """Least clearance of arcs, from end to end, along a path.

        Where the road crosses itself a path keeps to the branch that it is on.

        Args:
            poses: Pose at the start of each arc, shape ``(K, 3)`` [m, m, rad].
            twists: Speed and turn rate along it, shape ``(K, 2)`` [m/s, rad/s].
            durations: Shape ``(K,)`` [s].

        Returns:
            As from `at`.
        """
        edges = np.empty((len(poses), 2))
        arguments = (np.ascontiguousarray(each) for each in (poses, twists, durations))
        _edges_along(edges, self.road, *arguments)
        least, _ = reach(poses, twists, durations, self.centers)
        return np.column_stack([edges, least - self.radii])


@allocation_free
def _edges_at(clearance: Array, road: Any, poses: Array) -> None:
    for k in range(poses.shape[0]):
        x, y = poses[k, 0], poses[k, 1]
        place = road_functions.find(road, x, y, poses[k, 2])
        _, _, over, over_other = road_functions.measure(road, k, x, y, place)
        clearance[k, 0] = min(-over, road_functions.FAR)
        clearance[k, 1] = min(-over_other, road_functions.FAR)


@allocation_free
def _edges_along(clearance: Array, road: Any, poses: Array, twists: Array, times: Array) -> None:
    place, end_x, end_y = 0.0, math.nan, math.nan
    for k in range(poses.shape[0]):
        x, y, heading = poses[k, 0], poses[k, 1], poses[k, 2]
        if not math.hypot(x - end_x, y - end_y) <= _JUMP:
            place = road_functions.find(road, x, y, heading)
        arc = arc_from(x, y, heading, twists[k, 0] * times[k], twists[k, 1] * times[k])
        place, clearance[k, 0], clearance[k, 1] = road_functions.sweep(
            road, arc, place, math.inf, math.inf
        )
        end_x, end_y = arc.end_x, arc.end_y
