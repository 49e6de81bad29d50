"""Estimates for a robot after a drive, with intervals or the reason why there is none."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from cmpsp_ros.arrays import Array
from cmpsp_ros.bags.identify.drives import Drive
from cmpsp_ros.bags.identify.model import LAG, LIMIT, RATIO, SCALE, SUM, Fit, fit

# Quantile of 99 %, to keep 95 % although noise is estimated and no robot is quite the model.
QUANTILE: Final = 2.58
_BLOCK: Final = 0.5
_BISECTIONS: Final = 5
_BETTER: Final = 0.1

# Least half widths: of delay with lag [s], of either by itself [s], and of scales.
_TICK, _TRADE, _CALIBRATION = 1e-3, 2e-3, 2e-3


@dataclass(frozen=True)
class Interval:
    """An estimate with the interval that has the true value in 95 of 100 cases, or more."""

    value: float
    low: float
    high: float

    def shifted(self, by: float) -> Interval:
        """The interval moved up."""
        return Interval(self.value + by, self.low + by, self.high + by)

    def __str__(self) -> str:
        return f'{self.value:.4g} ({self.low:.4g} to {self.high:.4g})'


def delay_and_lag(found: Fit) -> tuple[Fit, Interval, Interval, Interval]:
    """Intervals of delay, lag and both together [s], after the fit, or a better one."""
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
    return np.asarray(np.sqrt(np.diag(np.linalg.pinv(jacobian.T @ jacobian))))


def _inflation(found: Fit, places: list[int]) -> Array:
    """Factors by which correlated residuals inflate variances of parameters; 1 or more."""
    jacobian = found.jacobian[:, places]
    period = np.median(np.diff(found.series[0].stamps))
    begins = np.arange(0, len(jacobian), max(round(_BLOCK / period), 1))
    scores = np.add.reduceat(jacobian * found.residuals[:, None], begins)
    inverse = np.linalg.pinv(jacobian.T @ jacobian)
    robust = np.diag(inverse @ (scores.T @ scores) @ inverse)
    return np.asarray(np.maximum(robust / np.maximum(np.diag(inverse), 1e-300), 1.0))


# Names of the axes with units of their speeds, and of their poses.
AXES: Final = (('linear', 'm/s', 'position', 'm'), ('angular', 'rad/s', 'heading', 'rad'))

# Standard deviations of a median's rank: more than elsewhere, for neighbours are late together.
_RANK: Final = 3.0
# Width of an interval above which a figure is unknown: of times [s], and of scales by value.
_WIDEST: Final = 0.3


_STEADY: Final = 0.2  # part of the highest acceleration below which noise is measured


@dataclass(frozen=True)
class Estimate:
    """One figure; without an interval, the remark says why it is not identifiable."""

    name: str
    unit: str
    interval: Interval | None
    remark: str = ''


@dataclass(frozen=True)
class Identification:
    """An identified robot: drives, model, estimates by key, and earlier parameters."""

    drives: Sequence[Drive]
    fit: Fit
    estimates: Mapping[str, Estimate]
    nominal: Mapping[str, Any]


def identification(drives: Sequence[Drive], nominal: Mapping[str, Any]) -> Identification:
    """Identify one robot from all drives."""
    found, *times = delay_and_lag(fit(drives))
    rows = dict([*_response(found, drives, times), *_odometry(found, drives)])
    return Identification(drives, found, rows, nominal)


def _response(
    found: Fit, drives: Sequence[Drive], times: Sequence[Interval]
) -> Iterator[tuple[str, Estimate]]:
    problem = _problem(found)
    delay, lag, together = times
    age = float(np.mean([each.age for each in drives]))
    answers = [each.answer for each in drives if each.answer is not None]
    answered = together.shifted(float(np.mean(answers)) if answers else 0.0)
    remark = 'lag and age of odometry included'
    for key, name, interval, said in (
        ('delay', 'delay of a command', delay.shifted(-age), 'by the clocks of bag and robot'),
        ('lag', 'wheel lag', lag, 'time constant, first order'),
        ('together', 'delay and lag together', together.shifted(-age), ''),
        ('command_delay', 'command_delay', answered, remark if answers else f'{remark}, not'
         ' the time of a control step'),
    ):  # fmt: skip
        yield key, _estimate(name, 's', interval, problem, said)
    fitted = {limit: LIMIT + place for place, limit in enumerate(found.limits)}
    for axis, (name, unit, _, _) in enumerate(AXES):
        why = problem if axis in found.axes else f'there was no {name} command'
        scale = parameter_interval(found, SCALE + axis)
        yield f'{name}_scale', _estimate(f'{name} scale', '', scale, why, 'driven by commanded')
        for kind, units in (('speed', unit), ('acceleration', f'{unit}^2')):
            limit = axis, f'max_{kind}'
            reached = f'not reached, up to {found.reached(*limit):.3g} {units}'
            found_limit = parameter_interval(found, fitted[limit]) if limit in fitted else None
            said = 'was reached' if found_limit else f'not identifiable: {why or reached}'
            yield f'{name}_{kind}', Estimate(f'{name} {kind} limit', units, found_limit, said)
    if math.isfinite(found.timeout):
        timeout = Interval(found.timeout, found.timeout, found.timeout)
        yield 'timeout', Estimate('command timeout', 's', timeout, 'nearest of usual ones')


def _problem(found: Fit) -> str:
    """Reason why no parameter of the response is identifiable; empty if there is none."""
    if not found.axes:
        return 'the commands were 0 throughout'
    if all(len(each.changes) < 3 for each in found.series):
        return 'the commands never changed'
    if all(parameter_interval(found, SCALE + axis).low <= 0.0 for axis in found.axes):
        return 'the robot did not follow the commands'
    return ''


def _estimate(name: str, unit: str, interval: Interval, problem: str, remark: str) -> Estimate:
    if problem:
        return Estimate(name, unit, None, f'not identifiable: {problem}')
    if interval.high - interval.low > _WIDEST * (1.0 if unit else abs(interval.value)):
        between = f'{interval.low:.3g} to {interval.high:.3g} {unit}'.rstrip()
        said = f'not identifiable: too little excitation, anything from {between}'
        return Estimate(name, unit, None, said)
    return Estimate(name, unit, interval, remark)


def _odometry(found: Fit, drives: Sequence[Drive]) -> Iterator[tuple[str, Estimate]]:
    durations = np.concatenate([np.diff(each.stamps) for each in drives])
    # Gaps are no part of the rate, but jitter is.
    periods = durations[durations < 1.5 * np.median(durations)]
    mean, spread = periods.mean(), _RANK * periods.std() / math.sqrt(len(periods))
    rate = Interval(*(float(1.0 / each) for each in (mean, mean + spread, mean - spread)))
    said = f'longest gap {1e3 * durations.max():.0f} ms'
    yield 'rate', Estimate('odometry rate', 'Hz', rate, said)
    ages = np.concatenate([each.ages for each in drives])
    said = f'{1e3 * ages.min():.1f} to {1e3 * ages.max():.1f} ms'
    if ages.min() < 0.0:
        said += f': the clock of the robot is ahead by {-1e3 * ages.min():.1f} ms or more'
    yield 'age', Estimate('odometry age when received', 's', _median(ages), said)
    for axis, (_, _, kind, unit) in enumerate(AXES):
        # Where a robot speeds up, errors of the model look like noise.
        steps = found.steps(axis, _STEADY)
        noise = found.noises[axis].fitted(steps)
        interval = Interval(noise.pose, *noise.interval(steps, QUANTILE))
        yield kind, Estimate(f'{kind} noise', unit, interval, 'standard deviation')


def _median(values: Array) -> Interval:
    ordered, middle = np.sort(values), len(values) / 2.0
    away = _RANK * math.sqrt(middle / 2.0)
    low, high = max(math.floor(middle - away), 0), min(math.ceil(middle + away), len(values) - 1)
    return Interval(float(np.median(ordered)), float(ordered[low]), float(ordered[high]))
