"""Where the robot's centre may be: the road shrunk and the obstacles grown by what it needs."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cmpsp_ros.robot.between_samples import (
    TwistLimits,
    inside,
    inside_known,
    outside,
    outside_known,
)
from cmpsp_ros.robot.obstacles import Obstacle
from cmpsp_ros.robot.road import Annulus

Array = NDArray[np.float64]


@dataclass(frozen=True)
class ClearSpace:
    """An annulus with discs taken out of it; its radii may change along a horizon.

    Attributes:
        centers: Centres of the annulus and then of the discs, shape ``(1 + M, 2)`` [m].
        inner: Least distance from the annulus' centre, shape ``()`` or ``(K,)`` [m].
        outer: Greatest distance from it, shape ``()`` or ``(K,)`` [m].
        radii: Radii of the discs, shape ``(M,)`` or ``(K, M)`` [m].
    """

    centers: Array
    inner: Array
    outer: Array
    radii: Array

    @classmethod
    def of(cls, road: Annulus, obstacles: Sequence[Obstacle], distance: float) -> ClearSpace:
        """Space whose every point is at least ``distance`` [m] from road edges and obstacles."""
        return cls(
            np.array([road.center, *(obstacle.center for obstacle in obstacles)]),
            np.array(road.inner_radius + distance),
            np.array(road.outer_radius - distance),
            np.array([obstacle.radius + distance for obstacle in obstacles]),
        )

    def for_samples(self, limits: TwistLimits, period: float) -> ClearSpace:
        """Space to keep to at samples so that any arcs between them stay within this one.

        Args:
            limits: What the robot can drive.
            period: Time between two samples [s].
        """
        return ClearSpace(
            self.centers,
            np.array(outside(float(self.inner), limits, period)),
            np.array(inside(float(self.outer), limits, period)),
            np.array([outside(radius, limits, period) for radius in self.radii.tolist()]),
        )

    def for_samples_of(self, twists: Array, period: float) -> ClearSpace:
        """Space to keep to at the samples of one plan so that its own arcs stay within this one.

        Args:
            twists: Speed and turn rate between samples, shape ``(N, 2)`` [m/s, rad/s].
            period: Time between two samples [s].

        Returns:
            A space with radii for each of the ``N + 1`` samples, between two arcs each.
        """
        inner = outside_known(self.inner[None], twists, period)[:, 0]
        return ClearSpace(
            self.centers,
            _at_ends(np.maximum, inner),
            _at_ends(np.minimum, inside_known(float(self.outer), twists, period)),
            _at_ends(np.maximum, outside_known(self.radii, twists, period)),
        )

    def clearance(self, least: Array, greatest: Array) -> Array:
        """Clearance of points or paths from their distances to `centers`.

        Args:
            least: Least distances, shape ``(K, 1 + M)`` [m].
            greatest: Greatest distances, shape ``(K, 1 + M)`` [m]; for points the same.

        Returns:
            To the outer edge, the inner edge and each disc, negative where violated; shape
            ``(K, 2 + M)`` [m].
        """
        clearance = np.empty((len(least), least.shape[1] + 1))
        clearance[:, 0] = self.outer - greatest[:, 0]
        clearance[:, 1] = least[:, 0] - self.inner
        clearance[:, 2:] = least[:, 1:] - self.radii
        return clearance


def _at_ends(worse: Callable[[Array, Array], Array], of_arcs: Array) -> Array:
    """From one value an arc to one a sample: the worse of the two arcs that meet there."""
    before, after = np.concatenate([of_arcs[:1], of_arcs]), np.concatenate([of_arcs, of_arcs[-1:]])
    return worse(before, after)
