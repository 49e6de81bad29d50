"""Fit of a response to drives.

The distances and turns from each odometry message to the next are predicted, and compared: no pose
is taken for true. Of the residuals, whitened by the noise of odometry, the sum of squares is least;
noise and parameters are found in turns.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np
from scipy.optimize import least_squares

from cmpsp_ros.arrays import Array
from cmpsp_ros.bags.identify.drives import TIMEOUTS, Drive, Series
from cmpsp_ros.bags.identify.model import (
    Noise,
    Response,
    Steps,
    jumps_in,
    log_determinant,
    whitened,
)

# Places of parameters: delay with lag, lag, ratio, two scales, and limits that were found.
SUM, LAG, RATIO, SCALE, LIMIT = 0, 1, 2, 3, 5

# Sizes of the parameters, to scale steps of the fit.
_SIZES: Final = np.array([0.01, 0.01, 0.1, 0.1, 0.1, 0.1])
# Standard deviations beyond which a step is a jump of odometry, and does not count.
_JUMP: Final = 6.0
_MOTOR: Final = 0.02  # time constant of a motor behind the lag: standard deviation of its prior [s]
_LONGEST: Final = 1.2  # longest delay that is looked for [s]
_EVIDENCE: Final = 30.0  # least fall of the sum of squares for which a limit is accepted
# Part of what is reached without a limit, below which the limit must be.
_BELOW: Final = {'max_acceleration': 0.8, 'max_speed': 0.97}


@dataclass(frozen=True)
class Fit:
    """A model with the parameters that fit best."""

    series: Sequence[Series]  # steps and commands, of each drive and axis
    timeout: float  # time after which the robot stops without a command [s]
    p: Array  # parameters
    noises: tuple[Noise, Noise]  # noise of odometry ahead and turning
    factors: Sequence[Array]  # of the covariance of the steps of each series
    # Limits that are among the parameters: axis, and field of `Response`.
    limits: tuple[tuple[int, str], ...] = ()
    # Whitened, and that of the prior of a motor.
    residuals: Array = field(default_factory=lambda: np.empty(0))
    jacobian: Array = field(default_factory=lambda: np.empty((0, 0)))  # their derivatives

    @property
    def axes(self) -> list[int]:
        """Axes along which there were commands."""
        return sorted({each.axis for each in self.series if each.commands.any()})

    @property
    def misfit(self) -> float:
        """Sum of squares of the residuals."""
        return float(self.residuals @ self.residuals)

    def response(self, axis: int, p: Array | None = None) -> Response:
        """Response along an axis."""
        p = self.p if p is None else p
        found = Response(p[SUM] - p[LAG], p[LAG], p[RATIO], p[SCALE + axis])
        for (limited, name), value in zip(self.limits, p[LIMIT:], strict=True):
            found = replace(found, **{name: value}) if limited == axis else found
        return found

    def step_residuals(self, p: Array | None = None) -> list[Array]:
        """Residuals of the steps of each series: measured minus predicted."""
        responses = [self.response(axis, p) for axis in (0, 1)]
        return [
            each.steps - np.diff(responses[each.axis].travel(*each.command, each.stamps)[0])
            for each in self.series
        ]

    def solved(self, start: Array, fixed: Sequence[int] = ()) -> Fit:
        """The best fit of the same weights, from a start on and with some parameters fixed."""
        unknown = [SCALE + axis for axis in (0, 1) if axis not in self.axes]
        free = np.setdiff1d(np.arange(len(start)), [*fixed, *unknown])
        p = start.copy()

        def residuals(values: Array) -> Array:
            p[free] = values
            motor = p[RATIO] * p[LAG] / (1.0 + p[RATIO])
            white = map(whitened, self.factors, self.step_residuals(p))
            return np.concatenate([*white, [motor / _MOTOR]])

        lower, upper = np.full(len(p), 1e-3), np.full(len(p), np.inf)
        lower[:LIMIT], upper[:LIMIT] = (-1.0, 1e-4, 0.0, -9.0, -9.0), (3.0, 3.0, 0.9, 9.0, 9.0)
        found = least_squares(
            residuals,
            np.clip(start[free], lower[free] + 1e-9, upper[free]),
            bounds=(lower[free], upper[free]),
            x_scale=_SIZES[free.clip(max=LIMIT)],
            ftol=1e-6,
            xtol=1e-6,
        )
        jacobian = np.zeros((len(found.fun), len(p)))
        jacobian[:, free], p[free] = found.jac, found.x
        return replace(self, p=p.copy(), residuals=found.fun, jacobian=jacobian)

    def converged(self) -> Fit:
        """The best fit, with the noise that it leaves."""
        found = self.solved(self.p)
        for _ in range(3):
            noises = [each.fitted(found.steps(axis)) for axis, each in enumerate(found.noises)]
            factors: list[Array] = [np.empty(0)] * len(found.series)
            for axis, noise in enumerate(noises):
                own = [k for k, each in enumerate(found.series) if each.axis == axis]
                for k, (_, durations, jumps) in zip(own, found.steps(axis), strict=True):
                    factors[k] = noise.factor(durations, jumps)
            found = replace(found, noises=(noises[0], noises[1]), factors=factors)
            found = found.solved(found.p)
        return found

    def steps(self, axis: int, steady: float = 1.0) -> Steps:
        """Residuals of the steps along an axis, with flags of apparent jumps.

        Steps above a `steady` part of the highest acceleration count as jumps, too.
        """
        found = []
        for each, residuals, factor in zip(
            self.series, self.step_residuals(), self.factors, strict=True
        ):
            if each.axis == axis:
                jumps = jumps_in(factor)
                off = np.abs(whitened(factor, residuals)) > _JUMP
                # Samples after a jump look like jumps too as long as the jump counts.
                jumps[off.argmax()] |= off.any()
                rates = np.abs(self._rates(each))
                jumps |= rates > steady * rates.max()
                found.append((residuals, np.diff(each.stamps), jumps))
        return found

    def reached(self, axis: int, name: str) -> float:
        """Speed or acceleration that was reached along an axis, as predicted."""
        own = [each for each in self.series if each.axis == axis]
        find = self._speeds if name == 'max_speed' else self._rates
        return float(max(np.abs(find(each)).max() for each in own))

    def _speeds(self, series: Series) -> Array:
        return self.response(series.axis).travel(*series.command, series.stamps)[1]

    def _rates(self, series: Series) -> Array:
        return np.diff(self._speeds(series)) / np.diff(series.stamps)


def fit(drives: Sequence[Drive]) -> Fit:
    """Fit one robot to all drives."""
    timeouts = TIMEOUTS if any(each.pauses for each in drives) else TIMEOUTS[:1]
    fits = [_initial(drives, each).converged() for each in timeouts]
    best = min(fits, key=lambda one: one.misfit + sum(map(log_determinant, one.factors)))
    for limit in [(axis, name) for axis in best.axes for name in _BELOW]:
        reached, limits = best.reached(*limit), (*best.limits, limit)
        starts = [np.append(best.p, part * reached + 1e-2) for part in (0.8, 0.4)]
        tried = [replace(best, limits=limits).solved(each) for each in starts]
        limited = min(tried, key=lambda one: one.misfit)
        is_seen = limited.p[-1] < _BELOW[limit[1]] * reached
        if is_seen and limited.misfit < best.misfit - _EVIDENCE:
            best = limited.converged()
    return best


def _initial(drives: Sequence[Drive], timeout: float) -> Fit:
    series = [each.series(axis, timeout) for each in drives for axis in (0, 1)]
    noise, least, best = Noise(3e-3, 1e-2), math.inf, np.empty(0)
    factors = [noise.factor(np.diff(each.stamps), each.leaps) for each in series]
    seen = [whitened(factor, each.steps) for factor, each in zip(factors, series, strict=True)]
    begun = Fit(series, timeout, np.array([0.0, 0.1, 0.1, 1.0, 1.0]), (noise, noise), factors)
    for together in np.arange(-0.1, _LONGEST, 0.04):
        p = begun.p.copy()
        p[SUM], off = together, 0.0
        white = list(map(whitened, factors, begun.step_residuals(p)))
        for axis in begun.axes:
            own = [k for k, each in enumerate(series) if each.axis == axis]
            measured = np.concatenate([seen[k] for k in own])
            predicted = measured - np.concatenate([white[k] for k in own])
            p[SCALE + axis] = measured @ predicted / max(predicted @ predicted, 1e-12)
            off += float(np.sum((measured - p[SCALE + axis] * predicted) ** 2))
        if off < least:
            best, least = p, off
    return replace(begun, p=best)
