"""Model of a robot along one axis, ahead or turning: response to commands, noise of odometry.

Response: with a delay ``D``, a scale ``k`` and limits, the speed ``v`` follows the command ``u`` as

    T1 dy/dt = clip(k u(t - D), -v_max, v_max) - y,    |dy/dt| <= a_max
    T2 dv/dt = y - v,                                  T1 + T2 = lag,  T2 < T1

Between two changes of the command this has a closed form: the delay is continuous, and nothing is
integrated in steps. ``T2`` is a motor behind the lag, without which the delay would seem longer.

Noise: a step of odometry has the noise of both of its poses, and a random walk between them. With
the variance ``s^2`` of a pose and ``q`` of the walk, both of maximum likelihood, the covariance of
the steps is ``C = tridiag(-s^2, 2 s^2 + q dt, -s^2)``.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from scipy.linalg.lapack import dpbtrf, dtbtrs
from scipy.optimize import minimize

from cmpsp_ros.arrays import Array, BoolArray

_SHORTEST: Final = 1e-5  # time constant that stands for none [s]
_BEFORE: Final = 1e6  # time for which the first command has been in effect [s]


@dataclass(frozen=True)
class Response:
    """Parameters of a response: ``D``, ``T1 + T2``, ``T2 / T1``, ``k``, ``v_max`` and ``a_max``."""

    delay: float = 0.0
    lag: float = 0.0
    ratio: float = 0.0
    scale: float = 1.0
    max_speed: float = math.inf
    max_acceleration: float = math.inf

    def travel(self, changes: Array, commands: Array, stamps: Array) -> tuple[Array, Array]:
        """Distance since the first change, and speed, at instants ``stamps`` [s], both ``(N,)``.

        Commands ``(C,)`` [m/s] or [rad/s] hold from ascending ``changes`` ``(C,)`` [s] on;
        before the first one the robot moves steadily at the first.
        """
        first = max(self.lag / (1.0 + self.ratio), _SHORTEST)
        second = max(self.ratio * first, 0.1 * _SHORTEST)
        pieces = np.array(self._pieces(changes.tolist(), commands.tolist(), first, second))
        index = np.maximum(np.searchsorted(pieces[:, 0], stamps, side='right') - 1, 0)
        begin, *piece = pieces[index].T
        since = np.maximum(stamps - begin, 0.0)
        slow, fast = np.exp(-since / first), np.exp(-since / second)
        return _advance(since, slow, fast, piece, first, second)

    def _pieces(
        self, changes: list[float], commands: list[float], first: float, second: float
    ) -> list[tuple[float, ...]]:
        """Pieces with ``y = c + b t + g exp(-t/T1)``: begin, c, b, g, distance and speed there."""
        begins = [change + self.delay for change in changes]
        y = self._target(commands[0])
        pieces: list[tuple[float, ...]] = [(begins[0] - _BEFORE, y, 0.0, 0.0, -_BEFORE * y, y)]
        for now, command, after in zip(begins, commands, [*begins[1:], math.inf], strict=True):
            target = self._target(command)
            y, *at = _at(pieces[-1], now, first, second)
            gap, reach = target - y, self.max_acceleration * first
            if abs(gap) > reach:
                # The limit holds until the lag alone closes the gap no faster.
                slope = math.copysign(self.max_acceleration, gap)
                pieces.append((now, y, slope, 0.0, *at))
                now += (abs(gap) - reach) / self.max_acceleration  # noqa: PLW2901
                y, *at = _at(pieces[-1], now, first, second)
            if now < after:
                pieces.append((now, target, 0.0, y - target, *at))
        return pieces

    def _target(self, command: float) -> float:
        return min(max(self.scale * command, -self.max_speed), self.max_speed)


def _at(piece: tuple[float, ...], now: float, first: float, second: float) -> list[float]:
    """``y``, distance and speed at an instant of a piece."""
    begin, c, b, g, *_ = piece
    since = now - begin
    slow, fast = math.exp(-since / first), math.exp(-since / second)
    return [c + b * since + g * slow, *_advance(since, slow, fast, piece[1:], first, second)]


def _advance(
    since: Any, slow: Any, fast: Any, piece: Sequence[Any], first: float, second: float
) -> tuple[Any, Any]:
    """Distance and speed on a piece; ``slow`` and ``fast`` remain of both transients."""
    c, b, g, distance, speed = piece
    g = g / (1.0 - second / first)
    h = speed - c + b * second - g
    travelled = distance + (c - b * second) * since + 0.5 * b * since * since
    travelled = travelled + g * first * (1.0 - slow) + h * second * (1.0 - fast)
    return travelled, c + b * (since - second) + g * slow + h * fast


# Residuals of the steps of each drive, durations of the steps [s], and flags of jumps.
Steps = Sequence[tuple[Array, Array, BoolArray]]
_FLOOR: Final = 1e-5  # standard deviation of a pose that is always allowed for [m] or [rad]
_JUMP: Final = 1e6  # variance of a jump, which thereby does not count [m^2] or [rad^2]


@dataclass(frozen=True)
class Noise:
    """Standard deviations of a pose [m] or [rad], and of its growth in a second."""

    pose: float
    walk: float

    def factor(self, durations: Array, jumps: BoolArray) -> Array:
        """Cholesky factor of the covariance of steps, in bands ``(2, N)``."""
        variance = self.pose**2 + _FLOOR**2
        bands = np.full((2, len(durations)), -variance)
        bands[0] = 2.0 * variance + self.walk**2 * durations + _JUMP * jumps
        return np.asarray(dpbtrf(bands, lower=1)[0])

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
    return np.asarray(dtbtrs(factor, steps[:, None], uplo='L')[0][:, 0])


def log_determinant(factor: Array) -> float:
    """Logarithm of the determinant of a covariance."""
    return 2.0 * float(np.log(factor[0]).sum())


def jumps_in(factor: Array) -> BoolArray:
    """Flags of the steps that count as jumps in a covariance."""
    jumps: BoolArray = factor[0] ** 2 > _JUMP / 2.0
    return jumps
