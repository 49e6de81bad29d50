"""The road between two circles, for compiled code."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cmpsp_ros.mpsp.jit.compiled import allocation_free, implements
from cmpsp_ros.robot import road_functions
from cmpsp_ros.robot.arcs import Arc, reach_of
from cmpsp_ros.robot.between_samples import (
    TwistLimits,
    at_ends,
    inside,
    inside_known,
    outside,
    outside_known,
)

Array = NDArray[np.float64]

# The centre line's distance has no second derivative at the road's centre; nearer than this [m]
# its curvature is held.
_LEAST_RADIUS = 1e-3


class AnnulusSpace(NamedTuple):
    """Where between two circles the robot's centre may be; the outer edge is the first.

    Attributes:
        center: Of both circles, shape ``(2,)`` [m].
        center_radius: ``r_p``, radius of the road's centre line [m].
        inner: Least distance from the centre, one for all stages or one for each, shape
            ``(K,)`` [m].
        outer: Greatest distance from it, shape ``(K,)`` [m].
    """

    center: Array
    center_radius: float
    inner: Array
    outer: Array

    def for_samples(self, limits: TwistLimits, period: float) -> AnnulusSpace:
        """See `ClearSpace.for_samples`."""
        return self._replace(
            inner=np.array([outside(float(self.inner[0]), limits, period)]),
            outer=np.array([inside(float(self.outer[0]), limits, period)]),
        )

    def for_samples_of(self, twists: Array, period: float) -> AnnulusSpace:
        """See `ClearSpace.for_samples_of`."""
        inner = outside_known(self.inner, twists, period)[:, 0]
        outer = inside_known(float(self.outer[0]), twists, period)
        return self._replace(inner=at_ends(np.maximum, inner), outer=at_ends(np.minimum, outer))

    def with_some(self, samples: NDArray[np.bool_], of: AnnulusSpace) -> AnnulusSpace:
        """See `ClearSpace.with_some`."""
        inner, outer = (
            np.where(samples, of.inner, self.inner),
            np.where(samples, of.outer, self.outer),
        )
        return self._replace(inner=inner, outer=outer)


@implements(road_functions.find, AnnulusSpace)
def find(road: AnnulusSpace, x: float, y: float, heading: float, near: float) -> float:
    """Nothing: a bearing says it all; see `road_functions.find`."""
    return 0.0


@implements(road_functions.measure, AnnulusSpace)
def measure(road: AnnulusSpace, k: int, x: float, y: float, progress: float) -> Any:
    """Distances from the centre; see `road_functions.measure`."""
    distance = _distance(road, x, y)
    at = min(k, road.inner.shape[0] - 1)
    return 0.0, distance - road.center_radius, distance - road.outer[at], road.inner[at] - distance


@implements(road_functions.slopes, AnnulusSpace)
def slopes(road: AnnulusSpace, x: float, y: float, progress: float) -> Any:
    """The unit vector away from the centre; see `road_functions.slopes`.

    The second derivative of ``(r - r_p)^2 / 2`` is ``n n' + (1 - r_p / r) t t'`` with unit
    vectors ``n`` across and ``t`` along the road.
    """
    distance = _distance(road, x, y)
    away_x, away_y = 1.0, 0.0
    if distance > 0.0:
        away_x, away_y = (x - road.center[0]) / distance, (y - road.center[1]) / distance
    along = (distance - road.center_radius) / max(distance, _LEAST_RADIUS)
    return away_x, away_y, along, away_x, away_y, -away_x, -away_y


@implements(road_functions.sweep, AnnulusSpace)
def sweep(road: AnnulusSpace, arc: Arc, progress: float, enough: float, enough_other: float) -> Any:
    """Exact distances of the arc from the centre; see `road_functions.sweep`."""
    least, greatest = reach_of(arc, road.center[0], road.center[1])
    return 0.0, road.outer[0] - greatest, least - road.inner[0]


@implements(road_functions.way_to, AnnulusSpace)
def way_to(
    road: AnnulusSpace,
    x: float,
    y: float,
    progress: float,
    goal_x: float,
    goal_y: float,
    goal: float,
) -> float:
    """The shorter way round, positive anticlockwise; see `road_functions.way_to`."""
    bearing = math.atan2(y - road.center[1], x - road.center[0])
    turn = math.atan2(goal_y - road.center[1], goal_x - road.center[0]) - bearing
    return road.center_radius * (turn - 2.0 * math.pi * round(turn / (2.0 * math.pi)))


@implements(road_functions.ahead, AnnulusSpace)
def ahead(road: AnnulusSpace, x: float, y: float, progress: float, way: float, to: Any) -> Any:
    """The point so far round the centre; see `road_functions.ahead`."""
    bearing = math.atan2(y - road.center[1], x - road.center[0])
    turned = bearing + math.copysign(abs(way) / road.center_radius, way)
    radius = road.center_radius
    return road.center[0] + radius * math.cos(turned), road.center[1] + radius * math.sin(turned)


@allocation_free
def _distance(road: AnnulusSpace, x: float, y: float) -> float:
    dx, dy = x - road.center[0], y - road.center[1]
    return math.sqrt(dx * dx + dy * dy)
