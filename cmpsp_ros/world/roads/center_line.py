"""A smooth line through points, with widths, as cubic pieces by its length.

The line is the cubic spline through the points whose second derivative is continuous; an open one
is straight at its ends, and goes on straight beyond them. Its parameter is the length along it: the
knots are moved to where the lengths of the pieces put them until they stay. Widths are interpolated
without overshoot (Fritsch and Butland, SIAM J. Sci. Stat. Comput. 5, 1984): between two points the
road is nowhere narrower than at the narrower of them.
"""

from typing import NamedTuple

import numpy as np

from cmpsp_ros.arrays import Array, IntArray

_PASSES = 4
_GAUSS, _WEIGHTS = np.polynomial.legendre.leggauss(8)
_ALONG_PIECE = 9

# How far a road that ends goes on, beyond its own length [m].
_BEYOND = 10.0


class CenterLine(NamedTuple):
    """Knots ``(S + 1,)`` and cubic pieces ``(S, 16)``, and the length of the road [m]."""

    knots: Array
    pieces: Array
    length: float


class Samples(NamedTuple):
    """A line at many places, each array of shape ``(Z,)``."""

    progress: Array  # length along the line [m]
    point: IntArray  # number of the point from which on each sample is, or of the last one
    x: Array  # position [m]
    y: Array  # see `x`
    cosine: Array  # of the direction
    sine: Array  # see `cosine`
    curvature: Array  # positive to the left [1/m]
    curvature_slope: Array  # its derivative by the length [1/m^2]
    widths: Array  # left and right, and two derivatives by length, ``(2, 3, Z)`` [m, 1, 1/m]


def fit(points: Array, left: Array, right: Array, *, closed: bool) -> CenterLine:
    """The smooth line through points ``(P, 2)`` with widths ``(P,)`` to the left and right [m]."""
    from scipy.interpolate import CubicSpline  # noqa: PLC0415 (half a second for roads of this kind)

    if closed:
        points, left, right = (np.concatenate([each, each[:1]]) for each in (points, left, right))
    knots = _lengths(np.hypot(*np.diff(points, axis=0).T))
    for _ in range(_PASSES):
        line = CubicSpline(knots, points, bc_type='periodic' if closed else 'natural')
        middles, halves = (knots[1:] + knots[:-1]) / 2.0, np.diff(knots) / 2.0
        speed = np.linalg.norm(line(middles[:, None] + halves[:, None] * _GAUSS, 1), axis=2)
        knots = _lengths(halves * (speed @ _WEIGHTS))
    line = CubicSpline(knots, points, bc_type='periodic' if closed else 'natural')
    columns = [line.c[::-1, :, 0], line.c[::-1, :, 1]]
    columns += [_without_overshoot(knots, each, closed=closed) for each in (left, right)]
    pieces = np.ascontiguousarray(np.concatenate(columns).T)
    length = float(knots[-1])
    if not closed:
        knots, pieces = _extended(knots, pieces, length + _BEYOND)
    return CenterLine(knots, pieces, length)


def sample(line: CenterLine, *, closed: bool) -> Samples:
    """Samples on each piece of the line, without those beyond its ends."""
    inner = slice(None) if closed else slice(1, -1)
    pieces, begins = line.pieces[inner], line.knots[:-1][inner]
    part = np.linspace(0.0, 1.0, _ALONG_PIECE, endpoint=False)
    t = np.diff(line.knots)[inner][:, None] * part
    values = [_derivatives(pieces[:, 4 * which : 4 * which + 4], t) for which in range(4)]
    (x, dx, ddx, dddx), (y, dy, ddy, dddy) = values[:2]
    speed = np.hypot(dx, dy)
    curvature = (dx * ddy - dy * ddx) / speed**3
    slope = (dx * dddy - dy * dddx) / speed**4
    slope = slope - 3.0 * curvature * (dx * ddx + dy * ddy) / speed**3
    point = np.repeat(np.arange(len(pieces)), _ALONG_PIECE)
    widths = np.array([[each.ravel() for each in width[:3]] for width in values[2:]])
    progress: Array = (begins[:, None] + t).ravel()
    cosine, sine = (dx / speed).ravel(), (dy / speed).ravel()
    flat = (x.ravel(), y.ravel(), cosine, sine, curvature.ravel(), slope.ravel())
    return Samples(progress, point, *flat, widths)


def _derivatives(coefficients: Array, t: Array) -> tuple[Array, Array, Array, Array]:
    a, b, c, d = (coefficients[:, i : i + 1] for i in range(4))
    third = np.broadcast_to(6.0 * d, t.shape)
    return (
        a + t * (b + t * (c + t * d)),
        b + t * (2.0 * c + 3.0 * t * d),
        2.0 * c + 6.0 * t * d,
        third,
    )


def _lengths(pieces: Array) -> Array:
    return np.concatenate([[0.0], np.cumsum(pieces)])


def _without_overshoot(knots: Array, values: Array, *, closed: bool) -> Array:
    """Coefficients of the monotone pieces through values, lowest power first, ``(4, S)``."""
    steps = np.diff(knots)
    rise = np.diff(values) / steps
    before, after = np.roll(rise, 1), rise
    short, long = np.roll(steps, 1), steps
    first, second = 2.0 * long + short, long + 2.0 * short
    with np.errstate(divide='ignore', invalid='ignore'):
        mean = (first + second) / (first / before + second / after)
    slopes = np.where(before * after > 0.0, mean, 0.0)
    if not closed:
        slopes[0] = 0.0
    slopes = np.append(slopes, slopes[0] if closed else 0.0)
    begin, end = slopes[:-1], slopes[1:]
    return np.array(
        [
            values[:-1],
            begin,
            (3.0 * rise - 2.0 * begin - end) / steps,
            (begin + end - 2.0 * rise) / steps**2,
        ]
    )


def _extended(knots: Array, pieces: Array, beyond: float) -> tuple[Array, Array]:
    """With a straight piece of one width before the first and after the last."""
    first, last = np.zeros(16), np.zeros(16)
    for which in range(4):
        here = slice(4 * which, 4 * which + 2)
        value, slope = pieces[0, here]
        first[here] = value - beyond * slope, slope
        end = _derivatives(pieces[-1:, 4 * which : 4 * which + 4], np.diff(knots)[None, -1:])
        last[here] = end[0][0, 0], end[1][0, 0]
    knots = np.concatenate([[-beyond], knots, [knots[-1] + beyond]])
    return knots, np.vstack([first, pieces, last])
