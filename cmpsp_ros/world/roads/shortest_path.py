"""The shortest way along a road, to tell what no robot could do in time."""

from __future__ import annotations

import math

from cmpsp_ros.world.roads.road import Annulus

Point = tuple[float, float]


def shortest_way(road: Annulus, start: Point, goal: Point) -> float:
    """Length of the shortest path inside the road, obstacles left aside [m].

    It is a string pulled taut around the inner edge: straight where it can be, otherwise two
    tangents and the arc between them.

    Args:
        road: The road.
        start: A point on it (x, y) [m].
        goal: Another.
    """
    radius = road.inner_radius
    near, far = (max(math.dist(each, road.center), radius) for each in (start, goal))
    turned = abs(angle_between(road, start, goal))
    if radius <= 0.0:
        return math.dist(start, goal)
    free = math.acos(radius / near) + math.acos(radius / far)
    if turned <= free:
        return math.dist(start, goal)
    tangents = math.sqrt(near**2 - radius**2) + math.sqrt(far**2 - radius**2)
    return tangents + radius * (turned - free)


def angle_between(road: Annulus, start: Point, goal: Point) -> float:
    """Angle about the road's centre from start to goal the shorter way round, to the left [rad]."""
    bearings = (math.atan2(y - road.center[1], x - road.center[0]) for x, y in (start, goal))
    first, last = bearings
    return math.remainder(last - first, math.tau)
