"""Shortest paths of a car that drives forward and backward.

Reeds and Shepp, Optimal paths for a car that goes both forwards and backwards, 1990; the numbers of
formulas are theirs. Lengths are in turning radii.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from itertools import product
from typing import Final, NamedTuple

LEFT, STRAIGHT, RIGHT = 1, 0, -1

_TURNS: Final = {'L': LEFT, 'S': STRAIGHT, 'R': RIGHT}
_QUARTER: Final = math.pi / 2.0

Solutions = Iterator[tuple[float, ...]]


class Segment(NamedTuple):
    """A part of a path: its turn, and its length, negative where it is driven backward."""

    turn: int
    length: float


def shortest_paths(x: float, y: float, heading: float) -> list[tuple[Segment, ...]]:
    """Paths from the origin to a pose, the shortest of every word, by ascending length."""
    found = []
    for gear, side in product((1, -1), repeat=2):
        # Driven in the other direction, or mirrored, a word leads to another pose.
        ahead, left, turned = gear * x, side * y, gear * side * heading
        for word in _words(ahead, left, turned):
            path = tuple(
                Segment(side * turn, gear * length) for turn, length in word if abs(length) > 1e-9
            )
            found.append(path)
    return sorted(found, key=length_of)


def length_of(path: tuple[Segment, ...]) -> float:
    """Length of a path."""
    return sum(abs(length) for _, length in path)


def _words(x: float, y: float, phi: float) -> Iterator[list[tuple[int, float]]]:
    """Paths that begin with a turn to the left, forward, for those words that have a solution."""
    back = x * math.cos(phi) + y * math.sin(phi), x * math.sin(phi) - y * math.cos(phi)
    for formula, is_reversed, turns, lengths in _WORDS:
        for t, u, *w, v in formula(*(back if is_reversed else (x, y)), phi):
            known = {'t': t, 'u': u, 'v': v, 'w': w[0] if w else 0.0, 'q': -_QUARTER}
            yield [(_TURNS[turn], known[each]) for turn, each in zip(turns, lengths, strict=True)]


def _left_straight_left(x: float, y: float, phi: float) -> Solutions:
    """Formula 8.1."""
    u, t = _polar(x - math.sin(phi), y - 1.0 + math.cos(phi))
    v = _wrapped(phi - t)
    if t >= 0.0 and v >= 0.0:
        yield t, u, v


def _left_straight_right(x: float, y: float, phi: float) -> Solutions:
    """Formula 8.2."""
    rho, theta = _polar(x + math.sin(phi), y - 1.0 - math.cos(phi))
    if rho >= 2.0:
        u = math.sqrt(rho**2 - 4.0)
        t = _wrapped(theta + math.atan2(2.0, u))
        v = _wrapped(t - phi)
        if t >= 0.0 and v >= 0.0:
            yield t, u, v


def _three_turns(x: float, y: float, phi: float) -> Solutions:
    """Formulas 8.3 and 8.4."""
    rho, theta = _polar(x - math.sin(phi), y - 1.0 + math.cos(phi))
    if rho <= 4.0:
        u = -2.0 * math.asin(rho / 4.0)
        t = _wrapped(theta + u / 2.0 + math.pi)
        if t >= 0.0:
            yield t, u, _wrapped(phi - t + u)


def _four_turns(x: float, y: float, phi: float) -> Solutions:
    """Formulas 8.7 and 8.8."""
    xi, eta = x + math.sin(phi), y - 1.0 - math.cos(phi)
    rho = (2.0 + math.hypot(xi, eta)) / 4.0
    if rho <= 1.0:
        u = math.acos(rho)
        t, v = _outer_turns(u, -u, xi, eta, phi)
        if t >= 0.0 >= v:
            yield t, u, -u, v
    rho = (20.0 - xi**2 - eta**2) / 16.0
    if 0.0 <= rho <= 1.0:
        u = -math.acos(rho)
        t, v = _outer_turns(u, u, xi, eta, phi)
        if t >= 0.0 and v >= 0.0:
            yield t, u, u, v


def _outer_turns(u: float, v: float, xi: float, eta: float, phi: float) -> tuple[float, float]:
    delta = _wrapped(u - v)
    A, B = math.sin(u) - math.sin(delta), math.cos(u) - math.cos(delta) - 1.0
    theta = math.atan2(eta * A - xi * B, xi * A + eta * B)
    flips = 2.0 * (math.cos(delta) - math.cos(v) - math.cos(u)) + 3.0 < 0.0
    tau = _wrapped(theta + math.pi if flips else theta)
    return tau, _wrapped(tau - u + v - phi)


def _quarter_then_left(x: float, y: float, phi: float) -> Solutions:
    """Formula 8.9."""
    rho, theta = _polar(x - math.sin(phi), y - 1.0 + math.cos(phi))
    if rho >= 2.0:
        r = math.sqrt(rho**2 - 4.0)
        u, t = 2.0 - r, _wrapped(theta + math.atan2(r, -2.0))
        v = _wrapped(phi - _QUARTER - t)
        if t >= 0.0 >= u and v <= 0.0:
            yield t, u, v


def _quarter_then_right(x: float, y: float, phi: float) -> Solutions:
    """Formula 8.10."""
    rho, t = _polar(1.0 + math.cos(phi) - y, x + math.sin(phi))
    if rho >= 2.0:
        u, v = 2.0 - rho, _wrapped(t + _QUARTER - phi)
        if t >= 0.0 >= u and v <= 0.0:
            yield t, u, v


def _two_quarters(x: float, y: float, phi: float) -> Solutions:
    """Formula 8.11."""
    xi, eta = x + math.sin(phi), y - 1.0 - math.cos(phi)
    rho, _ = _polar(xi, eta)
    if rho >= 2.0:
        u = 4.0 - math.sqrt(rho**2 - 4.0)
        t = _wrapped(math.atan2((4.0 - u) * xi - 2.0 * eta, -2.0 * xi + (u - 4.0) * eta))
        v = _wrapped(t - phi)
        if u <= 0.0 <= t and v >= 0.0:
            yield t, u, v


_WORDS: Final[tuple[tuple[Callable[..., Solutions], bool, str, str], ...]] = (
    (_left_straight_left, False, 'LSL', 'tuv'),
    (_left_straight_right, False, 'LSR', 'tuv'),
    (_three_turns, False, 'LRL', 'tuv'),
    (_three_turns, True, 'LRL', 'vut'),
    (_four_turns, False, 'LRLR', 'tuwv'),
    (_quarter_then_left, False, 'LRSL', 'tquv'),
    (_quarter_then_right, False, 'LRSR', 'tquv'),
    (_quarter_then_left, True, 'LSRL', 'vuqt'),
    (_quarter_then_right, True, 'RSRL', 'vuqt'),
    (_two_quarters, False, 'LRSLR', 'tquqv'),
)
"""Formula, whether it is for the reversed path, turns, and lengths; q is a quarter backward."""


def _polar(x: float, y: float) -> tuple[float, float]:
    return math.hypot(x, y), math.atan2(y, x)


def _wrapped(angle: float) -> float:
    return math.remainder(angle, math.tau)
