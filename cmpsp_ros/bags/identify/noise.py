"""Noise of odometry along one axis, from what a model leaves of its steps.

From one message to the next there is the noise of both poses, and what is added on the way. With
the variance ``s^2`` of a pose and ``q`` of a random walk the covariance of the steps is

    C = tridiag(-s^2, 2 s^2 + q dt, -s^2),

and both are those of maximum likelihood.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.lapack import dpbtrf, dtbtrs
from scipy.optimize import minimize

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
Steps = Sequence[tuple[Array, Array, Flags]]
"""What a model leaves of the steps of each drive, their durations [s], and which are jumps."""

_FLOOR: Final = 1e-5
"""Standard deviation of a pose that is always allowed for [m] or [rad]."""

_UNKNOWN: Final = 1e6
"""Variance of a jump [m^2] or [rad^2]."""


@dataclass(frozen=True)
class Noise:
    """Noise of odometry along one axis.

    Attributes:
        pose: Standard deviation of a pose [m] or [rad].
        walk: Of what is added in a second [m/s^0.5] or [rad/s^0.5].
    """

    pose: float
    walk: float

    def factor(self, durations: Array, jumps: Flags) -> Array:
        """Cholesky factor of the covariance of steps, in bands ``(2, N)``."""
        variance = self.pose**2 + _FLOOR**2
        bands = np.empty((2, len(durations)))
        bands[0] = 2.0 * variance + self.walk**2 * durations + _UNKNOWN * jumps
        bands[1] = -variance
        factor: Array = dpbtrf(bands, lower=1)[0]
        return factor

    def cost(self, steps: Steps) -> float:
        """Minus twice the logarithm of the likelihood of steps."""
        total = 0.0
        for left, durations, jumps in steps:
            factor = self.factor(durations, jumps)
            white = whitened(factor, left)
            total += float(white @ white) + volume(factor)
        return total

    def fitted(self, steps: Steps) -> Noise:
        """The noise that steps have, looked for from here."""
        starts = [self, _moments(steps)]
        return min((each.nearest(steps) for each in starts), key=lambda one: one.cost(steps))

    def nearest(self, steps: Steps) -> Noise:
        """The local maximum of the likelihood that is reached from here."""
        start = np.log([max(self.pose, _FLOOR), max(self.walk, _FLOOR)])
        found = minimize(
            lambda logs: Noise(*np.exp(logs)).cost(steps),
            start,
            method='Nelder-Mead',
            options={'xatol': 0.02},
        )
        return Noise(*np.exp(found.x).tolist())

    def possible(self, steps: Steps, quantile: float) -> tuple[float, float]:
        """Standard deviations of a pose between which it is, by their likelihood."""
        walks = self.walk * np.geomspace(0.1, 10.0, 9)
        poses = np.array([0.0, *self.pose * np.geomspace(0.6, 1.6, 51)])
        costs = [min(Noise(pose, walk).cost(steps) for walk in walks) for pose in poses]
        possible = poses[np.array(costs) - min(costs) <= quantile**2]
        return max(float(possible[0]) - 2.0 * _FLOOR, 0.0), float(possible[-1]) + 2.0 * _FLOOR


def _moments(steps: Steps) -> Noise:
    """Noise by the correlation of neighbouring steps."""
    kept = [(left[~jumps], durations.mean()) for left, durations, jumps in steps]
    own = float(np.mean(np.concatenate([left**2 for left, _ in kept])))
    next_to = float(np.mean(np.concatenate([left[1:] * left[:-1] for left, _ in kept])))
    walk = max(own + 2.0 * next_to, 0.01 * own) / kept[0][1]
    return Noise(math.sqrt(max(-next_to, 0.01 * own)), math.sqrt(walk))


def whitened(factor: Array, steps: Array) -> Array:
    """Steps in units of their standard deviations, without correlation."""
    white: Array = dtbtrs(factor, steps[:, None], uplo='L')[0][:, 0]
    return white


def volume(factor: Array) -> float:
    """Logarithm of the determinant of a covariance."""
    return 2.0 * float(np.log(factor[0]).sum())


def are_jumps(factor: Array) -> Flags:
    """Which steps were taken for jumps in a covariance."""
    jumps: Flags = factor[0] ** 2 > _UNKNOWN / 2.0
    return jumps
