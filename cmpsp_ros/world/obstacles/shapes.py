"""Obstacles that stand still: discs (93), and beside the paper other shapes and grids."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar, Final, Self

import numpy as np

from cmpsp_ros.arrays import Array
from cmpsp_ros.setting import POSITIVE, setting

Point = tuple[float, float]

_TURN = math.tau / 72.0  # between two points of a rounded outline [rad]


class Shape(ABC):
    """An obstacle that stands still: all that is nearer than a radius to its corners' hull.

    Fields of a type in `SHAPES` are settings, and so parameters; a default of 0 or () that is
    outside their range makes them required.
    """

    kind: ClassVar[str]  # name of the type in parameters

    if TYPE_CHECKING:  # else a field of a dataclass would take the property for its default

        def __init__(self, name: str, **settings: Any) -> None:
            """Make one of its fields."""

        @property
        def name(self) -> str:
            """The user's name for it."""

        @property
        def radius(self) -> float:
            """Distance from the hull up to which it reaches [m]."""

    @classmethod
    def of(cls, name: str, **values: Any) -> Self:
        """Make one of its settings; raises a `ShapeError` where they make none."""
        return cls(name, **values)

    @property
    @abstractmethod
    def corners(self) -> tuple[Point, ...]:
        """Corners of the hull, anticlockwise: one, two, or a convex polygon; none for cells [m]."""

    @property
    def center(self) -> Point:
        """The middle between its sides (x, y) [m]."""
        x, y = zip(*self.corners, strict=True)
        return (min(x) + max(x)) / 2.0, (min(y) + max(y)) / 2.0

    @property
    def is_disc(self) -> bool:
        """True for a shape with one corner."""
        return len(self.corners) == 1

    def outlines(self, distance: float) -> list[Array]:
        """Closed lines ``(K, 2)`` at a distance from its corners' hull [m], clockwise at holes."""
        return [outline_of(self.corners, distance)]


@dataclass(frozen=True)
class Obstacle(Shape):
    """A disc (93)."""

    kind: ClassVar[str] = 'circle'
    name: str
    center: Point = setting((), 'm', 'Centre (x, y).')
    radius: float = setting(0.0, 'm', 'Radius, more than 0.', POSITIVE)

    @property
    def corners(self) -> tuple[Point, ...]:
        """The centre."""
        return (self.center,)


@dataclass(frozen=True)
class Capsule(Shape):
    """All that is near a line between two points: a wall, a table on its legs, a parked car."""

    kind: ClassVar[str] = 'capsule'
    name: str
    start: Point = setting((), 'm', 'One end of its middle line (x, y).')
    end: Point = setting((), 'm', 'Other end of its middle line (x, y).')
    radius: float = setting(0.0, 'm', 'Radius, more than 0.', POSITIVE)

    @property
    def corners(self) -> tuple[Point, ...]:
        """Both ends."""
        return (self.start, self.end)


@dataclass(frozen=True)
class Polygon(Shape):
    """A convex polygon with at least three vertices, anticlockwise [m]."""

    kind: ClassVar[str] = 'polygon'
    name: str
    vertices: tuple[Point, ...] = setting(
        (), 'm', 'Corners in order, in either direction, all convex: x and y of each.'
    )
    radius: ClassVar[float] = 0.0

    @classmethod
    def of(cls, name: str, **values: Any) -> Polygon:
        """Make one of vertices in either direction."""
        return convex(name, values['vertices'])

    @property
    def corners(self) -> tuple[Point, ...]:
        """The vertices."""
        return self.vertices


SHAPES: Final[tuple[type[Shape], ...]] = (Obstacle, Capsule, Polygon)  # the default first


class ShapeError(ValueError):
    """Vertices that make no convex polygon: number of that at fault, from 0, found and wanted."""

    def __init__(self, vertex: int, found: str, wanted: str) -> None:
        super().__init__(f'vertex {vertex}: found {found}, wanted {wanted}')
        self.vertex, self.found, self.wanted = vertex, found, wanted


def convex(name: str, vertices: Sequence[Point]) -> Polygon:
    """A polygon from vertices in either direction; ShapeError if they make none, or wind twice."""
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


def _arc(center: Point, radius: float, begin: float, turn: float) -> Array:
    count = math.ceil(turn / _TURN) if radius > 0.0 else 0
    angles = begin + turn * np.linspace(0.0, 1.0, count + 1)
    return np.column_stack(
        [center[0] + radius * np.cos(angles), center[1] + radius * np.sin(angles)]
    )
