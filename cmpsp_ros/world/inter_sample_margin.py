"""Margins at the samples that keep the arcs between them clear as well.

An arc of radius ``R`` and half angle ``a`` whose ends are at least ``d'`` away from a point outside
its circle keeps ``d``, one whose ends are at most ``d'`` away from a point inside goes to ``d``:

    d'^2 = d^2 + 4 R (d + R) sin^2(a / 2),    d'^2 = d^2 - 4 R (d - R) sin^2(a / 2).

Other placements are milder. The worst arc that can be driven counts
(``doc/method/mathematics.md``).
"""

import math
from collections.abc import Callable
from functools import lru_cache
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from cmpsp_ros.arrays import Array
from cmpsp_ros.mpsp.jit import allocation_free
from cmpsp_ros.robots import TwistLimits

Scalar = TypeVar('Scalar', bound=np.generic)

_GRID = 256
_REFINEMENTS = 3
_RANGES = 32
_CLEARLY = 1.0 - 1e-9

# A straight line is taken for an arc that turns this little [rad/s], on the safe side.
_STRAIGHT = 1e-6


@lru_cache(maxsize=256)
def outside(distance: float, limits: TwistLimits, period: float) -> float:
    """Distance from a point at samples that keeps arcs between them at ``distance`` [m]."""

    def squared(R: Array, a: Array) -> Array:
        return _squared_excess(R, a, distance + R)

    straight = (limits.speed * period / 2.0) ** 2
    return float(np.sqrt(distance**2 + max(straight, _largest(squared, limits, period))))


@lru_cache(maxsize=256)
def inside(distance: float, limits: TwistLimits, period: float) -> float:
    """Distance from a point that keeps arcs between samples within ``distance``; 0 for none."""
    if distance <= limits.top_speed * period:
        return 0.0

    def squared(R: Array, a: Array) -> Array:
        # The excess of an arc grows with its radius up to half the distance, and then shrinks.
        R = np.minimum(R, distance / 2.0)
        return _squared_excess(R, a, distance - R)

    return float(np.sqrt(max(0.0, distance**2 - max(0.0, _largest(squared, limits, period)))))


@lru_cache(maxsize=256)
def bent_edge_margin(bend: float, limits: TwistLimits, period: float) -> float:
    """Clearance from a bent edge at the samples that keeps the arcs between them clear.

    Along an arc the second derivative of the clearance by time is at most ``v w + v^2 bend``:
    over a period it falls below the line between its ends by at most an eighth of that times the
    period squared. The bend is the greatest second derivative of the clearance along any straight
    line [1/m].
    """

    def margin(R: Array, a: Array) -> Array:
        return _edge_margin(R, a, bend)

    straight = bend * (limits.speed * period / 2.0) ** 2 / 2.0
    return max(straight, _largest(margin, limits, period))


def bent_edge_margin_known(bends: Array, twists: Array, period: float) -> Array:
    """Like `bent_edge_margin`, for several edges ``(M,)`` and known arcs; shape ``(N, M)`` [m]."""
    return _edge_margin(*_arcs(twists, period), bends)


def outside_known(distance: Array, twists: Array, period: float) -> Array:
    """Margin ``(N, M)`` as `outside`, for distances ``(M,)`` and known arcs ``(N, 2)``."""
    R, a = _arcs(twists, period)
    return np.asarray(np.sqrt(distance**2 + _squared_excess(R, a, distance + R)))


def inside_known(distance: float, twists: Array, period: float) -> Array:
    """Like `inside`, for known arcs; arguments as in `outside_known`, result ``(N,)`` [m]."""
    R, a = _arcs(twists, period)
    excess = np.maximum(0.0, _squared_excess(R, a, distance - R))[:, 0]
    return np.asarray(np.sqrt(np.maximum(0.0, distance**2 - excess)))


def outside_moving(distance: Array, speeds: Array, limits: TwistLimits, period: float) -> Array:
    """Margin as `outside`, for points at constant velocity, distances ``(N, M)`` [m].

    Seen from such a point the robot drives no arc, but strays from the chord of its path by no
    more than ``v w T^2 / 8``, and the chord is no longer than ``(v + u) T`` with the point's speed
    ``u``. A few ranges of ``w`` each count with their maxima: slightly conservative.
    """
    twists, beyond = _ranges(limits)
    found, astray = np.empty(distance.shape), twists * beyond * period**2 / 8.0
    _put_outside_moving(found, distance, speeds, twists, astray, period)
    return found


def outside_moving_known(distance: Array, speeds: Array, twists: Array, period: float) -> Array:
    """Like `outside_moving`, for distances ``(N, M)`` and one known arc each."""
    v, w = np.abs(twists[:, :1]), np.abs(twists[:, 1:])
    return np.hypot(distance + v * w * period**2 / 8.0, (v + speeds) * period / 2.0)


def at_ends(worse: Callable[[Any, Any], Any], of_arcs: NDArray[Scalar]) -> NDArray[Scalar]:
    """From one value an arc to one a sample: the worse of the two arcs that meet there."""
    before, after = np.concatenate([of_arcs[:1], of_arcs]), np.concatenate([of_arcs, of_arcs[-1:]])
    found: NDArray[Scalar] = worse(before, after)
    return found


@lru_cache(maxsize=16)
def _ranges(limits: TwistLimits) -> tuple[Array, Array]:
    """Ranges of the turn rate: greatest speed and greatest turn rate in each, shape ``(R,)``."""
    w = np.linspace(0.0, limits.turn_rate, _RANGES + 1)
    speeds = limits.speed - limits.half_track * w
    return np.maximum(np.maximum(speeds[:-1], speeds[1:]), 0.0), w[1:]


@allocation_free
def _put_outside_moving(
    found: Array, distance: Array, speeds: Array, v: Array, astray: Array, period: float
) -> None:
    for k in range(found.shape[0]):
        for j in range(found.shape[1]):
            largest, most = 0.0, 0.0
            for i in range(v.shape[0]):
                away, half_chord = distance[k, j] + astray[i], (v[i] + speeds[k, j]) * period / 2.0
                squared = away * away + half_chord * half_chord
                # Where it is clearly less, so is the root, which takes longer.
                if squared < _CLEARLY * most:
                    continue
                root, most = math.hypot(away, half_chord), max(most, squared)
                if not root <= largest:  # NaN is largest
                    largest = root
            found[k, j] = largest


def _arcs(twists: Array, period: float) -> tuple[Array, Array]:
    """Radius and half angle of known arcs, each of shape ``(N, 1)``."""
    w = np.maximum(np.abs(twists[:, 1:]), _STRAIGHT)
    return np.abs(twists[:, :1]) / w, np.minimum(w * period / 2.0, np.pi)


def _squared_excess(R: Array, a: Array, to_center: Array) -> Array:
    """Difference of the squared distances, from the arc's radius, half angle and centre."""
    return np.asarray(4.0 * R * to_center * np.sin(a / 2.0) ** 2)


def _edge_margin(R: Array, a: Array, bend: float | Array) -> Array:
    """Sagitta of an arc, and of an edge that is bent over its length, from above."""
    return np.asarray(R * a**2 / 2.0 + bend * (R * a) ** 2 / 2.0)


def _largest(
    function: Callable[[Array, Array], Array], limits: TwistLimits, period: float
) -> float:
    """Maximum over the arcs within the limits, up to a full circle, by a grid refined thrice."""
    low, high = 0.0, min(np.pi, limits.turn_rate * period / 2.0)
    if high <= 0.0:
        return 0.0
    largest = 0.0
    for _ in range(_REFINEMENTS):
        a = np.linspace(low, high, _GRID + 1)
        a = a[a > 0.0]
        w = 2.0 * a / period
        values = function(np.maximum(limits.speed - limits.half_track * w, 0.0) / w, a)
        best = int(np.argmax(values))
        largest = max(largest, float(values[best]))
        low, high = float(a[max(best - 1, 0)]), float(a[min(best + 1, len(a) - 1)])
    return largest
