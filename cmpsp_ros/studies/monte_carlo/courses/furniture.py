"""What stands in a random course: posts, walls, crates and pockets."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from cmpsp_ros.studies.monte_carlo.courses.scenario import Point
from cmpsp_ros.world.obstacles import Capsule, Obstacle, Shape, convex

THIN: Final = 0.05
"""Half the thickness of a wall [m]."""


def shapes(random: np.random.Generator, center: Point, course: float, name: str) -> list[Shape]:
    """A post, a wall, a crate, or three walls around a pocket that opens towards the start."""
    kind, heading = int(random.integers(4)), random.uniform(-math.pi, math.pi)
    if kind == 0:
        return [Obstacle(name, center, float(random.uniform(0.1, 0.8)))]
    if kind == 1:
        return [box(center, heading, THIN, random.uniform(0.5, 3.0), name)]
    if kind == 2:
        deep, wide = random.uniform(0.3, 1.2, 2).tolist()
        return [box(center, heading, deep, wide, name)]
    wide, deep = random.uniform(0.6, 2.0), random.uniform(0.3, 1.0)
    return pocket(center, course + random.uniform(-0.5, 0.5), wide, deep, name)


def pocket(center: Point, heading: float, wide: float, deep: float, name: str) -> list[Shape]:
    """Three walls, by the middle of the back wall and the direction to what is behind it."""
    sides = [moved(center, heading, -deep / 2.0, side * wide / 2.0) for side in (-1.0, 1.0)]
    return [
        box(center, heading, THIN, wide, f'{name}_back'),
        box(sides[0], heading + math.pi / 2.0, THIN, deep, f'{name}_right'),
        box(sides[1], heading + math.pi / 2.0, THIN, deep, f'{name}_left'),
    ]


def box(center: Point, heading: float, deep: float, wide: float, name: str) -> Shape:
    """A wall if it is thin, or else a crate."""
    if deep <= THIN:
        half = max(wide / 2.0 - deep, 0.01)
        ends = (moved(center, heading, 0.0, half), moved(center, heading, 0.0, -half))
        return Capsule(name, *ends, deep)
    corners = ((-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0))
    return convex(
        name, [moved(center, heading, a * deep / 2.0, b * wide / 2.0) for a, b in corners]
    )


def moved(point: Point, heading: float, along: float, left: float) -> Point:
    """A point, so far ahead of another and to its left [m]."""
    cosine, sine = math.cos(heading), math.sin(heading)
    return point[0] + along * cosine - left * sine, point[1] + along * sine + left * cosine
