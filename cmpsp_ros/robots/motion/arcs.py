"""Exact distances between points and the arcs that the robot drives under constant speeds."""

import math
from typing import Any, NamedTuple

import numpy as np

from cmpsp_ros.arrays import Array
from cmpsp_ros.mpsp.jit import allocation_free

REFERENCE_POINT = np.zeros((1, 2))  # a robot's reference point as the only one of some in its frame

# Below this turn [rad] an arc is taken for its chord, from which it is nowhere further than an
# eighth of that part of its length.
_STRAIGHT = 1e-10


def arc_ends(poses: Array, twists: Array, durations: Array) -> Array:
    """Poses at the ends of arcs from poses ``(N, 3)`` under twists, of either form; not wrapped."""
    x, y, heading = poses.T
    turn = twists[:, -1] * durations
    middle = heading + turn / 2.0
    chord = twists[:, 0] * durations * np.sinc(turn / (2.0 * np.pi))
    x, y = x + chord * np.cos(middle), y + chord * np.sin(middle)
    if twists.shape[1] == 3:
        aside = twists[:, 1] * durations * np.sinc(turn / (2.0 * np.pi))
        x, y = x - aside * np.sin(middle), y + aside * np.cos(middle)
    return np.column_stack([x, y, heading + turn])


def with_side(twists: Array) -> Array:
    """Twists ``(..., 3)`` of twists of either form, with a speed to the left."""
    if twists.shape[-1] == 3:
        return twists
    return np.stack([twists[..., 0], np.zeros(twists.shape[:-1]), twists[..., 1]], axis=-1)


def plain(twists: Array) -> Array:
    """Twists ``(N, 3)`` without their speeds to the left where all of these are 0."""
    return twists if np.any(twists[:, 1]) else twists[:, ::2]


def speeds_and_turns(twists: Array) -> Array:
    """Speed along the path and turn rate of twists of either form, ``(..., 2)``."""
    if twists.shape[-1] == 2:
        return twists
    return np.stack([np.hypot(twists[..., 0], twists[..., 1]), twists[..., 2]], axis=-1)


class Arc(NamedTuple):
    """One arc: its ends [m] with the course there; backward its length is negative [m, rad]."""

    x: float
    y: float
    cosine: float
    sine: float
    length: float
    turn: float
    end_x: float
    end_y: float
    end_cosine: float
    end_sine: float


@allocation_free
def arc_from(x: float, y: float, heading: float, length: float, turn: float) -> Arc:
    """The arc that starts at a pose."""
    half, middle, end = turn / 2.0, heading + turn / 2.0, heading + turn
    # The series is exact in double precision where the quotient begins to lose digits.
    chord = length * (math.sin(half) / half if abs(half) > 1e-4 else 1.0 - half * half / 6.0)
    end_x, end_y = x + chord * math.cos(middle), y + chord * math.sin(middle)
    start = math.cos(heading), math.sin(heading)
    return Arc(x, y, start[0], start[1], length, turn, end_x, end_y, math.cos(end), math.sin(end))


@allocation_free
def arc_under(poses: Array, twists: Array, k: int, duration: float) -> Arc:
    """The arc from pose ``k`` under twist ``k``, of either form."""
    x, y, heading = poses[k, 0], poses[k, 1], poses[k, 2]
    if twists.shape[1] == 2:
        return arc_from(x, y, heading, twists[k, 0] * duration, twists[k, 1] * duration)
    forward, left = twists[k, 0], twists[k, 1]
    course = heading + math.atan2(left, forward)
    return arc_from(x, y, course, math.hypot(forward, left) * duration, twists[k, 2] * duration)


@allocation_free
def point_of(x: float, y: float, heading: float, points: Array, i: int) -> Any:
    """Position of one of some points of the robot, ``(D, 2)`` in the robot's frame [m]."""
    ahead, left = points[i, 0], points[i, 1]
    if ahead == 0.0 and left == 0.0:
        return x, y
    cosine, sine = math.cos(heading), math.sin(heading)
    return x + cosine * ahead - sine * left, y + sine * ahead + cosine * left


@allocation_free
def arc_of_point(arc: Arc, heading: float, points: Array, i: int) -> Arc:
    """The arc of point ``i`` of the robot from that of its reference point and heading [rad]."""
    if points[i, 0] == 0.0 and points[i, 1] == 0.0:
        return arc
    x, y = point_of(arc.x, arc.y, heading, points, i)
    along_x = arc.length * arc.cosine - arc.turn * (y - arc.y)
    along_y = arc.length * arc.sine + arc.turn * (x - arc.x)
    course = math.atan2(along_y, along_x)
    return arc_from(x, y, course, math.hypot(along_x, along_y), arc.turn)


@allocation_free
def arc_part(arc: Arc, part: float) -> Any:
    """Position x, y [m] after a part of an arc, cosine and sine of the course there."""
    half = arc.turn * part / 2.0
    chord = arc.length * part
    chord *= math.sin(half) / half if abs(half) > 1e-4 else 1.0 - half * half / 6.0
    cosine, sine = math.cos(half), math.sin(half)
    middle_x = arc.cosine * cosine - arc.sine * sine
    middle_y = arc.sine * cosine + arc.cosine * sine
    x, y = arc.x + chord * middle_x, arc.y + chord * middle_y
    return x, y, middle_x * cosine - middle_y * sine, middle_y * cosine + middle_x * sine


@allocation_free
def reach_of(arc: Arc, point_x: float, point_y: float) -> Any:
    """Least and greatest distance of one arc, from end to end, to one point [m]."""
    out_x, out_y = point_x - arc.x, point_y - arc.y
    left_x, left_y = point_x - arc.end_x, point_y - arc.end_y
    at_start = math.sqrt(out_x * out_x + out_y * out_y)
    at_end = math.sqrt(left_x * left_x + left_y * left_y)
    least, greatest = min(at_start, at_end), max(at_start, at_end)
    if abs(arc.turn) <= _STRAIGHT:
        return _to_chord(arc, out_x, out_y), greatest
    ahead = arc.cosine * out_x + arc.sine * out_y
    near = far = False
    if abs(arc.turn) < math.pi:
        # The nearest point of the circle is passed where the point comes abreast.
        after = arc.end_cosine * left_x + arc.end_sine * left_y
        direction = 1.0 if arc.length >= 0.0 else -1.0
        near = direction * ahead > 0.0 > direction * after
        far = direction * ahead < 0.0 < direction * after
        if not (near or far):
            return least, greatest
    across = arc.cosine * out_y - arc.sine * out_x
    radius = arc.length / arc.turn
    if abs(arc.turn) >= math.pi:
        # Angle, about the centre, from the start on to where the arc passes the point.
        bearing = math.atan2(radius * ahead, radius * radius - radius * across)
        if arc.turn < 0.0:
            bearing = -bearing
        near = bearing % (2.0 * math.pi) <= abs(arc.turn)
        far = (bearing + math.pi) % (2.0 * math.pi) <= abs(arc.turn)
    excess = out_x * out_x + out_y * out_y - 2.0 * radius * across
    furthest = math.sqrt(max(radius * radius + excess, 0.0)) + abs(radius)
    if near:
        # Distance from the circle, without the difference of two numbers as large as its radius.
        least = min(least, abs(excess) / furthest if furthest > 0.0 else 0.0)
    if far:
        greatest = max(greatest, furthest)
    return least, greatest


@allocation_free
def _to_chord(arc: Arc, out_x: float, out_y: float) -> float:
    chord_x, chord_y = arc.end_x - arc.x, arc.end_y - arc.y
    squared = chord_x * chord_x + chord_y * chord_y
    along = (out_x * chord_x + out_y * chord_y) / squared if squared > 0.0 else 0.0
    along = min(max(along, 0.0), 1.0)
    return math.hypot(out_x - along * chord_x, out_y - along * chord_y)
