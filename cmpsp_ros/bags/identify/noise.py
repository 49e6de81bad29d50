"""Noise of odometry along one axis, from the residuals of its steps.

From one message to the next there is the noise of both poses, and what is added on the way. With
the variance ``s^2`` of a pose and ``q`` of a random walk, both of maximum likelihood, the
covariance of the steps is ``C = tridiag(-s^2, 2 s^2 + q dt, -s^2)``.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.linalg.lapack import dpbtrf, dtbtrs
from scipy.optimize import minimize

from cmpsp_ros.arrays import Array, BoolArray

Flags = BoolArray
Steps = Sequence[tuple[Array, Array, Flags]]
"""Residuals of the steps of each drive, durations of the steps [s], and flags of jumps."""

_FLOOR: Final = 1e-5
"""Standard deviation of a pose that is always allowed for [m] or [rad]."""

_JUMP: Final = 1e6
"""Variance of a jump, which thereby does not count [m^2] or [rad^2]."""


@dataclass(frozen=True)
class Noise:
    """Standard deviations of a pose [m] or [rad], and of what a second adds to it."""

    pose: float
    walk: float

    def factor(self, durations: Array, jumps: Flags) -> Array:
        """Cholesky factor of the covariance of steps, in bands ``(2, N)``."""
        variance = self.pose**2 + _FLOOR**2
        bands = np.full((2, len(durations)), -variance)
        bands[0] = 2.0 * variance + self.walk**2 * durations + _JUMP * jumps
        factor: Array = dpbtrf(bands, lower=1)[0]
        return factor

    def cost(self, steps: Steps) -> float:
        """Minus twice the logarithm of the likelihood of steps."""
        total = 0.0
        for residuals, durations, jumps in steps:
            factor = self.factor(durations, jumps)
            total += float(np.sum(whitened(factor, residuals) ** 2)) + log_determinant(factor)
        return total

    def fitted(self, steps: Steps) -> Noise:
        """The noise that steps have, looked for from here and from their correlation."""
        kept = [residuals[~jumps] for residuals, _, jumps in steps]
        own = float(np.mean(np.concatenate(kept) ** 2))
        beside = float(np.mean(np.concatenate([each[1:] * each[:-1] for each in kept])))
        walk = max(own + 2.0 * beside, 0.01 * own) / float(np.mean(steps[0][1]))
        starts = (self.pose, self.walk), (math.sqrt(max(-beside, 0.01 * own)), math.sqrt(walk))
        found = [
            minimize(
                lambda logs: Noise(*np.exp(logs)).cost(steps),
                np.log(np.maximum(start, _FLOOR)),
                method='Nelder-Mead',
                options={'xatol': 0.02},
            )
            for start in starts
        ]
        return Noise(*np.exp(min(found, key=lambda one: one.fun).x).tolist())

    def interval(self, steps: Steps, quantile: float) -> tuple[float, float]:
        """Interval of the standard deviation of a pose, by the profile of the likelihood."""
        walks = self.walk * np.geomspace(0.1, 10.0, 9)
        poses = np.array([0.0, *self.pose * np.geomspace(0.6, 1.6, 51)])
        costs = [min(Noise(pose, walk).cost(steps) for walk in walks) for pose in poses]
        possible = poses[np.array(costs) - min(costs) <= quantile**2]
        return max(float(possible[0]) - 2.0 * _FLOOR, 0.0), float(possible[-1]) + 2.0 * _FLOOR


def whitened(factor: Array, steps: Array) -> Array:
    """Steps in units of their standard deviations, without correlation."""
    white: Array = dtbtrs(factor, steps[:, None], uplo='L')[0][:, 0]
    return white


def log_determinant(factor: Array) -> float:
    """Logarithm of the determinant of a covariance."""
    return 2.0 * float(np.log(factor[0]).sum())


def jumps_in(factor: Array) -> Flags:
    """Flags of the steps that count as jumps in a covariance."""
    jumps: Flags = factor[0] ** 2 > _JUMP / 2.0
    return jumps
