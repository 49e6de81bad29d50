"""Exact signed distances from convex shapes, for compiled code.

A shape is a point, a line between two points or a convex polygon, given by its corners,
anticlockwise. Several of them lie one after the other in one array: those of shape ``j`` are
``corners[k, first[j]:first[j + 1]]``, where ``k`` counts samples if they move. The distance is
that from the shape without its radius; inside a polygon it is negative. The first shape without
corners is that of the first distance field, another one that of the second.
"""

import math
from typing import Any, NamedTuple

from cmpsp_ros.arrays import Array, IntArray
from cmpsp_ros.mpsp.jit import allocation_free, inlined
from cmpsp_ros.robots.motion import Arc, arc_part, reach_of
from cmpsp_ros.world.grids import field_functions
from cmpsp_ros.world.grids.field_functions import DistanceField, Fields

ROUGHNESS = 1e-5  # safe error of the distance of a path from a shape that is no point [m]

_MOST_PIECES = 256


class ShapeData(NamedTuple):
    """Several shapes for compiled code, as above."""

    fields: Fields
    corners: Array  # shape ``(K, C, 2)`` [m]
    first: IntArray  # first corner of each shape, and the end of the last, shape ``(M + 1,)``


# At a point itself: no distance, and a way out.
_SOME = (0.0, 1.0, 0.0)


@allocation_free
def distance_from(shapes: ShapeData, k: int, j: int, x: float, y: float) -> float:
    """Distance of a point from a shape."""
    distance: float
    if shapes.first[j] == shapes.first[j + 1]:
        return field_functions.distance_from(_field_of(shapes, j), x, y)
    distance, _, _ = away_from(shapes, k, j, x, y)
    return distance


@inlined
def away_from(shapes: ShapeData, k: int, j: int, x: float, y: float) -> Any:
    """Distance of a point from a shape and its gradient, a unit vector away from it.

    Where there is no gradient it is some unit vector that leads out, so that a solver can leave.
    """
    corners, begin, end = shapes.corners, shapes.first[j], shapes.first[j + 1]
    if end == begin:
        return field_functions.away_from(_field_of(shapes, j), x, y)
    if end - begin == 1:
        dx, dy = x - corners[k, begin, 0], y - corners[k, begin, 1]
        from_point = math.sqrt(dx * dx + dy * dy)
        return _SOME if from_point == 0.0 else (from_point, dx / from_point, dy / from_point)
    if end - begin > 2:
        deepest, x_out, y_out = _deepest(corners, k, begin, end, x, y)
        if deepest <= 0.0:
            return deepest, x_out, y_out
    # Of a line the one edge there is.
    least, near_x, near_y = math.inf, 0.0, 0.0
    for i in range(begin, end if end - begin > 2 else begin + 1):
        after = i + 1 if i + 1 < end else begin
        to_x, to_y, squared = _to_edge(
            x, y, corners[k, i, 0], corners[k, i, 1], corners[k, after, 0], corners[k, after, 1]
        )
        if squared < least:
            least, near_x, near_y = squared, to_x, to_y
    distance = math.sqrt(least)
    if distance > 0.0:
        return distance, near_x / distance, near_y / distance
    last = end - 1
    along_x = corners[k, last, 0] - corners[k, begin, 0]
    along_y = corners[k, last, 1] - corners[k, begin, 1]
    length = math.sqrt(along_x * along_x + along_y * along_y)
    if length > 0.0:
        return 0.0, along_y / length, -along_x / length
    return _SOME


@inlined
def sweep(arc: Arc, shapes: ShapeData, j: int, enough: float) -> float:
    """Least distance of an arc, from end to end, from a shape that stands still.

    Exact for a point; else low by `ROUGHNESS` at most, unless it is more than ``enough``.
    """
    least: float
    corners, begin, end = shapes.corners, shapes.first[j], shapes.first[j + 1]
    if end == begin:
        return field_functions.sweep(_field_of(shapes, j), arc, enough)
    if end - begin == 1:
        least, _ = reach_of(arc, corners[0, begin, 0], corners[0, begin, 1])
        return least
    astray = abs(arc.length * arc.turn) / 8.0
    whole = _least_on_chord(corners, begin, end, arc.x, arc.y, arc.end_x, arc.end_y) - astray
    if whole > enough or math.isnan(whole):
        return whole
    pieces = pieces_for(astray)
    least, x, y = math.inf, arc.x, arc.y
    for i in range(1, pieces + 1):
        x_after, y_after, _, _ = arc_part(arc, i / pieces)
        least = min(least, _least_on_chord(corners, begin, end, x, y, x_after, y_after))
        x, y = x_after, y_after
    return least - astray / (pieces * pieces)


@allocation_free
def _field_of(shapes: ShapeData, j: int) -> DistanceField:
    """The field of a shape without corners."""
    for i in range(j):
        if shapes.first[i] == shapes.first[i + 1]:
            return shapes.fields[1]
    return shapes.fields[0]


@allocation_free
def pieces_for(astray: float) -> int:
    """Into how many pieces to cut a path that strays so far from its chord [m]."""
    return int(min(max(math.ceil(math.sqrt(astray / ROUGHNESS)), 1.0), _MOST_PIECES))


@allocation_free
def _deepest(corners: Array, k: int, begin: int, end: int, x: float, y: float) -> Any:
    """Greatest of the distances from a polygon's edges, outward, and the normal of that edge."""
    deepest, x_out, y_out = -math.inf, 1.0, 0.0
    for i in range(begin, end):
        after = i + 1 if i + 1 < end else begin
        along_x = corners[k, after, 0] - corners[k, i, 0]
        along_y = corners[k, after, 1] - corners[k, i, 1]
        length = math.sqrt(along_x * along_x + along_y * along_y)
        normal_x, normal_y = along_y / length, -along_x / length
        outward = normal_x * (x - corners[k, i, 0]) + normal_y * (y - corners[k, i, 1])
        # NaN is carried on.
        if not outward <= deepest:
            deepest, x_out, y_out = outward, normal_x, normal_y
    return deepest, x_out, y_out


@allocation_free
def _to_edge(x: float, y: float, a_x: float, a_y: float, b_x: float, b_y: float) -> Any:
    """From the nearest point of an edge to a point, and the square of that distance."""
    along_x, along_y, to_x, to_y = b_x - a_x, b_y - a_y, x - a_x, y - a_y
    squared = along_x * along_x + along_y * along_y
    part = (to_x * along_x + to_y * along_y) / squared if squared > 0.0 else 0.0
    part = min(max(part, 0.0), 1.0)
    to_x, to_y = to_x - part * along_x, to_y - part * along_y
    return to_x, to_y, to_x * to_x + to_y * to_y


@allocation_free
def _least_on_chord(
    corners: Array, begin: int, end: int, x: float, y: float, to_x: float, to_y: float
) -> float:
    """Least signed distance, from a line or a polygon that stands still, on a straight way."""
    if end - begin > 2:
        depth = _depth_on_chord(corners, begin, end, x, y, to_x, to_y)
        if depth <= 0.0:
            return depth
    least = math.inf
    for i in range(begin, end if end - begin > 2 else begin + 1):
        after = i + 1 if i + 1 < end else begin
        a_x, a_y = corners[0, i, 0], corners[0, i, 1]
        b_x, b_y = corners[0, after, 0], corners[0, after, 1]
        if _cross(x, y, to_x, to_y, a_x, a_y, b_x, b_y):
            return 0.0
        _, _, one = _to_edge(x, y, a_x, a_y, b_x, b_y)
        _, _, two = _to_edge(to_x, to_y, a_x, a_y, b_x, b_y)
        _, _, three = _to_edge(a_x, a_y, x, y, to_x, to_y)
        _, _, four = _to_edge(b_x, b_y, x, y, to_x, to_y)
        least = min(least, one, two, three, four)
        if math.isnan(one + two):
            return math.nan
    return math.sqrt(least)


@allocation_free
def _cross(
    x: float, y: float, to_x: float, to_y: float, a_x: float, a_y: float, b_x: float, b_y: float
) -> bool:
    """Proper crossing of two lines; where they only touch, an end is at distance 0."""
    way_x, way_y, along_x, along_y = to_x - x, to_y - y, b_x - a_x, b_y - a_y
    one = way_x * (a_y - y) - way_y * (a_x - x)
    two = way_x * (b_y - y) - way_y * (b_x - x)
    three = along_x * (y - a_y) - along_y * (x - a_x)
    four = along_x * (to_y - a_y) - along_y * (to_x - a_x)
    return one * two < 0.0 and three * four < 0.0


@allocation_free
def _depth_on_chord(
    corners: Array, begin: int, end: int, x: float, y: float, to_x: float, to_y: float
) -> float:
    """Least value on a straight way of the greatest distance from a polygon's edges, outward.

    Not positive exactly where the way touches the polygon. The greatest of lines over the part of
    the way is convex: two lines that bracket its minimum are replaced by one that exceeds them
    where they meet, until none does.
    """
    at: float
    last: float
    value: float
    at, slope = _steepest(corners, begin, end, x, y, to_x, to_y, 0.0)
    if not slope < 0.0:
        return at
    last, rise = _steepest(corners, begin, end, x, y, to_x, to_y, 1.0)
    if not rise > 0.0:
        return last
    left, right, value = 0.0, 1.0, min(at, last)
    for _ in range(2 * (end - begin)):
        # Lines through (left, at) and (right, last).
        part = (last - at + slope * left - rise * right) / (slope - rise)
        part = min(max(part, 0.0), 1.0)
        meet = at + slope * (part - left)
        value, steep = _steepest(corners, begin, end, x, y, to_x, to_y, part)
        if not value > meet + 1e-12:
            return value
        if steep < 0.0:
            left, at, slope = part, value, steep
        else:
            right, last, rise = part, value, steep
            if steep == 0.0:
                return value
    return value


@allocation_free
def _steepest(
    corners: Array, begin: int, end: int, x: float, y: float, to_x: float, to_y: float, part: float
) -> Any:
    """Greatest of the distances from a polygon's edges after a part of a way, and its slope."""
    here_x, here_y = x + part * (to_x - x), y + part * (to_y - y)
    deepest, normal_x, normal_y = _deepest(corners, 0, begin, end, here_x, here_y)
    return deepest, normal_x * (to_x - x) + normal_y * (to_y - y)
