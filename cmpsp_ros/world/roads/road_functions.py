"""Functions of a road for compiled code, the same for every kind of road.

A place on a road is given by its progress [m], the length along the centre line from where it
begins: that is unique where a road comes by one point twice. Each road has two edges, and its
clearance from an edge is never more than the distance to it.
"""

from __future__ import annotations

import math
from typing import Any

from cmpsp_ros.mpsp.jit import allocation_free
from cmpsp_ros.robots import Arc
from cmpsp_ros.world.roads import annulus_functions, corridor_functions, open_floor_functions
from cmpsp_ros.world.roads.road_space import ANNULUS, CORRIDOR, RoadSpace

FAR = 1e6
"""Clearance from an edge that is not there [m]: a number that can be added, written and read."""


@allocation_free
def project(road: RoadSpace, x: float, y: float, heading: float, near: float) -> float:
    """Progress of a pose.

    Args:
        road: The road.
        x: Position [m].
        y: See `x`.
        heading: Of the pose: where the road crosses itself it says which way is meant. Not a
            number for a point without a heading [rad].
        near: Progress of a place from which the pose has not come far; not a number where none is
            known. It counts more than the heading [m].

    Returns:
        Progress [m].
    """
    shape = road.shape[0]
    if shape.kind == CORRIDOR:
        progress: float = corridor_functions.project(
            shape, road.pieces, road.stations, x, y, heading, near
        )
        return progress
    return 0.0


@allocation_free
def lateral_error(road: RoadSpace, k: int, x: float, y: float, progress: float) -> Any:
    """Where a point is across the road.

    Args:
        road: The road.
        k: Stage, for roads whose edges change along a horizon.
        x: Position [m].
        y: See `x`.
        progress: Of a point nearby [m].

    Returns:
        Progress, distance from the centre line with a sign, and one path constraint an edge, not
        positive where met and ``-inf`` where there is no edge; all [m].
    """
    shape, at = road.shape[0], min(k, road.kept.shape[0] - 1)
    kept, other = road.kept[at, 0], road.kept[at, 1]
    if shape.kind == ANNULUS:
        return annulus_functions.lateral_error(shape, kept, other, x, y)
    if shape.kind == CORRIDOR:
        return corridor_functions.lateral_error(shape, road.pieces, kept, other, x, y, progress)
    return 0.0, 0.0, -math.inf, -math.inf


@allocation_free
def gradients(road: RoadSpace, x: float, y: float, progress: float) -> Any:
    """Derivatives of what `lateral_error` returns, at the progress that it returned.

    Args:
        road: The road.
        x: Position [m].
        y: See `x`.
        progress: Of this point [m].

    Returns:
        The gradient of the distance from the centre line (x, y), a unit vector or zero; what the
        second derivative of half its square is along the road; the gradients (x, y) of the first
        and of the second constraint.
    """
    shape = road.shape[0]
    if shape.kind == ANNULUS:
        return annulus_functions.gradients(shape, x, y)
    if shape.kind == CORRIDOR:
        return corridor_functions.gradients(shape, road.pieces, x, y, progress)
    return 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0


@allocation_free
def sweep(road: RoadSpace, arc: Arc, progress: float, enough: float, enough_other: float) -> Any:
    """Least clearance of an arc, from end to end.

    Args:
        road: The road; edges are those of the first stage.
        arc: The arc.
        progress: Of its beginning [m].
        enough: Clearance from the first edge that need not be known more exactly [m].
        enough_other: The same for the second edge.

    Returns:
        Progress at its end, and clearance from both edges; all [m].
    """
    shape, kept, other = road.shape[0], road.kept[0, 0], road.kept[0, 1]
    if shape.kind == ANNULUS:
        return annulus_functions.sweep(shape, kept, other, arc)
    if shape.kind == CORRIDOR:
        return corridor_functions.sweep(
            shape, road.pieces, kept, other, arc, progress, enough, enough_other
        )
    return open_floor_functions.sweep(arc, FAR)


@allocation_free
def arc_length_to(
    road: RoadSpace, x: float, y: float, progress: float, goal_x: float, goal_y: float, goal: float
) -> float:
    """Length along the centre line from one place to another, negative against its direction.

    Args:
        road: The road.
        x: Position [m].
        y: See `x`.
        progress: Of this point [m].
        goal_x: The other place [m].
        goal_y: See `goal_x`.
        goal: Its progress [m].

    Returns:
        The way [m]; the shorter one where the road closes upon itself.
    """
    shape = road.shape[0]
    if shape.kind == ANNULUS:
        return annulus_functions.arc_length_to(shape, x, y, goal_x, goal_y)
    if shape.kind == CORRIDOR:
        return corridor_functions.arc_length_to(shape, progress, goal)
    return math.hypot(goal_x - x, goal_y - y)


@allocation_free
def point_ahead(road: RoadSpace, x: float, y: float, progress: float, way: float, to: Any) -> Any:
    """Point of the centre line (x, y) [m] that is some way ahead.

    Args:
        road: The road.
        x: Position [m].
        y: See `x`.
        progress: Of this point [m].
        way: Length along the centre line, negative against its direction [m].
        to: Where that way leads in the end (x, y) [m], for open floor.
    """
    shape = road.shape[0]
    if shape.kind == ANNULUS:
        return annulus_functions.point_ahead(shape, x, y, way)
    if shape.kind == CORRIDOR:
        return corridor_functions.point_ahead(shape, road.pieces, progress, way)
    return open_floor_functions.point_ahead(x, y, way, to)
