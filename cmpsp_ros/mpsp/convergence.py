"""Rate of convergence (60), measured on the tail of a run."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from cmpsp_ros.arrays import Array, BoolArray, IntArray

_LEAST_POINTS = 4
_TAIL = 20
# An error is worth a point only if it is this much larger than the uncertainty of the optimum.
_MARGIN = 10.0
# Rounding of a control that went through a whole iteration, relative to the control history.
_ROUNDING = 1e-12


class HasControls(Protocol):
    """An iterate or the record of one."""

    @property
    def U(self) -> Array:
        """Controls, shape ``(N + 1, r)``."""


@dataclass(frozen=True)
class Convergence:
    """Estimated Q-linear convergence (60) of a sequence of iterates.

    The rate is the slope of ``log |U^i - U*|`` over ``i`` by least squares on the tail: the last
    half (4 to 20 of them) of the iterates whose error is at least ten times the uncertainty of
    ``U*`` and rounding (1e-12 of the controls). The interval is Student's, at 95 %, from the
    scatter about that line.

    Limits: without a given ``U*`` the last iterate stands for it, whose own error is taken to be
    ``s r / (1 - r)`` with ``s`` the last step and ``r`` the rate of the steps; iterates as near as
    ten times that are left out. So a slow run must go on for some iterations beyond the error of
    interest. The interval covers scatter, not a rate that still changes: superlinear convergence
    shows as too few points, or as errors that fall below the line at its end.

    Attributes:
        errors: ``|U^i - U*|``, one for each iterate.
        used: Indices of the iterates on the line; empty where there is no rate.
        rate: ``r``; None without one.
        interval: Confidence interval of the rate; None without one.
        gamma: Least constant of (90) that holds on the tail; None without one.
        sentence: The result in words, or why there is none.
    """

    errors: Array
    used: tuple[int, ...]
    rate: float | None
    interval: tuple[float, float] | None
    gamma: float | None
    sentence: str

    @classmethod
    def of(cls, iterates: Sequence[HasControls], optimum: Array | None = None) -> Convergence:
        """Estimate the rate from the iterates or records of one run, the guess first.

        `optimum` is ``U*``, shape ``(N + 1, r)``; None for the last iterate.
        """
        U = np.array([iterate.U for iterate in iterates])
        if len(U) < _LEAST_POINTS:
            return cls._cannot_tell(np.zeros(len(U)), f'{len(U)} iterates are too few')
        target = U[-1] if optimum is None else optimum
        errors = np.linalg.norm((U - target).reshape(len(U), -1), axis=1)
        steps = np.linalg.norm(np.diff(U, axis=0).reshape(len(U) - 1, -1), axis=1)
        rounding = _ROUNDING * float(np.linalg.norm(target) or errors.max())
        blur = rounding if optimum is not None else _error_of_last(steps, rounding)
        if not np.isfinite(blur):
            return cls._cannot_tell(errors, 'the steps do not become shorter')
        clear = _last_run(errors > _MARGIN * blur)
        # The first half is on the way to the neighbourhood in which the rate is one.
        tail = clear[-min(_TAIL, max(_LEAST_POINTS, len(clear) // 2)) :]
        if len(tail) < _LEAST_POINTS:
            return cls._cannot_tell(
                errors, f'{len(tail)} errors stand clear of rounding and of that of U*'
            )
        slope, half = _slope(tail, np.log(errors[tail]))
        rate = math.exp(slope)
        interval = math.exp(slope - half), math.exp(slope + half)
        if interval[1] >= 1.0:
            return cls._cannot_tell(
                errors, f'a rate of {rate:.3g} is not known to be below 1 ({interval[1]:.3g})'
            )
        gamma = math.exp(float((np.log(errors[tail]) - slope * tail).max()))
        sentence = (
            f'Q-linear at {rate:.3g} an iteration (95 %: {interval[0]:.3g} to {interval[1]:.3g}), '
            f'from iterations {tail[0]} to {tail[-1]}.'
        )
        return cls(errors, tuple(tail.tolist()), rate, interval, gamma, sentence)

    @classmethod
    def _cannot_tell(cls, errors: Array, reason: str) -> Convergence:
        return cls(errors, (), None, None, None, f'The rate cannot be determined: {reason}.')

    def iterations_for(self, error: float) -> int | None:
        """Iterations after which (90) puts ``|U^i - U*|`` at `error` = ``zeta`` or below.

        ``log(zeta / gamma) / log r``, rounded up; None without a rate.
        """
        if self.rate is None or self.gamma is None:
            return None
        return max(0, math.ceil(math.log(error / self.gamma) / math.log(self.rate)))


def _error_of_last(steps: Array, rounding: float) -> float:
    """Distance left after the last iterate, as a geometric series of steps."""
    clear = _last_run(steps > _MARGIN * rounding)[-_TAIL:]
    if len(clear) < len(steps) and not steps[-1] > _MARGIN * rounding:
        return rounding
    if len(clear) < _LEAST_POINTS - 1:
        return math.inf
    rate = math.exp(_slope(clear, np.log(steps[clear]))[0])
    return float(steps[-1] * rate / (1.0 - rate)) if rate < 1.0 else math.inf


def _last_run(wanted: BoolArray) -> IntArray:
    """Indices of the last unbroken run of True."""
    indices = np.flatnonzero(wanted)
    breaks = np.flatnonzero(np.diff(indices) > 1)
    return indices[breaks[-1] + 1 :] if len(breaks) else indices


def _slope(x: IntArray, y: Array) -> tuple[float, float]:
    """Slope of a regression line, and half the width of its confidence interval."""
    from scipy.stats import linregress, t  # noqa: PLC0415 (slow to import, and seldom asked for)

    line = linregress(x, y)
    return float(line.slope), float(t.ppf(0.975, len(x) - 2) * line.stderr)
