"""The road between two circles, for compiled code; see `road_functions`."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cmpsp_ros.mpsp.jit.compiled import allocation_free
from cmpsp_ros.robot.arcs import Arc, reach_of
from cmpsp_ros.robot.road_space import RoadSpace

Array = NDArray[np.float64]

# The centre line's distance has no second derivative at the road's centre; nearer than this [m]
# its curvature is held.
_LEAST_RADIUS = 1e-3


@allocation_free
def measure(road: RoadSpace, k: int, x: float, y: float) -> Any:
    """Distances from the centre; no progress is needed."""
    distance = _distance(road, x, y)
    at = min(k, road.kept.shape[0] - 1)
    off_center = distance - road.shape[0].center_radius
    return 0.0, off_center, distance - road.kept[at, 0], road.kept[at, 1] - distance


@allocation_free
def slopes(road: RoadSpace, x: float, y: float) -> Any:
    """The unit vector away from the centre.

    The second derivative of ``(r - r_p)^2 / 2`` is ``n n' + (1 - r_p / r) t t'`` with unit
    vectors ``n`` across and ``t`` along the road.
    """
    shape, distance = road.shape[0], _distance(road, x, y)
    away_x, away_y = 1.0, 0.0
    if distance > 0.0:
        away_x, away_y = (x - shape.center_x) / distance, (y - shape.center_y) / distance
    along = (distance - shape.center_radius) / max(distance, _LEAST_RADIUS)
    return away_x, away_y, along, away_x, away_y, -away_x, -away_y


@allocation_free
def sweep(road: RoadSpace, arc: Arc) -> Any:
    """Exact distances of the arc from the centre."""
    least, greatest = reach_of(arc, road.shape[0].center_x, road.shape[0].center_y)
    return 0.0, road.kept[0, 0] - greatest, least - road.kept[0, 1]


@allocation_free
def way_to(road: RoadSpace, x: float, y: float, goal_x: float, goal_y: float) -> float:
    """The shorter way round, positive anticlockwise."""
    shape = road.shape[0]
    bearing = math.atan2(y - shape.center_y, x - shape.center_x)
    turn = math.atan2(goal_y - shape.center_y, goal_x - shape.center_x) - bearing
    way: float = shape.center_radius * (turn - 2.0 * math.pi * round(turn / (2.0 * math.pi)))
    return way


@allocation_free
def ahead(road: RoadSpace, x: float, y: float, way: float) -> Any:
    """The point so far round the centre."""
    shape = road.shape[0]
    radius = shape.center_radius
    turned = math.atan2(y - shape.center_y, x - shape.center_x)
    turned += math.copysign(abs(way) / radius, way)
    return shape.center_x + radius * math.cos(turned), shape.center_y + radius * math.sin(turned)


@allocation_free
def _distance(road: RoadSpace, x: float, y: float) -> float:
    dx, dy = x - road.shape[0].center_x, y - road.shape[0].center_y
    return math.sqrt(dx * dx + dy * dy)
