"""Least distances of an arc from a point that moves, for compiled code."""

from __future__ import annotations

import math

from cmpsp_ros.mpsp.jit import allocation_free
from cmpsp_ros.robots import Arc, arc_part
from cmpsp_ros.world.obstacles.shape_functions import pieces_for


@allocation_free
def sweep_moving(
    arc: Arc,
    duration: float,
    x: float,
    y: float,
    velocity_x: float,
    velocity_y: float,
    growth: float,
    enough: float,
) -> float:
    """Least distance, in time, of an arc from a point that moves, less a radius that grows from 0.

    Seen from the point the robot does not drive an arc. It strays from a chord of that path as far
    as the arc does from its own, timed alike, since the point's speed is constant.

    Args:
        arc: What the robot drives, at constant speed.
        duration: Time that it takes [s].
        x: Where the point is at its beginning [m].
        y: See `x`.
        velocity_x: Of the point [m/s].
        velocity_y: See `velocity_x`.
        growth: Of the radius [m/s].
        enough: As of `sweep`.
    """
    astray = abs(arc.length * arc.turn) / 8.0
    away_x, away_y = arc.x - x, arc.y - y
    moved_x, moved_y, grown = velocity_x * duration, velocity_y * duration, growth * duration
    whole = (
        _least_on_approach(
            away_x, away_y, arc.end_x - x - moved_x, arc.end_y - y - moved_y, 0.0, grown
        )
        - astray
    )
    if whole > enough or math.isnan(whole):
        return whole
    pieces = pieces_for(astray)
    least, from_x, from_y = math.inf, away_x, away_y
    for i in range(1, pieces + 1):
        part = i / pieces
        to_x, to_y, _, _ = arc_part(arc, part)
        to_x, to_y = to_x - x - part * moved_x, to_y - y - part * moved_y
        before = (i - 1) / pieces * grown
        least = min(least, _least_on_approach(from_x, from_y, to_x, to_y, before, part * grown))
        from_x, from_y = to_x, to_y
    return least - astray / (pieces * pieces)


@allocation_free
def _least_on_approach(
    x: float, y: float, to_x: float, to_y: float, radius: float, to_radius: float
) -> float:
    """Least distance from the origin on a straight way, less a radius that changes evenly.

    It is a convex function of the part of the way, least where its slope vanishes.
    """
    way_x, way_y, grown = to_x - x, to_y - y, to_radius - radius
    squared = way_x * way_x + way_y * way_y
    at_end = math.sqrt(to_x * to_x + to_y * to_y) - to_radius
    least = min(math.sqrt(x * x + y * y) - radius, at_end)
    steeper = squared - grown * grown
    if steeper <= 0.0:
        return least
    across = abs(way_x * y - way_y * x) / math.sqrt(squared)
    part = (grown * across / math.sqrt(steeper) * math.sqrt(squared)) / squared
    part -= (x * way_x + y * way_y) / squared
    if not 0.0 < part < 1.0:
        return least
    there_x, there_y = x + part * way_x, y + part * way_y
    there = math.sqrt(there_x * there_x + there_y * there_y) - radius - part * grown
    return min(least, there)
