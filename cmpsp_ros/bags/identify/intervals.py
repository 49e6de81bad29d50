"""Intervals for the parameters of a fit.

The lag is found along the profile ``S(T)`` of the sum of squares: a lag ``T`` is possible if the
best of all other parameters makes it larger by no more than a limit. With ``s`` the standard
deviation of delay and lag together at a given lag, their sum ``d`` is possible if

    S(T) - min S + ((d - d(T)) / s)^2 <= 2.58^2 f     for some T,

and the delay ``d - T`` alike. By the factor ``f`` the correlation of residuals widens the variances
of the parameters: it is found from sums over blocks of half a second.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from cmpsp_ros.arrays import Array
from cmpsp_ros.bags.identify.fit import LAG, RATIO, SUM, Fit

QUANTILE: Final = 2.58
"""Quantile of 99 %, to keep 95 % although noise is estimated and no robot is quite the model."""

_BLOCK: Final = 0.5
_BISECTIONS: Final = 5
_BETTER: Final = 0.1

_TICK, _TRADE, _CALIBRATION = 1e-3, 2e-3, 2e-3
"""Least half widths: of delay with lag [s], of either by itself [s], and of scales."""


@dataclass(frozen=True)
class Interval:
    """An estimate with the interval that has the true value in 95 of 100 cases, or more."""

    value: float
    low: float
    high: float

    def shifted(self, by: float) -> Interval:
        """The interval of what is larger by so much."""
        return Interval(self.value + by, self.low + by, self.high + by)

    def __str__(self) -> str:
        return f'{self.value:.4g} ({self.low:.4g} to {self.high:.4g})'


def delay_and_lag(found: Fit) -> tuple[Fit, Interval, Interval, Interval]:
    """Intervals of delay, lag and both together [s], after the fit where they were found.

    The profile may come upon a better fit.
    """
    points = _profile(found)
    better = min(points, key=lambda one: one.misfit)
    if better.misfit < found.misfit - _BETTER:
        return delay_and_lag(better.solved(better.p))
    points.sort(key=lambda one: one.p[LAG])
    lags, sums, rises = np.array([(*one.p[[LAG, SUM]], one.misfit) for one in points]).T
    lag = np.linspace(lags[0], lags[-1], 2001)
    left = found.misfit + _limit(found) - np.interp(lag, lags, rises)
    lag, left = lag[left >= 0.0], left[left >= 0.0]
    spread = np.sqrt(left) * _deviations(found, [SUM])[0]
    together = np.interp(lag, lags, sums)

    def interval(value: float, centers: Array, around: Array, least: float) -> Interval:
        low, high = float(np.min(centers - around)), float(np.max(centers + around))
        return Interval(float(value), min(low, value) - least, max(high, value) + least)

    total, own = found.p[[SUM, LAG]]
    delay = interval(total - own, together - lag, spread, _TRADE)
    alone = interval(own, lag, np.zeros(1), _TRADE)
    alone = Interval(alone.value, max(alone.low, 0.0), alone.high)
    return found, delay, alone, interval(total, together, spread, _TICK)


def parameter_interval(found: Fit, place: int) -> Interval:
    """Interval of a scale or of a limit, by the place of the parameter."""
    others = [each for each in range(len(found.p)) if each not in {RATIO, LAG}]
    value, at = float(found.p[place]), others.index(place)
    half = QUANTILE * (_deviations(found, others) * np.sqrt(_inflation(found, others)))[at]
    half = math.hypot(half, _CALIBRATION * value)
    return Interval(value, value - half, value + half)


def _profile(found: Fit) -> list[Fit]:
    """Best fits at lags on both sides, until they are no longer possible."""
    points, limit = [found], found.misfit + _limit(found)
    size = max(_deviations(found, [SUM, LAG])[1], _TICK)

    def at_lag(near: Fit, lag: float) -> Fit:
        start = near.p.copy()
        start[LAG] = lag
        points.append(near.solved(start, [LAG]))
        return points[-1]

    for side in (-1.0, 1.0):
        inside, step, outside = found, min(2.0 * size, 0.1), None
        while outside is None:
            tried = at_lag(inside, max(inside.p[LAG] + side * step, 1e-4))
            if tried.misfit > limit or not 1e-4 < tried.p[LAG] < 2.0:
                outside = tried
            else:
                inside, step = tried, 2.0 * step
        for _ in range(_BISECTIONS):
            tried = at_lag(inside, (inside.p[LAG] + outside.p[LAG]) / 2.0)
            inside, outside = (inside, tried) if tried.misfit > limit else (tried, outside)
    return points


def _limit(found: Fit) -> float:
    """Rise of the sum of squares up to which parameters are possible."""
    return QUANTILE**2 * float(_inflation(found, [SUM, LAG]).max())


def _deviations(found: Fit, places: list[int]) -> Array:
    """Standard deviations of some parameters with the others fixed, without correlation."""
    jacobian = found.jacobian[:, places]
    deviations: Array = np.sqrt(np.diag(np.linalg.pinv(jacobian.T @ jacobian)))
    return deviations


def _inflation(found: Fit, places: list[int]) -> Array:
    """Factors by which correlated residuals inflate variances of parameters; 1 or more."""
    jacobian = found.jacobian[:, places]
    period = np.median(np.diff(found.series[0].stamps))
    begins = np.arange(0, len(jacobian), max(round(_BLOCK / period), 1))
    scores = np.add.reduceat(jacobian * found.residuals[:, None], begins)
    inverse = np.linalg.pinv(jacobian.T @ jacobian)
    robust = np.diag(inverse @ (scores.T @ scores) @ inverse)
    inflation: Array = np.maximum(robust / np.maximum(np.diag(inverse), 1e-300), 1.0)
    return inflation
