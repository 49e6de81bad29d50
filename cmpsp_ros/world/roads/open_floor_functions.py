"""Open floor, for compiled code: no edges, no centre line; see `road_functions`."""

from __future__ import annotations

import math
from typing import Any

from cmpsp_ros.mpsp.jit import allocation_free
from cmpsp_ros.robots import Arc


@allocation_free
def sweep(arc: Arc, far: float) -> Any:
    """Far from all edges, if the arc is finite."""
    clearance = far + 0.0 * (arc.end_x + arc.end_y)
    return 0.0, clearance, clearance


@allocation_free
def point_ahead(x: float, y: float, way: float, to: Any) -> Any:
    """A point of the straight line."""
    left = max(math.hypot(to[0] - x, to[1] - y), 1e-9)
    return x + (to[0] - x) * (way / left), y + (to[1] - y) * (way / left)
