"""The road along a centre line, for compiled code; see `road_functions`.

Its numbers are `N_SCALARS` scalars, named below, and `STATION` numbers for each of some places on
the centre line, close together: x, y, and the direction there (cosine, sine) [m, m, 1, 1]. The rows
of its table are the pieces of the centre line, with one more for where the last piece ends.
"""

import math
from typing import Any

from cmpsp_ros.arrays import Array
from cmpsp_ros.mpsp.jit import allocation_free, inlined, inner
from cmpsp_ros.robots.motion import Arc, arc_part
from cmpsp_ros.world.roads.road_functions import RoadSpace

# The error of a projection is of second order in its last step [m].
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

# Length of the centre line, and the longest step of a projection [m].
LENGTH, STRIDE = 0, 1
# Length up to which an arc between two points of the road is sure not to leave the surroundings in
# which every point has a unique projection onto the centre line [m].
ROOM = 2
# Weight of a heading where the road crosses itself [m].
DECIDES = 3
# Progress from one station to the next; the first has progress 0 [m].
STATION_STEP = 4
# Number of the cells of the pieces in a metre [1/m].
CELLS_IN_METRE = 5
# Fraction of a distance across the road that counts as clearance, for either edge: less than 1
# where the width changes. Greatest second derivatives of both along any straight line [1/m].
PART, PART_OTHER, BEND, BEND_OTHER = 6, 7, 8, 9
# Whether the road ends where it begins, and the number of stations.
CLOSED, N_STATIONS = 10, 11
N_SCALARS = 12

# A piece: progress where it begins [m]; the number of the piece that the cell of this number begins
# with, where the whole progress has as many equal cells as there are pieces; and, from 2, 6, 10 and
# 14 on, cubic polynomials of the progress since then, lowest power first: x, y, and the widths to
# the left and to the right [m].
PIECE = 18
_BEGIN, _AT_CELL = 0, 1
STATION = 4


@inner
def project(road: RoadSpace, x: float, y: float, heading: float, near: float) -> None:
    """Progress of the nearest place in the same direction; both are added up as squares."""
    if not math.isnan(near):
        road.found[0] = _across(road, x, y, near)[0]
        return
    cosine, sine, weight = math.cos(heading), math.sin(heading), road.numbers[DECIDES] ** 2
    if math.isnan(heading):
        cosine = sine = weight = 0.0
    best, nearest = math.inf, 0
    at = N_SCALARS
    for i in range(int(road.numbers[N_STATIONS])):
        dx, dy = x - road.numbers[at], y - road.numbers[at + 1]
        across = cosine * road.numbers[at + 3] - sine * road.numbers[at + 2]
        score = dx * dx + dy * dy + weight * across * across
        if score < best:
            best, nearest = score, i
        at += STATION
    road.found[0] = _across(road, x, y, nearest * road.numbers[STATION_STEP])[0]


@inner
def lateral_error(road: RoadSpace, k: int, x: float, y: float, progress: float) -> None:
    """Widths less the distance from the centre line."""
    progress, off, left, right = _across(road, x, y, progress)
    road.found[0], road.found[1] = progress, off
    road.found[2] = (off - left) * road.numbers[PART] + road.kept[k, 0]
    road.found[3] = (-off - right) * road.numbers[PART_OTHER] + road.kept[k, 1]


@inner
def gradients(road: RoadSpace, x: float, y: float, progress: float) -> None:
    """Exact derivatives at a projection, see `_gradients`."""
    slopes = _gradients(road, x, y, progress)
    for i in range(7):
        road.found[i] = slopes[i]


@inner
def sweep(road: RoadSpace, arc: Arc, progress: float, enough: float, enough_other: float) -> None:
    """Least clearance of an arc, see `_sweep`."""
    least = _sweep(road, arc, progress, enough, enough_other)
    road.found[0], road.found[1], road.found[2] = least


@inner
def arc_length_to(
    road: RoadSpace,
    _x: float,
    _y: float,
    progress: float,
    _goal_x: float,
    _goal_y: float,
    goal: float,
) -> None:
    """Difference of the two."""
    way = goal - progress
    if road.numbers[CLOSED] > 0.0:
        way -= road.numbers[LENGTH] * round(way / road.numbers[LENGTH])
    road.found[0] = way


@inner
def point_ahead(
    road: RoadSpace, _x: float, _y: float, progress: float, way: float, _to: Any
) -> None:
    """The point with so much more progress."""
    piece, t = _piece(road, _within(road, progress + way))
    road.found[0], road.found[1], _, _, _, _ = _center_line(road.table[piece], t)


FUNCTIONS = project, lateral_error, gradients, sweep, arc_length_to, point_ahead


@inlined
def _gradients(road: RoadSpace, x: float, y: float, progress: float) -> Any:
    """Exact derivatives at a projection.

    With the curvature ``c`` of the centre line and the distance ``e`` to its left, that of ``e^2 /
    2`` is ``n n' - e c / (1 - c e) t t'``.
    """
    piece, t = _piece(road, progress)
    here_x, here_y, dx, dy, ddx, ddy = _center_line(road.table[piece], t)
    rx, ry = x - here_x, y - here_y
    squared = dx * dx + dy * dy
    size = math.sqrt(squared)
    off_x, off_y = -dy / size, dx / size
    # 1 - c e, times the square of the parameter's speed.
    part = max(squared - ddx * rx - ddy * ry, _LEAST_PART * squared)
    along = -(off_x * rx + off_y * ry) * (dx * ddy - dy * ddx) / (size * part)
    left, right = _width_slopes(road.table[piece], t)
    left, right = left / part, right / part
    first, second = road.numbers[PART], road.numbers[PART_OTHER]
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
def _sweep(road: RoadSpace, arc: Arc, progress: float, enough: float, enough_other: float) -> Any:
    """Least clearance to a hundredth of it, or a micrometre.

    The arc is halved until no part can hide a smaller clearance than at the ends of all parts:
    value and slope there and a bounded second derivative bound it. That is bounded near the road,
    which a short part does not leave, nor one with as much clearance at its ends.
    """
    length, turn = abs(arc.length), abs(arc.turn)
    bound = road.numbers[BEND] * length * length + turn * length
    bound_other = road.numbers[BEND_OTHER] * length * length + turn * length
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
        known = length * step <= max(road.numbers[ROOM], nearest)
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
    # NaN if the arc's end is.
    nothing = 0.0 * (arc.end_x + arc.end_y)
    return here[0], least + nothing, other + nothing


@allocation_free
def _nearly(clearance: float) -> float:
    return clearance - _TOLERANCE - _PART * max(clearance, 0.0)


@allocation_free
def _lowest(here: float, slope: float, there: float, slope_there: float, bound: float) -> float:
    """Lower bound of a function on [0, 1] by its second derivative: where two parabolas cross."""
    drop = bound - slope + slope_there
    at = (here - there + slope_there + bound / 2.0) / drop if drop > 0.0 else 0.0
    lowest = min(here, there)
    if 0.0 < at < 1.0:
        lowest = min(lowest, here + slope * at - bound / 2.0 * at * at)
    return lowest


@allocation_free
def _on_arc(road: RoadSpace, arc: Arc, t: float, progress: float) -> Any:
    """A point of an arc: progress, both clearances, and their slopes by ``t`` from 0 to 1."""
    if t == 0.0:
        x, y, cosine, sine = arc.x, arc.y, arc.cosine, arc.sine
    elif t == 1.0:
        x, y, cosine, sine = arc.end_x, arc.end_y, arc.end_cosine, arc.end_sine
    else:
        x, y, cosine, sine = arc_part(arc, t)
    progress, off, left, right = _across(road, x, y, progress)
    clear = (left - off) * road.numbers[PART] - road.kept[0, 0]
    clear_other = (right + off) * road.numbers[PART_OTHER] - road.kept[0, 1]
    _, _, _, first_x, first_y, second_x, second_y = _gradients(road, x, y, progress)
    slope = -(first_x * cosine + first_y * sine) * arc.length
    return progress, clear, clear_other, slope, -(second_x * cosine + second_y * sine) * arc.length


@inlined
def _across(road: RoadSpace, x: float, y: float, progress: float) -> Any:
    """Progress of the nearest place, by Newton's method; distance to its left, both widths."""
    progress, stride = _within(road, progress), road.numbers[STRIDE]
    piece, t, step = 0, 0.0, 0.0
    dx, dy, rx, ry, squared = 1.0, 0.0, 0.0, 0.0, 1.0
    for _ in range(_MOST_STEPS):
        piece, t = _piece(road, progress)
        here_x, here_y, dx, dy, ddx, ddy = _center_line(road.table[piece], t)
        rx, ry = x - here_x, y - here_y
        squared = dx * dx + dy * dy
        curved = squared - ddx * rx - ddy * ry
        # Beyond the centre of curvature Newton's step would lead away.
        step = (dx * rx + dy * ry) / (curved if curved > _LEAST_PART * squared else squared)
        step = min(max(step, -stride), stride)
        progress = _within(road, progress + step)
        if abs(step) <= _SETTLED:
            break
    off = (dx * ry - dy * rx) / math.sqrt(squared)
    left, right = _widths(road.table[piece], t + step)
    return progress, off, left, right


@inlined
def _within(road: RoadSpace, progress: float) -> float:
    """The same place with a progress that the table has; NaN becomes the start."""
    low, high, length = road.table[0, _BEGIN], road.table[-1, _BEGIN], road.numbers[LENGTH]
    if math.isnan(progress):
        progress = low
    if road.numbers[CLOSED] > 0.0 and not 0.0 <= progress < length:
        progress -= length * math.floor(progress / length)
    within: float = min(max(progress, low), high)
    return within


@inlined
def _piece(road: RoadSpace, progress: float) -> Any:
    """Number of the piece that a place is on, and its progress since the beginning of that."""
    last = road.table.shape[0] - 2
    cell = int((progress - road.table[0, _BEGIN]) * road.numbers[CELLS_IN_METRE])
    i = int(road.table[min(max(cell, 0), last), _AT_CELL])
    while i < last and progress >= road.table[i + 1, _BEGIN]:
        i += 1
    while i > 0 and progress < road.table[i, _BEGIN]:
        i -= 1
    return i, progress - road.table[i, _BEGIN]


@inlined
def _center_line(piece: Array, t: float) -> Any:
    """A place (x, y), and the first and second derivatives of both by the progress."""
    return (
        piece[2] + t * (piece[3] + t * (piece[4] + t * piece[5])),
        piece[6] + t * (piece[7] + t * (piece[8] + t * piece[9])),
        piece[3] + t * (2.0 * piece[4] + 3.0 * t * piece[5]),
        piece[7] + t * (2.0 * piece[8] + 3.0 * t * piece[9]),
        2.0 * piece[4] + 6.0 * t * piece[5],
        2.0 * piece[8] + 6.0 * t * piece[9],
    )


@inlined
def _widths(piece: Array, t: float) -> Any:
    return (
        piece[10] + t * (piece[11] + t * (piece[12] + t * piece[13])),
        piece[14] + t * (piece[15] + t * (piece[16] + t * piece[17])),
    )


@inlined
def _width_slopes(piece: Array, t: float) -> Any:
    return (
        piece[11] + t * (2.0 * piece[12] + 3.0 * t * piece[13]),
        piece[15] + t * (2.0 * piece[16] + 3.0 * t * piece[17]),
    )
