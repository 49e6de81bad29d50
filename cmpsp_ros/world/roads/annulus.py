"""The curved road of the paper, between two concentric circles."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np

from cmpsp_ros.arrays import Array
from cmpsp_ros.world.roads.road import Point, Road
from cmpsp_ros.world.roads.road_space import ANNULUS, RoadSpace, road_space

_CORNERS = 181


@dataclass(frozen=True)
class Annulus(Road):
    """The curved road (92), between two concentric circles.

    Attributes:
        center: Centre of both circles (x, y) [m].
        inner_radius: ``r_i`` [m].
        outer_radius: ``r_o`` [m].
    """

    edge_names: ClassVar[tuple[str, str]] = ('the outer road edge', 'the inner road edge')

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

    def space(self, distance: float) -> RoadSpace:
        """Where the robot's centre is at least so far from both edges [m]."""
        kept = np.array([[self.outer_radius - distance, self.inner_radius + distance]], dtype=float)
        return self._space._replace(kept=kept)

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
        """Of a string pulled taut around the inner edge: straight, or two tangents and an arc."""
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

    @cached_property
    def _space(self) -> RoadSpace:
        x, y = self.center
        return road_space(ANNULUS, center_x=x, center_y=y, center_radius=self.center_radius)

    def _circle(self, radius: float) -> Array:
        (x, y), last = self.center, _CORNERS - 1
        angles = [math.tau * i / last for i in range(_CORNERS)]
        return np.array([(x + radius * math.cos(a), y + radius * math.sin(a)) for a in angles])
