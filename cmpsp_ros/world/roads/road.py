"""Roads: what the robot stays inside, and whose centre line it keeps to."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from cmpsp_ros.world.roads.corridor import Corridor
from cmpsp_ros.world.roads.road_space import ANNULUS, OPEN_FLOOR, RoadSpace, road_space

Array = NDArray[np.float64]

_CORNERS = 181


@dataclass(frozen=True)
class Annulus:
    """The curved road (92), between two concentric circles.

    Attributes:
        center: Centre of both circles (x, y) [m].
        inner_radius: ``r_i`` [m].
        outer_radius: ``r_o`` [m].
    """

    edge_names: ClassVar = ('the outer road edge', 'the inner road edge')

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

    @cached_property
    def _space(self) -> RoadSpace:
        x, y = self.center
        return road_space(ANNULUS, center_x=x, center_y=y, center_radius=self.center_radius)

    def _circle(self, radius: float) -> Array:
        (x, y), last = self.center, _CORNERS - 1
        angles = [math.tau * i / last for i in range(_CORNERS)]
        return np.array([(x + radius * math.cos(a), y + radius * math.sin(a)) for a in angles])


@dataclass(frozen=True)
class OpenFloor:
    """No road: neither edges nor a centre line."""

    edge_names: ClassVar = ('an edge', 'an edge')

    @property
    def width(self) -> float:
        """What a picture should show around a path [m]."""
        return 2.0

    def space(self, distance: float) -> RoadSpace:  # noqa: ARG002
        """The whole plane."""
        return _PLANE

    def edges(self) -> list[Array]:
        """None."""
        return []

    def center_line(self) -> Array:
        """None, shape ``(0, 2)``."""
        return np.empty((0, 2))

    def area(self) -> Array:
        """None, shape ``(0, 2)``."""
        return np.empty((0, 2))

    def middle(self) -> Array:
        """Any pose, shape ``(3,)`` [m, m, rad]."""
        return np.zeros(3)

    def beside(self) -> Array:
        """Any other pose, shape ``(3,)`` [m, m, rad]."""
        return np.array([1.0, 0.0, 0.0])


Road = Annulus | Corridor | OpenFloor
"""What the settings hold."""

_PLANE = road_space(OPEN_FLOOR)
