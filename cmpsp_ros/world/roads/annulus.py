"""The curved road of the paper, between two concentric circles."""

import math
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from cmpsp_ros.arrays import Array
from cmpsp_ros.mpsp.jit import allocation_free, inner
from cmpsp_ros.robots import TwistLimits
from cmpsp_ros.robots.motion import Arc, reach_of
from cmpsp_ros.world.inter_sample_margin import (
    at_ends,
    inside,
    inside_known,
    outside,
    outside_known,
)
from cmpsp_ros.world.roads.road import Point, Road
from cmpsp_ros.world.roads.road_functions import RoadSpace, no_progress

_CORNERS = 181

# The centre line's distance has no second derivative at the road's centre; nearer than this [m]
# its curvature is held.
_LEAST_RADIUS = 1e-3


# The numbers are both coordinates of the centre and the radius of the centre line.
@allocation_free
def _distance(road: RoadSpace, x: float, y: float) -> float:
    dx, dy = x - road.numbers[0], y - road.numbers[1]
    return math.sqrt(dx * dx + dy * dy)


@inner
def _lateral_error(road: RoadSpace, k: int, x: float, y: float, _at: float) -> None:
    distance = _distance(road, x, y)
    road.found[0], road.found[1] = 0.0, distance - road.numbers[2]
    road.found[2], road.found[3] = distance - road.kept[k, 0], road.kept[k, 1] - distance


@inner
def _gradients(road: RoadSpace, x: float, y: float, _at: float) -> None:
    """Unit vectors away from the centre.

    The second derivative of ``(r - r_p)^2 / 2`` is ``n n' + (1 - r_p / r) t t'`` with unit
    vectors ``n`` across and ``t`` along the road.
    """
    distance = _distance(road, x, y)
    away_x, away_y = 1.0, 0.0
    if distance > 0.0:
        away_x, away_y = (x - road.numbers[0]) / distance, (y - road.numbers[1]) / distance
    road.found[0], road.found[1] = away_x, away_y
    road.found[2] = (distance - road.numbers[2]) / max(distance, _LEAST_RADIUS)
    road.found[3], road.found[4], road.found[5], road.found[6] = away_x, away_y, -away_x, -away_y


@inner
def _sweep(road: RoadSpace, arc: Arc, _at: float, _enough: float, _enough_other: float) -> None:
    least, greatest = reach_of(arc, road.numbers[0], road.numbers[1])
    road.found[0], road.found[1], road.found[2] = (
        0.0,
        road.kept[0, 0] - greatest,
        least - road.kept[0, 1],
    )


@inner
def _arc_length_to(
    road: RoadSpace, x: float, y: float, _at: float, goal_x: float, goal_y: float, _goal: float
) -> None:
    """The shorter way round, positive anticlockwise."""
    bearing = math.atan2(y - road.numbers[1], x - road.numbers[0])
    turn = math.atan2(goal_y - road.numbers[1], goal_x - road.numbers[0]) - bearing
    road.found[0] = road.numbers[2] * (turn - 2.0 * math.pi * round(turn / (2.0 * math.pi)))


@inner
def _point_ahead(road: RoadSpace, x: float, y: float, _at: float, way: float, _to: Any) -> None:
    radius = road.numbers[2]
    turned = math.atan2(y - road.numbers[1], x - road.numbers[0])
    turned += math.copysign(abs(way) / radius, way)
    road.found[0] = road.numbers[0] + radius * math.cos(turned)
    road.found[1] = road.numbers[1] + radius * math.sin(turned)


@dataclass(frozen=True)
class Annulus(Road):
    """The curved road (92), between two circles of radii ``r_i`` and ``r_o`` about a centre [m]."""

    edge_names: ClassVar[tuple[str, str]] = ('the outer road edge', 'the inner road edge')
    functions: ClassVar = (
        no_progress, _lateral_error, _gradients, _sweep, _arc_length_to, _point_ahead,
    )  # fmt: skip

    center: tuple[float, float] = (0.0, 0.0)
    inner_radius: float = 9.0
    outer_radius: float = 11.0

    @property
    def center_radius(self) -> float:
        """Radius ``r_p`` of the centre line [m]."""
        return (self.inner_radius + self.outer_radius) / 2.0

    @property
    def width(self) -> float:
        """From edge to edge [m]."""
        return self.outer_radius - self.inner_radius

    @property
    def lap(self) -> float:
        """Circumference of the centre line [m]."""
        return math.tau * self.center_radius

    @property
    def numbers(self) -> Array:
        """The centre of both circles and the radius of the centre line."""
        return np.array([*self.center, self.center_radius], dtype=float)

    def kept(self, distance: float) -> Array:
        """Greatest and least distance from the centre, shape ``(1, 2)`` [m]."""
        return np.array([[self.outer_radius - distance, self.inner_radius + distance]], dtype=float)

    def kept_at_samples(self, kept: Array, limits: TwistLimits, period: float) -> Array:
        """Bounds with the inter-sample margin, see `Road.kept_at_samples`."""
        outer, inner_ = kept[0].tolist()
        return np.array([[inside(outer, limits, period), outside(inner_, limits, period)]])

    def kept_for(self, kept: Array, twists: Array, period: float) -> Array:
        """Bounds for the arcs of one plan, see `Road.kept_for`."""
        outer = inside_known(float(kept[0, 0]), twists, period)
        inner_ = outside_known(kept[:, 1], twists, period)[:, 0]
        return np.column_stack([at_ends(np.minimum, outer), at_ends(np.maximum, inner_)])

    def edges(self) -> list[Array]:
        """Both edges as closed lines, the inner first, each of shape ``(K, 2)`` [m]."""
        return [self._circle(radius) for radius in (self.inner_radius, self.outer_radius)]

    def center_line(self) -> Array:
        """The centre line, closed, shape ``(K, 2)`` [m]."""
        return self._circle(self.center_radius)

    def area(self) -> Array:
        """The road as one polygon, shape ``(K, 2)`` [m]."""
        inner, outer = self.edges()
        return np.vstack([outer, inner[::-1]])

    def middle(self) -> Array:
        """A pose in the middle of the road, along it, shape ``(3,)`` [m, m, rad]."""
        return np.array([self.center[0] + self.center_radius, self.center[1], math.pi / 2.0])

    def beside(self) -> Array:
        """A pose that is not on the road, shape ``(3,)`` [m, m, rad]."""
        return np.array([self.center[0] + 1.5 * self.outer_radius, self.center[1], math.pi / 2.0])

    def shortest_length(self, start: Point, goal: Point, distance: float = 0.0) -> float:
        """Length of a taut string around the inner edge: straight, or two tangents and an arc."""
        radius = self.inner_radius + distance
        near, far = (max(math.dist(each, self.center), radius) for each in (start, goal))
        turned = abs(self.angle_between(start, goal))
        if radius <= 0.0:
            return math.dist(start, goal)
        free = math.acos(radius / near) + math.acos(radius / far)
        if turned <= free:
            return math.dist(start, goal)
        tangents = math.sqrt(near**2 - radius**2) + math.sqrt(far**2 - radius**2)
        return tangents + radius * (turned - free)

    def angle_between(self, start: Point, goal: Point) -> float:
        """Angle about the centre from start to goal the shorter way round, to the left [rad]."""
        x_0, y_0 = self.center
        first, last = (math.atan2(y - y_0, x - x_0) for x, y in (start, goal))
        return math.remainder(last - first, math.tau)

    def _circle(self, radius: float) -> Array:
        (x, y), last = self.center, _CORNERS - 1
        angles = [math.tau * i / last for i in range(_CORNERS)]
        return np.array([(x + radius * math.cos(a), y + radius * math.sin(a)) for a in angles])
