"""Whether a road past obstacles is still open."""

from __future__ import annotations

import math
from collections.abc import Sequence

from cmpsp_ros.world.obstacles.shapes import Obstacle
from cmpsp_ros.world.roads.annulus import Annulus


def is_open(road: Annulus, obstacles: Sequence[Obstacle], width: float) -> bool:
    """Whether a disc as wide as that can go all the way along the road.

    It cannot where a chain of obstacles leads from one edge to the other with every gap of it too
    narrow, and only there: what separates the two sides of a plane strip is connected.

    Args:
        road: The road.
        obstacles: What lies on it; they may overlap.
        width: What has to be left free [m].
    """
    if road.outer_radius - road.inner_radius < width:
        return False
    waiting = [each for each in obstacles if _from_inner(road, each) < width]
    others = [each for each in obstacles if _from_inner(road, each) >= width]
    while waiting:
        link = waiting.pop()
        if _from_outer(road, link) < width:
            return False
        waiting += [each for each in others if _between(link, each) < width]
        others = [each for each in others if _between(link, each) >= width]
    return True


def _from_inner(road: Annulus, obstacle: Obstacle) -> float:
    return math.dist(obstacle.center, road.center) - obstacle.radius - road.inner_radius


def _from_outer(road: Annulus, obstacle: Obstacle) -> float:
    return road.outer_radius - math.dist(obstacle.center, road.center) - obstacle.radius


def _between(one: Obstacle, other: Obstacle) -> float:
    return math.dist(one.center, other.center) - one.radius - other.radius
