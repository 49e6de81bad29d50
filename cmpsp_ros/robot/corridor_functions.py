"""The road along a centre line, for compiled code."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cmpsp_ros.mpsp.jit.compiled import allocation_free, implements
from cmpsp_ros.robot import road_functions
from cmpsp_ros.robot.arcs import Arc, arc_part
from cmpsp_ros.robot.between_samples import TwistLimits, at_ends, sagitta, sagitta_known

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

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

X, Y, LEFT, RIGHT = 0, 4, 8, 12
"""Where in a row of `CorridorSpace.pieces` the four cubic polynomials begin."""


class CorridorSpace(NamedTuple):
    """Where along a centre line the robot's centre may be; the left edge is the first.

    Attributes:
        knots: Progress where one piece of the centre line ends and the next begins, increasing,
            shape ``(S + 1,)`` [m].
        pieces: Of each piece four cubic polynomials of the progress since its beginning, lowest
            power first: x, y, and the widths to the left and to the right, shape ``(S, 16)`` [m].
        cells: Piece with which each of some equal parts of the whole progress begins, ``(C,)``.
        cells_in_metre: Number of these parts in a metre [1/m].
        stations: Some places, close together: x, y, and the direction there (cosine, sine), shape
            ``(Z, 4)`` [m, m, 1, 1].
        station_step: Progress from one of them to the next; the first has progress 0 [m].
        closed: Whether the road ends where it begins.
        length: Of the centre line [m].
        stride: Longest step of a projection [m].
        room: Length up to which an arc between two points of the road is sure not to leave the
            surroundings in which every point has a clear place on the centre line [m].
        decides: What a heading counts where the road crosses itself [m].
        part: What a clearance measured across the road counts, for either edge: less than 1 where
            the width changes, shape ``(2,)``.
        bend: Greatest second derivative of either clearance along any straight line, ``(2,)``
            [1/m].
        kept: Clearance to keep from either edge, for all stages or for each, shape ``(K, 2)`` [m].
    """

    knots: Array
    pieces: Array
    cells: Indices
    cells_in_metre: float
    stations: Array
    station_step: float
    closed: bool
    length: float
    stride: float
    room: float
    decides: float
    part: Array
    bend: Array
    kept: Array

    def for_samples(self, limits: TwistLimits, period: float) -> CorridorSpace:
        """See `ClearSpace.for_samples`."""
        grown = [sagitta(float(bend), limits, period) for bend in self.bend]
        return self._replace(kept=self.kept + np.array([grown]))

    def for_samples_of(self, twists: Array, period: float) -> CorridorSpace:
        """See `ClearSpace.for_samples_of`."""
        grown = at_ends(np.maximum, sagitta_known(self.bend, twists, period))
        return self._replace(kept=self.kept + grown)

    def with_some(self, samples: NDArray[np.bool_], of: CorridorSpace) -> CorridorSpace:
        """See `ClearSpace.with_some`."""
        return self._replace(kept=np.where(samples[:, None], of.kept, self.kept))


@implements(road_functions.find, CorridorSpace)
def find(road: CorridorSpace, x: float, y: float, heading: float, near: float) -> float:
    """Progress of the nearest place that leads the same way; see `road_functions.find`.

    Nearness and direction are added up as squares; which way along the road does not matter.
    """
    progress: float
    if not math.isnan(near):
        progress = _across(road, x, y, near)[0]
        return progress
    stations, cosine, sine = road.stations, math.cos(heading), math.sin(heading)
    weight = road.decides * road.decides
    if math.isnan(heading):
        cosine = sine = weight = 0.0
    best, nearest = math.inf, 0
    for i in range(stations.shape[0]):
        dx, dy = x - stations[i, 0], y - stations[i, 1]
        across = cosine * stations[i, 3] - sine * stations[i, 2]
        score = dx * dx + dy * dy + weight * across * across
        if score < best:
            best, nearest = score, i
    progress = _across(road, x, y, nearest * road.station_step)[0]
    return progress


@implements(road_functions.measure, CorridorSpace)
def measure(road: CorridorSpace, k: int, x: float, y: float, progress: float) -> Any:
    """Widths less the distance from the centre line; see `road_functions.measure`."""
    progress, off, left, right = _across(road, x, y, progress)
    at = min(k, road.kept.shape[0] - 1)
    first = (off - left) * road.part[0] + road.kept[at, 0]
    return progress, off, first, (-off - right) * road.part[1] + road.kept[at, 1]


@implements(road_functions.slopes, CorridorSpace)
def slopes(road: CorridorSpace, x: float, y: float, progress: float) -> Any:
    """Exact derivatives at a projection; see `road_functions.slopes`.

    With the curvature ``c`` of the centre line and the distance ``e`` to its left, that of ``e^2 /
    2`` is ``n n' - e c / (1 - c e) t t'``.
    """
    i, t = _piece(road, progress)
    pieces = road.pieces
    dx, dy = _slope(pieces, i, X, t), _slope(pieces, i, Y, t)
    ddx, ddy = _bend(pieces, i, X, t), _bend(pieces, i, Y, t)
    rx, ry = x - _value(pieces, i, X, t), y - _value(pieces, i, Y, t)
    squared = dx * dx + dy * dy
    size = math.sqrt(squared)
    off_x, off_y = -dy / size, dx / size
    # 1 - c e, times the square of the parameter's speed.
    part = max(squared - ddx * rx - ddy * ry, _LEAST_PART * squared)
    along = -(off_x * rx + off_y * ry) * (dx * ddy - dy * ddx) / (size * part)
    left, right = _slope(pieces, i, LEFT, t) / part, _slope(pieces, i, RIGHT, t) / part
    first, second = road.part[0], road.part[1]
    return (
        off_x,
        off_y,
        along,
        first * (off_x - left * dx),
        first * (off_y - left * dy),
        second * (-off_x - right * dx),
        second * (-off_y - right * dy),
    )


@implements(road_functions.sweep, CorridorSpace)
def sweep(
    road: CorridorSpace, arc: Arc, progress: float, enough: float, enough_other: float
) -> Any:
    """Least clearance to a hundredth of it, or a micrometre; see `road_functions.sweep`.

    The arc is halved until no part can hide a smaller clearance than was found at the ends of all
    parts: along it the second derivative of a clearance is bounded, which bounds the clearance from
    below between two ends where value and slope are known. It is bounded near the road only, which
    a part does not leave if it is short, or if clearances at its ends are as long as it is.
    """
    length, turn = abs(arc.length), abs(arc.turn)
    bound = road.bend[0] * length * length + turn * length
    bound_other = road.bend[1] * length * length + turn * length
    depth, i, here = 0, 0, _on_arc(road, arc, 0.0, progress)
    least, other = here[1], here[2]
    while i < 1 << depth:
        step = 1.0 / (1 << depth)
        there = _on_arc(road, arc, (i + 1) * step, here[0])
        least, other = min(least, there[1]), min(other, there[2])
        lowest = _lowest(here[1], here[3] * step, there[1], there[3] * step, bound * step * step)
        lowest_other = _lowest(
            here[2], here[4] * step, there[2], there[4] * step, bound_other * step * step
        )
        nearest = min(here[1] + there[1], here[2] + there[2])
        known = length * step <= max(road.room, nearest)
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


@implements(road_functions.way_to, CorridorSpace)
def way_to(
    road: CorridorSpace,
    x: float,
    y: float,
    progress: float,
    goal_x: float,
    goal_y: float,
    goal: float,
) -> float:
    """Difference of the two; see `road_functions.way_to`."""
    way = goal - progress
    return way - road.length * round(way / road.length) if road.closed else way


@implements(road_functions.ahead, CorridorSpace)
def ahead(road: CorridorSpace, x: float, y: float, progress: float, way: float, to: Any) -> Any:
    """The point with so much more progress; see `road_functions.ahead`."""
    i, t = _piece(road, _within(road, progress + way))
    return _value(road.pieces, i, X, t), _value(road.pieces, i, Y, t)


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
def _on_arc(road: CorridorSpace, arc: Arc, t: float, progress: float) -> Any:
    """A point of an arc: progress, both clearances, and their slopes by ``t`` from 0 to 1."""
    if t == 0.0:
        x, y, cosine, sine = arc.x, arc.y, arc.cosine, arc.sine
    elif t == 1.0:
        x, y, cosine, sine = arc.end_x, arc.end_y, arc.end_cosine, arc.end_sine
    else:
        x, y, cosine, sine = arc_part(arc, t)
    progress, off, left, right = _across(road, x, y, progress)
    clear = (left - off) * road.part[0] - road.kept[0, 0]
    clear_other = (right + off) * road.part[1] - road.kept[0, 1]
    _, _, _, first_x, first_y, second_x, second_y = slopes(road, x, y, progress)
    slope = -(first_x * cosine + first_y * sine) * arc.length
    return progress, clear, clear_other, slope, -(second_x * cosine + second_y * sine) * arc.length


@allocation_free
def _across(road: CorridorSpace, x: float, y: float, progress: float) -> Any:
    """Progress of the nearest place of the centre line, going along it from a place nearby.

    Newton's method on the derivative of half the squared distance. With it come the distance to the
    left of the centre line, and the widths to the left and the right.
    """
    pieces = road.pieces
    progress = _within(road, progress)
    i, t, step = 0, 0.0, 0.0
    dx, dy, rx, ry, squared = 1.0, 0.0, 0.0, 0.0, 1.0
    for _ in range(_MOST_STEPS):
        i, t = _piece(road, progress)
        dx, dy = _slope(pieces, i, X, t), _slope(pieces, i, Y, t)
        rx, ry = x - _value(pieces, i, X, t), y - _value(pieces, i, Y, t)
        squared = dx * dx + dy * dy
        curved = squared - _bend(pieces, i, X, t) * rx - _bend(pieces, i, Y, t) * ry
        # Beyond the centre of curvature Newton's step would lead away.
        step = (dx * rx + dy * ry) / (curved if curved > _LEAST_PART * squared else squared)
        step = min(max(step, -road.stride), road.stride)
        progress = _within(road, progress + step)
        if abs(step) <= _SETTLED:
            break
    off = (dx * ry - dy * rx) / math.sqrt(squared)
    t += step
    return progress, off, _value(pieces, i, LEFT, t), _value(pieces, i, RIGHT, t)


@allocation_free
def _within(road: CorridorSpace, progress: float) -> float:
    """The same place with a progress that the table has; what is no number becomes the start."""
    low, high = road.knots[0], road.knots[road.knots.shape[0] - 1]
    if math.isnan(progress):
        progress = low
    if road.closed and not 0.0 <= progress < road.length:
        progress -= road.length * math.floor(progress / road.length)
    within: float = min(max(progress, low), high)
    return within


@allocation_free
def _piece(road: CorridorSpace, progress: float) -> Any:
    """The piece that a place is on, and its progress since the beginning of that piece."""
    knots, cells = road.knots, road.cells
    last = knots.shape[0] - 2
    cell = int((progress - knots[0]) * road.cells_in_metre)
    i = cells[min(max(cell, 0), cells.shape[0] - 1)]
    while i < last and progress >= knots[i + 1]:
        i += 1
    while i > 0 and progress < knots[i]:
        i -= 1
    return i, progress - knots[i]


@allocation_free
def _value(pieces: Array, i: int, which: int, t: float) -> float:
    a, b, c, d = pieces[i, which], pieces[i, which + 1], pieces[i, which + 2], pieces[i, which + 3]
    value: float = a + t * (b + t * (c + t * d))
    return value


@allocation_free
def _slope(pieces: Array, i: int, which: int, t: float) -> float:
    b, c, d = pieces[i, which + 1], pieces[i, which + 2], pieces[i, which + 3]
    slope: float = b + t * (2.0 * c + 3.0 * t * d)
    return slope


@allocation_free
def _bend(pieces: Array, i: int, which: int, t: float) -> float:
    bend: float = 2.0 * pieces[i, which + 2] + 6.0 * t * pieces[i, which + 3]
    return bend
