"""What every kind of road says of itself; `road_functions` has what compiled code asks of it."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from typing import ClassVar

from cmpsp_ros.arrays import Array
from cmpsp_ros.world.roads.road_space import RoadSpace

Point = tuple[float, float]


class Road(ABC):
    """What the robot stays inside, and whose centre line it keeps to.

    A road of its own kind is a frozen dataclass, which is equal to another one of the same values.
    """

    edge_names: ClassVar[tuple[str, str]]
    """What messages call the first and the second edge."""

    has_center_line: ClassVar[bool] = True
    """Whether there are edges and a line between them."""

    has_progress: ClassVar[bool] = False
    """Whether a point can be on it in two places, which the progress tells apart."""

    @property
    @abstractmethod
    def width(self) -> float:
        """From edge to edge where it is greatest, or what a picture should show [m]."""

    @property
    def lap(self) -> float:
        """Length of the centre line of a road without end; 0 where it has one [m]."""
        return 0.0

    @abstractmethod
    def space(self, distance: float) -> RoadSpace:
        """Where the robot's centre is at least so far from both edges [m]."""

    @abstractmethod
    def edges(self) -> list[Array]:
        """Both edges, if there are any, in any order, each of shape ``(K, 2)`` [m]."""

    @abstractmethod
    def center_line(self) -> Array:
        """The centre line, shape ``(K, 2)`` [m]."""

    @abstractmethod
    def area(self) -> Array:
        """The road as one polygon, shape ``(K, 2)`` [m]."""

    @abstractmethod
    def middle(self) -> Array:
        """A pose in the middle of the road, along it, shape ``(3,)`` [m, m, rad]."""

    @abstractmethod
    def beside(self) -> Array:
        """A pose that is not on this part of the road, shape ``(3,)`` [m, m, rad]."""

    def beyond(self, point: Point) -> float:  # noqa: ARG002
        """How far a point lies beyond an end of the road, 0 where it does not [m]."""
        return 0.0

    def shortest_length(self, start: Point, goal: Point, distance: float = 0.0) -> float:  # noqa: ARG002
        """A length that no path is shorter than that keeps the distance from both edges [m]."""
        return math.dist(start, goal)
