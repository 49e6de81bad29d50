"""The road along a centre line, for compiled code; see `road_functions`.

A shape is a record of `road_space.SHAPE`; the other arrays are those of `road_space.RoadSpace`.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cmpsp_ros.arrays import Array
from cmpsp_ros.mpsp.jit import allocation_free
from cmpsp_ros.robots import Arc, arc_part

Records = NDArray[np.void]

# What a projection leaves of its last step is of second order in it [m].
_MOST_STEPS = 30
_SETTLED = 1e-6

# Accuracy of a least clearance [m], and as a part of it; the finest division of an arc to find it:
# two to this.
_TOLERANCE = 1e-6
_PART = 0.01
_DEEPEST = 12

# Beyond the centre of curvature a projection has no meaning; before it, this part of the radius is
# left.
_LEAST_PART = 1e-2

X, Y, LEFT, RIGHT = 0, 1, 2, 3
"""Which of the curves of a piece; see `road_space.PIECE`."""


@allocation_free
def project(
    shape: Any, pieces: Records, stations: Array, x: float, y: float, heading: float, near: float
) -> float:
    """Progress of the nearest place that leads the same way.

    Nearness and direction are added up as squares; which way along the road does not matter.
    """
    progress: float
    if not math.isnan(near):
        progress = _across(shape, pieces, x, y, near)[0]
        return progress
    cosine, sine, weight = math.cos(heading), math.sin(heading), shape.decides * shape.decides
    if math.isnan(heading):
        cosine = sine = weight = 0.0
    best, nearest = math.inf, 0
    for i in range(stations.shape[0]):
        dx, dy = x - stations[i, 0], y - stations[i, 1]
        across = cosine * stations[i, 3] - sine * stations[i, 2]
        score = dx * dx + dy * dy + weight * across * across
        if score < best:
            best, nearest = score, i
    progress = _across(shape, pieces, x, y, nearest * shape.station_step)[0]
    return progress


@allocation_free
def lateral_error(
    shape: Any, pieces: Records, kept: float, other: float, x: float, y: float, progress: float
) -> Any:
    """Widths less the distance from the centre line."""
    progress, off, left, right = _across(shape, pieces, x, y, progress)
    part = shape.part
    return progress, off, (off - left) * part[0] + kept, (-off - right) * part[1] + other


@allocation_free
def gradients(shape: Any, pieces: Records, x: float, y: float, progress: float) -> Any:
    """Exact derivatives at a projection.

    With the curvature ``c`` of the centre line and the distance ``e`` to its left, that of ``e^2 /
    2`` is ``n n' - e c / (1 - c e) t t'``.
    """
    i, t = _piece(shape, pieces, progress)
    piece = pieces[i]
    here_x, here_y, dx, dy, ddx, ddy = _center_line(piece, t)
    rx, ry = x - here_x, y - here_y
    squared = dx * dx + dy * dy
    size = math.sqrt(squared)
    off_x, off_y = -dy / size, dx / size
    # 1 - c e, times the square of the parameter's speed.
    part = max(squared - ddx * rx - ddy * ry, _LEAST_PART * squared)
    along = -(off_x * rx + off_y * ry) * (dx * ddy - dy * ddx) / (size * part)
    left, right = _width_slopes(piece, t)
    left, right = left / part, right / part
    first, second = shape.part[0], shape.part[1]
    return (
        off_x,
        off_y,
        along,
        first * (off_x - left * dx),
        first * (off_y - left * dy),
        second * (-off_x - right * dx),
        second * (-off_y - right * dy),
    )


@allocation_free
def sweep(
    shape: Any,
    pieces: Records,
    kept: float,
    other_kept: float,
    arc: Arc,
    progress: float,
    enough: float,
    enough_other: float,
) -> Any:
    """Least clearance to a hundredth of it, or a micrometre.

    The arc is halved until no part can hide a smaller clearance than was found at the ends of all
    parts: along it the second derivative of a clearance is bounded, which bounds the clearance from
    below between two ends where value and slope are known. It is bounded near the road only, which
    a part does not leave if it is short, or if clearances at its ends are as long as it is.
    """
    length, turn = abs(arc.length), abs(arc.turn)
    bound = shape.bend[0] * length * length + turn * length
    bound_other = shape.bend[1] * length * length + turn * length
    depth, i, here = 0, 0, _on_arc(shape, pieces, kept, other_kept, arc, 0.0, progress)
    least, other = here[1], here[2]
    while i < 1 << depth:
        step = 1.0 / (1 << depth)
        there = _on_arc(shape, pieces, kept, other_kept, arc, (i + 1) * step, here[0])
        least, other = min(least, there[1]), min(other, there[2])
        lowest = _lowest(here[1], here[3] * step, there[1], there[3] * step, bound * step * step)
        lowest_other = _lowest(
            here[2], here[4] * step, there[2], there[4] * step, bound_other * step * step
        )
        nearest = min(here[1] + there[1], here[2] + there[2])
        known = length * step <= max(shape.room, nearest)
        known &= lowest >= _nearly(min(least, enough))
        known &= lowest_other >= _nearly(min(other, enough_other))
        if known or depth == _DEEPEST or math.isnan(lowest + lowest_other):
            i += 1
            here = there
            while i % 2 == 0 and depth > 0 and i < 1 << depth:
                i //= 2
                depth -= 1
        else:
            i *= 2
            depth += 1
    # Not a number if the arc's end is none.
    nothing = 0.0 * (arc.end_x + arc.end_y)
    return here[0], least + nothing, other + nothing


@allocation_free
def arc_length_to(shape: Any, progress: float, goal: float) -> float:
    """Difference of the two."""
    way = goal - progress
    if shape.closed:
        way -= shape.length * round(way / shape.length)
    return way


@allocation_free
def point_ahead(shape: Any, pieces: Records, progress: float, way: float) -> Any:
    """The point with so much more progress."""
    i, t = _piece(shape, pieces, _within(shape, pieces, progress + way))
    at_x, at_y, _, _, _, _ = _center_line(pieces[i], t)
    return at_x, at_y


@allocation_free
def _nearly(clearance: float) -> float:
    return clearance - _TOLERANCE - _PART * max(clearance, 0.0)


@allocation_free
def _lowest(here: float, slope: float, there: float, slope_there: float, bound: float) -> float:
    """What a function on [0, 1] cannot fall below if its second derivative stays within a bound.

    Two parabolas lie below it, one from each end; where they cross is the lowest of the greater.
    """
    drop = bound - slope + slope_there
    at = (here - there + slope_there + bound / 2.0) / drop if drop > 0.0 else 0.0
    lowest = min(here, there)
    if 0.0 < at < 1.0:
        lowest = min(lowest, here + slope * at - bound / 2.0 * at * at)
    return lowest


@allocation_free
def _on_arc(
    shape: Any, pieces: Records, kept: float, other_kept: float, arc: Arc, t: float, progress: float
) -> Any:
    """A point of an arc: progress, both clearances, and their slopes by ``t`` from 0 to 1."""
    if t == 0.0:
        x, y, cosine, sine = arc.x, arc.y, arc.cosine, arc.sine
    elif t == 1.0:
        x, y, cosine, sine = arc.end_x, arc.end_y, arc.end_cosine, arc.end_sine
    else:
        x, y, cosine, sine = arc_part(arc, t)
    progress, off, left, right = _across(shape, pieces, x, y, progress)
    part = shape.part
    clear = (left - off) * part[0] - kept
    clear_other = (right + off) * part[1] - other_kept
    _, _, _, first_x, first_y, second_x, second_y = gradients(shape, pieces, x, y, progress)
    slope = -(first_x * cosine + first_y * sine) * arc.length
    return progress, clear, clear_other, slope, -(second_x * cosine + second_y * sine) * arc.length


@allocation_free
def _across(shape: Any, pieces: Records, x: float, y: float, progress: float) -> Any:
    """Progress of the nearest place of the centre line, going along it from a place nearby.

    Newton's method on the derivative of half the squared distance. With it come the distance to the
    left of the centre line, and the widths to the left and the right.
    """
    progress, stride = _within(shape, pieces, progress), shape.stride
    i, t, step = 0, 0.0, 0.0
    dx, dy, rx, ry, squared = 1.0, 0.0, 0.0, 0.0, 1.0
    for _ in range(_MOST_STEPS):
        i, t = _piece(shape, pieces, progress)
        here_x, here_y, dx, dy, ddx, ddy = _center_line(pieces[i], t)
        rx, ry = x - here_x, y - here_y
        squared = dx * dx + dy * dy
        curved = squared - ddx * rx - ddy * ry
        # Beyond the centre of curvature Newton's step would lead away.
        step = (dx * rx + dy * ry) / (curved if curved > _LEAST_PART * squared else squared)
        step = min(max(step, -stride), stride)
        progress = _within(shape, pieces, progress + step)
        if abs(step) <= _SETTLED:
            break
    off = (dx * ry - dy * rx) / math.sqrt(squared)
    left, right = _widths(pieces[i], t + step)
    return progress, off, left, right


@allocation_free
def _within(shape: Any, pieces: Records, progress: float) -> float:
    """The same place with a progress that the table has; NaN becomes the start."""
    low, high = pieces[0].begin, pieces[-1].begin
    if math.isnan(progress):
        progress = low
    if shape.closed and not 0.0 <= progress < shape.length:
        progress -= shape.length * math.floor(progress / shape.length)
    within: float = min(max(progress, low), high)
    return within


@allocation_free
def _piece(shape: Any, pieces: Records, progress: float) -> Any:
    """The piece that a place is on, and its progress since the beginning of that piece."""
    last = pieces.shape[0] - 2
    cell = int((progress - pieces[0].begin) * shape.cells_in_metre)
    i = pieces[min(max(cell, 0), last)].at_cell
    while i < last and progress >= pieces[i + 1].begin:
        i += 1
    while i > 0 and progress < pieces[i].begin:
        i -= 1
    return i, progress - pieces[i].begin


@allocation_free
def _center_line(piece: Any, t: float) -> Any:
    """A place (x, y), and the first and second derivatives of both by the progress."""
    x, y = piece.curves[X], piece.curves[Y]
    return (
        x[0] + t * (x[1] + t * (x[2] + t * x[3])),
        y[0] + t * (y[1] + t * (y[2] + t * y[3])),
        x[1] + t * (2.0 * x[2] + 3.0 * t * x[3]),
        y[1] + t * (2.0 * y[2] + 3.0 * t * y[3]),
        2.0 * x[2] + 6.0 * t * x[3],
        2.0 * y[2] + 6.0 * t * y[3],
    )


@allocation_free
def _widths(piece: Any, t: float) -> Any:
    left, right = piece.curves[LEFT], piece.curves[RIGHT]
    return (
        left[0] + t * (left[1] + t * (left[2] + t * left[3])),
        right[0] + t * (right[1] + t * (right[2] + t * right[3])),
    )


@allocation_free
def _width_slopes(piece: Any, t: float) -> Any:
    left, right = piece.curves[LEFT], piece.curves[RIGHT]
    return (
        left[1] + t * (2.0 * left[2] + 3.0 * t * left[3]),
        right[1] + t * (2.0 * right[2] + 3.0 * t * right[3]),
    )
