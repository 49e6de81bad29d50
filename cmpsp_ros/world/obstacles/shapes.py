"""Obstacles that stand still: discs (93), and beside the paper other shapes and grids."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cmpsp_ros.arrays import Array
from cmpsp_ros.world.grids.grid_obstacle import GridObstacle

Point = tuple[float, float]

_TURN = math.tau / 72.0
"""Between two points of a rounded outline [rad]."""


@dataclass(frozen=True)
class Obstacle:
    """A disc to keep out of.

    Attributes:
        name: The user's name for it, used in messages.
        center: Centre (x, y) [m].
        radius: Radius [m].
    """

    name: str
    center: Point
    radius: float

    @property
    def corners(self) -> tuple[Point, ...]:
        """What the radius is kept from: the centre."""
        return (self.center,)


@dataclass(frozen=True)
class Capsule:
    """All that is near a line between two points: a wall, a table on its legs, a parked car.

    Attributes:
        name: The user's name for it, used in messages.
        start: One end of the line (x, y) [m].
        end: The other.
        radius: Distance from the line up to which it reaches [m].
    """

    name: str
    start: Point
    end: Point
    radius: float

    @property
    def corners(self) -> tuple[Point, ...]:
        """What the radius is kept from: both ends, and all between them."""
        return (self.start, self.end)

    @property
    def center(self) -> Point:
        """Its middle (x, y) [m]."""
        return _middle(self.corners)


@dataclass(frozen=True)
class Polygon:
    """A convex polygon.

    Attributes:
        name: The user's name for it, used in messages.
        vertices: Its corners, anticlockwise, shape ``(V, 2)`` with at least three [m].
    """

    name: str
    vertices: tuple[Point, ...]

    @property
    def corners(self) -> tuple[Point, ...]:
        """The vertices."""
        return self.vertices

    @property
    def center(self) -> Point:
        """The middle between its sides (x, y) [m]."""
        return _middle(self.vertices)

    @property
    def radius(self) -> float:
        """None."""
        return 0.0


Shape = Obstacle | Capsule | Polygon | GridObstacle
"""What the settings hold."""


class ShapeError(ValueError):
    """Vertices that make no convex polygon.

    Attributes:
        vertex: Number of the one at fault, from 0.
        found: What is wrong with it.
        wanted: What was wanted.
    """

    def __init__(self, vertex: int, found: str, wanted: str) -> None:
        super().__init__(f'vertex {vertex}: found {found}, wanted {wanted}')
        self.vertex, self.found, self.wanted = vertex, found, wanted


def convex(name: str, vertices: Sequence[Point]) -> Polygon:
    """A polygon from its vertices in either sense of rotation.

    Raises:
        ShapeError: There are less than three, or two of them coincide, or one of them does not
            turn the way that the others do, or they go round more than once.
    """
    count = len(vertices)
    if count < 3:
        raise ShapeError(max(count - 1, 0), f'{count} vertices in all', 'three or more')
    edges = [
        (b[0] - a[0], b[1] - a[1])
        for a, b in ((vertices[i], vertices[(i + 1) % count]) for i in range(count))
    ]
    for i, edge in enumerate(edges):
        if not any(edge):
            after = (i + 1) % count
            raise ShapeError(max(i, after), 'the place of the vertex before', 'another place')
    turns = [
        math.atan2(a[0] * b[1] - a[1] * b[0], a[0] * b[0] + a[1] * b[1])
        for a, b in ((edges[i - 1], edges[i]) for i in range(count))
    ]
    side = math.copysign(1.0, math.fsum(turns))
    for i, turn in enumerate(turns):
        if not 0.0 < side * turn < math.pi:
            raise ShapeError(i, 'a corner that is not convex', 'a turn to the same side as others')
    if abs(math.fsum(turns)) > 1.5 * math.tau:
        raise ShapeError(count - 1, 'a second time round', 'vertices that go round once')
    return Polygon(name, tuple(vertices if side > 0.0 else reversed(vertices)))


def outlines(obstacle: Shape, distance: float) -> list[Array]:
    """The closed lines at a distance [m] from an obstacle without its radius, ``(K, 2)`` [m] each.

    With the obstacle's own radius they are its edge, anticlockwise, and clockwise around holes.
    """
    if isinstance(obstacle, GridObstacle):
        return obstacle.outlines(distance)
    return [outline_of(obstacle.corners, distance)]


def outline_of(corners: Sequence[Point], distance: float) -> Array:
    """The closed line at a distance [m] from corners, ``(K, 2)`` [m]."""
    count = len(corners)
    if count == 1:
        return _arc(corners[0], distance, 0.0, math.tau)
    headings = [
        math.atan2(b[1] - a[1], b[0] - a[0])
        for a, b in ((corners[i], corners[(i + 1) % count]) for i in range(count))
    ]
    parts = []
    for i, corner in enumerate(corners):
        begin = headings[i - 1] - math.pi / 2.0
        turn = (headings[i] - headings[i - 1]) % math.tau
        parts.append(_arc(corner, distance, begin, turn))
    line = np.vstack(parts)
    return np.vstack([line, line[:1]])


def _middle(corners: Sequence[Point]) -> Point:
    x, y = zip(*corners, strict=True)
    return (min(x) + max(x)) / 2.0, (min(y) + max(y)) / 2.0


def _arc(center: Point, radius: float, begin: float, turn: float) -> Array:
    count = math.ceil(turn / _TURN) if radius > 0.0 else 0
    angles = begin + turn * np.linspace(0.0, 1.0, count + 1)
    return np.column_stack(
        [center[0] + radius * np.cos(angles), center[1] + radius * np.sin(angles)]
    )
