"""Open floor: neither edges nor a centre line."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from cmpsp_ros.arrays import Array
from cmpsp_ros.world.roads.road import Road
from cmpsp_ros.world.roads.road_space import OPEN_FLOOR, RoadSpace, road_space

_PLANE = road_space(OPEN_FLOOR)


@dataclass(frozen=True)
class OpenFloor(Road):
    """No road: neither edges nor a centre line."""

    edge_names: ClassVar[tuple[str, str]] = ('an edge', 'an edge')
    has_center_line: ClassVar[bool] = False

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
