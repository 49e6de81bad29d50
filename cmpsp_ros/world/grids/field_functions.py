"""The distance to the occupied cells of a grid, for compiled code.

Two functions, of which neither is more than the distance D. `away_from` is for the plan: its value
and its gradient are continuous. It averages the nodes' distances with the weights w of a quadratic
B-spline, whose mean is the point p and whose variance is ``b^2 = cell^2 / 2`` in all. Seen from p's
nearest occupied point o, ``D(q) <= |q - o|``, so that the average S has ``S^2 <= D^2 + b^2``, by
Jensen's inequality.

`distance_from` and `sweep` are for checks: ``D^2(p) - |p|^2`` is the least of linear functions of
p, one an occupied point, and so is concave. Between nodes q, or points of a straight way, it is at
least the bound from their values, with any weights w whose mean is p:
``D^2 >= sum w (D_q^2 - |q - p|^2)``.
"""

import math
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cmpsp_ros.arrays import Array
from cmpsp_ros.mpsp.jit import allocation_free
from cmpsp_ros.robots.motion import Arc, arc_part

Records = NDArray[np.void]

FRAME: Final = np.dtype(
    [
        # Pose of node (0, 0): its place [m], and the direction of the rows.
        ('x', np.float64),
        ('y', np.float64),
        ('cosine', np.float64),
        ('sine', np.float64),
        # From a node to the next [m].
        ('cell', np.float64),
        # Whether there is nothing beyond the nodes; else all is occupied there.
        ('is_free_beyond', np.bool_),
    ]
)
"""Positions of the nodes of a field."""

_MOST_PIECES = 512
# Pieces of a path in a cell: the loss along each is second order in its length.
_PIECES_IN_CELL = 8.0
# An arc may stray so far from the chords of its pieces [m].
_ASTRAY = 1e-5


class DistanceField(NamedTuple):
    """Distances at the nodes of a grid."""

    frame: Records  # one record of `FRAME`, shape ``(1,)``, shared and never written to
    distances: Array  # negative inside occupied cells, at least four rows and columns [m]


NO_FIELD: Final = DistanceField(np.ones(1, FRAME), np.full((4, 4), math.inf))  # there is none
Fields = tuple[DistanceField, DistanceField]  # the fields of a map and of what sensors see


@allocation_free
def away_from(field: DistanceField, x: float, y: float) -> Any:
    """Distance of a point from the occupied cells, or a little less, and its gradient."""
    frame, distances = field.frame[0], field.distances
    u, v, beyond_u, beyond_v = _place(frame, distances, x, y)
    if math.isnan(u + v):
        return math.nan, math.nan, math.nan
    i, j = min(int(v + 0.5), distances.shape[0] - 2), min(int(u + 0.5), distances.shape[1] - 2)
    s, t = u - j, v - i
    across = (0.5 - s) ** 2 / 2.0, 0.75 - s * s, (0.5 + s) ** 2 / 2.0
    upward = (0.5 - t) ** 2 / 2.0, 0.75 - t * t, (0.5 + t) ** 2 / 2.0
    slopes, slopes_up = (s - 0.5, -2.0 * s, s + 0.5), (t - 0.5, -2.0 * t, t + 0.5)
    value = along_u = along_v = 0.0
    for a in range(3):
        row = slope = 0.0
        for b in range(3):
            row += across[b] * distances[i - 1 + a, j - 1 + b]
            slope += slopes[b] * distances[i - 1 + a, j - 1 + b]
        value += upward[a] * row
        along_u += upward[a] * slope / frame.cell
        along_v += slopes_up[a] * row / frame.cell
    # S - b^2 / S is at most the root of S^2 - b^2; below b it goes on evenly.
    squared = frame.cell * frame.cell / 2.0
    least = math.sqrt(squared)
    distance = value - squared / value if value > least else 2.0 * (value - least)
    stretch = 1.0 + squared / (value * value) if value > least else 2.0
    along_u, along_v = stretch * along_u, stretch * along_v
    beyond = math.hypot(beyond_u, beyond_v)
    if beyond > 0.0:
        along_u, along_v = along_u * (beyond_u == 0.0), along_v * (beyond_v == 0.0)
        if frame.is_free_beyond:
            nearer, distance = distance, math.hypot(distance, beyond)
            along_u = (nearer * along_u + beyond_u) / distance
            along_v = (nearer * along_v + beyond_v) / distance
        else:
            distance -= beyond
            along_u, along_v = along_u - beyond_u / beyond, along_v - beyond_v / beyond
    out_x = frame.cosine * along_u - frame.sine * along_v
    return distance, out_x, frame.sine * along_u + frame.cosine * along_v


@allocation_free
def distance_from(field: DistanceField, x: float, y: float) -> float:
    """A lower bound of the distance of a point, not positive inside the occupied cells."""
    distance: float
    squared, distance = _bounds(field, x, y)
    return math.sqrt(squared) if squared > 0.0 else distance


@allocation_free
def sweep(field: DistanceField, arc: Arc, enough: float) -> float:
    """Lower bound of the least distance of an arc, end to end; exact enough up to `enough` [m]."""
    before, deepest = _bounds(field, arc.x, arc.y)
    after, deeper = _bounds(field, arc.end_x, arc.end_y)
    astray = abs(arc.length * arc.turn) / 8.0
    least: float = _least_between(before, after, arc.x, arc.y, arc.end_x, arc.end_y)
    if math.isnan(least) or (least > 0.0 and math.sqrt(least) - astray > enough):
        return math.sqrt(least) - astray
    fine = max(abs(arc.length) * _PIECES_IN_CELL / field.frame[0].cell, math.sqrt(astray / _ASTRAY))
    pieces = int(min(max(math.ceil(fine), 1.0), _MOST_PIECES))
    x, y, least = arc.x, arc.y, before
    for i in range(1, pieces + 1):
        to_x, to_y, _, _ = arc_part(arc, i / pieces)
        after, deeper = _bounds(field, to_x, to_y)
        least = min(least, _least_between(before, after, x, y, to_x, to_y))
        x, y, before, deepest = to_x, to_y, after, min(deepest, deeper)
    distance = math.sqrt(least) if least > 0.0 else deepest
    return distance - astray / (pieces * pieces)


@allocation_free
def _least_between(
    before: float, after: float, x: float, y: float, to_x: float, to_y: float
) -> float:
    """Least of the squared distance on a straight way, from that at its ends."""
    squared = (to_x - x) ** 2 + (to_y - y) ** 2
    if abs(after - before) >= squared:
        return min(before, after)
    part = 0.5 - (after - before) / (2.0 * squared)
    return before + part * (after - before) - part * (1.0 - part) * squared


@allocation_free
def _bounds(field: DistanceField, x: float, y: float) -> Any:
    """Lower bound of the squared distance, and the distance where that is not positive."""
    frame, distances = field.frame[0], field.distances
    u, v, beyond_u, beyond_v = _place(frame, distances, x, y)
    if math.isnan(u + v):
        return math.nan, math.nan
    i, j = int(v), int(u)
    s, t = u - j, v - i
    squared = signed = 0.0
    for a in range(2):
        for b in range(2):
            weight = (t if a else 1.0 - t) * (s if b else 1.0 - s)
            distance = distances[i + a, j + b]
            squared += weight * max(distance, 0.0) ** 2
            signed += weight * distance
    squared -= frame.cell * frame.cell * (s * (1.0 - s) + t * (1.0 - t))
    beyond = beyond_u * beyond_u + beyond_v * beyond_v
    if frame.is_free_beyond:
        squared += beyond
    elif beyond > 0.0:
        squared, signed = -beyond, signed - math.sqrt(beyond)
    return squared, min(signed, 0.0)


@allocation_free
def _place(frame: Any, distances: Array, x: float, y: float) -> Any:
    """Column and row of a point, within the splines of the nodes, and how far it is beyond [m]."""
    dx, dy = x - frame.x, y - frame.y
    u = (frame.cosine * dx + frame.sine * dy) / frame.cell
    v = (frame.cosine * dy - frame.sine * dx) / frame.cell
    if not math.isfinite(u + v):
        return math.nan, math.nan, 0.0, 0.0
    inside_u = min(max(u, 0.5), distances.shape[1] - 1.5)
    inside_v = min(max(v, 0.5), distances.shape[0] - 1.5)
    return inside_u, inside_v, (u - inside_u) * frame.cell, (v - inside_v) * frame.cell
