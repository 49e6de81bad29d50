"""The road between two circles, for compiled code; see `road_functions`.

A shape is a record of `road_space.SHAPE`.
"""

from __future__ import annotations

import math
from typing import Any

from cmpsp_ros.mpsp.jit import allocation_free
from cmpsp_ros.robots import Arc, reach_of

# The centre line's distance has no second derivative at the road's centre; nearer than this [m]
# its curvature is held.
_LEAST_RADIUS = 1e-3


@allocation_free
def lateral_error(shape: Any, outer: float, inner: float, x: float, y: float) -> Any:
    """Distances from the centre; no progress is needed."""
    distance = _distance(shape, x, y)
    return 0.0, distance - shape.center_radius, distance - outer, inner - distance


@allocation_free
def gradients(shape: Any, x: float, y: float) -> Any:
    """The unit vector away from the centre.

    The second derivative of ``(r - r_p)^2 / 2`` is ``n n' + (1 - r_p / r) t t'`` with unit
    vectors ``n`` across and ``t`` along the road.
    """
    distance = _distance(shape, x, y)
    away_x, away_y = 1.0, 0.0
    if distance > 0.0:
        away_x, away_y = (x - shape.center_x) / distance, (y - shape.center_y) / distance
    along = (distance - shape.center_radius) / max(distance, _LEAST_RADIUS)
    return away_x, away_y, along, away_x, away_y, -away_x, -away_y


@allocation_free
def sweep(shape: Any, outer: float, inner: float, arc: Arc) -> Any:
    """Exact distances of the arc from the centre."""
    least, greatest = reach_of(arc, shape.center_x, shape.center_y)
    return 0.0, outer - greatest, least - inner


@allocation_free
def arc_length_to(shape: Any, x: float, y: float, goal_x: float, goal_y: float) -> float:
    """The shorter way round, positive anticlockwise."""
    bearing = math.atan2(y - shape.center_y, x - shape.center_x)
    turn = math.atan2(goal_y - shape.center_y, goal_x - shape.center_x) - bearing
    way: float = shape.center_radius * (turn - 2.0 * math.pi * round(turn / (2.0 * math.pi)))
    return way


@allocation_free
def point_ahead(shape: Any, x: float, y: float, way: float) -> Any:
    """The point so far round the centre."""
    radius = shape.center_radius
    turned = math.atan2(y - shape.center_y, x - shape.center_x)
    turned += math.copysign(abs(way) / radius, way)
    return shape.center_x + radius * math.cos(turned), shape.center_y + radius * math.sin(turned)


@allocation_free
def _distance(shape: Any, x: float, y: float) -> float:
    dx, dy = x - shape.center_x, y - shape.center_y
    return math.sqrt(dx * dx + dy * dy)
