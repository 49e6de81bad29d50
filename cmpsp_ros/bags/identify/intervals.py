"""Intervals of 95 % for the parameters of a fit.

A lag and the delay that it is traded for are found along the profile ``S(T)`` of the sum of squares
over the lag ``T``: with the best of all other parameters for each ``T``, those values are possible
that make it larger by no more than a limit. With ``s`` the standard deviation of delay and lag
together at a given lag, their sum ``d`` is possible if

    S(T) - min S + ((d - d(T)) / s)^2 <= 2.58^2 f     for some T,

and the delay alike. The factor ``f`` is by how much the correlation of residuals widens the
parameters' covariance, by sums over blocks of half a second.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from cmpsp_ros.bags.identify.fit import LAG, RATIO, SUM, Fit

Array = NDArray[np.float64]

QUANTILE: Final = 2.58
"""Of 99 %, so that 95 % is kept although noise is estimated, and no robot is quite the model."""

_BLOCK: Final = 0.5
"""Time over which residuals may be correlated [s]."""
_TICK: Final = 1e-3
"""Times are known no better than this: robots work in ticks of it [s]."""
_TRADE: Final = 2e-3
"""Delay and lag by themselves are known no better than this: no wheel is of first order [s]."""
_CALIBRATION: Final = 2e-3
"""Scales are known no better than this."""
_BISECTIONS: Final = 5
_BETTER: Final = 0.1
"""Fall of the sum of squares at which another fit is taken for a better one."""


@dataclass(frozen=True)
class Interval:
    """An estimate with the interval that has the true value in 95 of 100 cases, or more."""

    value: float
    low: float
    high: float

    def shifted(self, by: float) -> Interval:
        """The interval of what is larger by so much."""
        return Interval(self.value + by, self.low + by, self.high + by)

    @property
    def figures(self) -> tuple[str, str, str]:
        """Value and ends, as text."""
        value, low, high = (f'{each:.4g}' for each in (self.value, self.low, self.high))
        return value, low, high

    @property
    def half_width(self) -> float:
        """Half of its width."""
        return (self.high - self.low) / 2.0


@dataclass(frozen=True)
class Times:
    """Delay, lag, and both together [s]."""

    delay: Interval
    lag: Interval
    together: Interval


def times_of(found: Fit) -> tuple[Fit, Times]:
    """Intervals of delay and lag, and the fit where they were found.

    The profile may come upon a better fit.
    """
    points = _profile(found)
    better = min(points, key=lambda one: one.misfit)
    if better.misfit < found.misfit - _BETTER:
        return times_of(better.solved(better.p))
    points.sort(key=lambda one: one.p[LAG])
    sums, lags, rises = (
        np.array(each)
        for each in zip(
            *((one.p[SUM], one.p[LAG], one.misfit - found.misfit) for one in points), strict=True
        )
    )
    fine = np.linspace(lags[0], lags[-1], 2001)
    together, left = np.interp(fine, lags, sums), _limit(found) - np.interp(fine, lags, rises)
    possible = left >= 0.0
    spread = np.sqrt(left[possible]) * _deviation(found, [SUM])[0]
    fine, together = fine[possible], together[possible]

    def interval(value: float, centers: Array, around: Array | float, least: float) -> Interval:
        low, high = float(np.min(centers - around)), float(np.max(centers + around))
        return Interval(float(value), min(low, value) - least, max(high, value) + least)

    lag = interval(found.p[LAG], fine, 0.0, _TRADE)
    return found, Times(
        interval(found.p[SUM] - found.p[LAG], together - fine, spread, _TRADE),
        Interval(lag.value, max(lag.low, 0.0), lag.high),
        interval(found.p[SUM], together, spread, _TICK),
    )


def interval_of(found: Fit, place: int) -> Interval:
    """Interval of a scale or of a limit, by the place of the parameter."""
    others = [each for each in range(len(found.p)) if each not in {RATIO, LAG}]
    deviation, widened = _deviation(found, others), _widening(found, others)
    at = others.index(place)
    value = float(found.p[place])
    floor = _CALIBRATION * abs(value)
    half = math.hypot(QUANTILE * deviation[at] * math.sqrt(widened[at]), floor)
    return Interval(value, value - half, value + half)


def _profile(found: Fit) -> list[Fit]:
    """Best fits at lags on both sides, until they are no longer possible."""
    points, limit = [found], found.misfit + _limit(found)
    size = max(_deviation(found, [SUM, LAG])[1], _TICK)
    for side in (-1.0, 1.0):
        inside, step, outside = found, min(2.0 * size, 0.1), None
        while outside is None:
            lag = max(inside.p[LAG] + side * step, 1e-4)
            tried = _at_lag(inside, lag)
            points.append(tried)
            if tried.misfit > limit or not 1e-4 < lag < 2.0:
                outside = tried
            else:
                inside, step = tried, 2.0 * step
        for _ in range(_BISECTIONS):
            tried = _at_lag(inside, (inside.p[LAG] + outside.p[LAG]) / 2.0)
            points.append(tried)
            inside, outside = (inside, tried) if tried.misfit > limit else (tried, outside)
    return points


def _at_lag(near: Fit, lag: float) -> Fit:
    start = near.p.copy()
    start[LAG] = lag
    return near.solved(start, [LAG])


def _limit(found: Fit) -> float:
    """Rise of the sum of squares up to which parameters are possible."""
    return QUANTILE**2 * float(_widening(found, [SUM, LAG]).max())


def _deviation(found: Fit, places: list[int]) -> Array:
    """Standard deviations of some parameters with the others fixed, without correlation."""
    covariance = np.linalg.pinv(found.jacobian[:, places].T @ found.jacobian[:, places])
    deviation: Array = np.sqrt(np.diag(covariance))
    return deviation


def _widening(found: Fit, places: list[int]) -> Array:
    """By how much correlated residuals widen the variances of some parameters; 1 or more."""
    jacobian = found.jacobian[:, places]
    period = np.median(np.diff(found.model.drives[0].stamps))
    begins = np.arange(0, len(jacobian), max(round(_BLOCK / period), 1))
    scores = np.add.reduceat(jacobian * found.residuals[:, None], begins)
    inverse = np.linalg.pinv(jacobian.T @ jacobian)
    robust = np.diag(inverse @ (scores.T @ scores) @ inverse)
    plain = np.maximum(np.diag(inverse), 1e-300)
    widened: Array = np.maximum(robust / plain, 1.0)
    return widened
