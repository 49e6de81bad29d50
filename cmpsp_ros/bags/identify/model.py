"""Model of a robot along one axis, ahead or turning, and its fit to drives.

Response: with a delay ``D``, a scale ``k`` and limits, the speed ``v`` follows the command ``u`` as

    T1 dy/dt = clip(k u(t - D), -v_max, v_max) - y,    |dy/dt| <= a_max
    T2 dv/dt = y - v,                                  T1 + T2 = lag,  T2 < T1

Between two changes of the command this has a closed form: the delay is continuous, and nothing is
integrated in steps. ``T2`` is a motor behind the lag, without which the delay would seem longer.

Noise: a step of odometry has the noise of both of its poses, and a random walk between them. With
the variance ``s^2`` of a pose and ``q`` of the walk, both of maximum likelihood, the covariance of
the steps is ``C = tridiag(-s^2, 2 s^2 + q dt, -s^2)``.

Fit: the distances and turns from each odometry message to the next are predicted, and compared: no
pose is taken for true. Of the residuals, whitened by the noise of odometry, the sum of squares is
least; noise and parameters are found in turns.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Final

import numpy as np
from scipy.linalg.lapack import dpbtrf, dtbtrs
from scipy.optimize import least_squares, minimize

from cmpsp_ros.arrays import Array, BoolArray
from cmpsp_ros.bags.identify.drives import TIMEOUTS, Drive, Series

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


# Places of parameters: delay with lag, lag, ratio, two scales, and limits that were found.
SUM, LAG, RATIO, SCALE, LIMIT = 0, 1, 2, 3, 5

# Sizes of the parameters, to scale steps of the fit.
_SIZES: Final = np.array([0.01, 0.01, 0.1, 0.1, 0.1, 0.1])
# Standard deviations beyond which a step is a jump of odometry, and does not count.
_FAR_OFF: Final = 6.0
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
                jumps = factor[0] ** 2 > _JUMP / 2.0
                off = np.abs(whitened(factor, residuals)) > _FAR_OFF
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
