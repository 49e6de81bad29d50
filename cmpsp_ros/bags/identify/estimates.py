"""Everything that is said about a robot after a drive: figures, intervals, and what is unknown."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from cmpsp_ros.bags.identify.drives import Drive
from cmpsp_ros.bags.identify.fit import LIMIT, SCALE, Fit, fit, reached_by
from cmpsp_ros.bags.identify.intervals import QUANTILE, Interval, Times, interval_of, times_of

Array = NDArray[np.float64]

AXES: Final = (('linear', 'm/s', 'm'), ('angular', 'rad/s', 'rad'))
"""Names of the axes, and units of speed and distance."""

_QUANTILE: Final = 3.0
"""Standard deviations of a rank: more than 1.96, for neighbours are late together."""

_MOST_OFF: Final = {'s': 0.15, '': 0.2}
"""Half widths of intervals, times [s] and scales, above which a figure counts as unknown."""


@dataclass(frozen=True)
class Estimate:
    """One figure.

    Attributes:
        name: Name for a reader.
        unit: Unit.
        interval: Value and interval; None if it is not identifiable.
        remark: Why it is not, or what has to be known of it.
    """

    name: str
    unit: str
    interval: Interval | None
    remark: str = ''


@dataclass(frozen=True)
class Identification:
    """A robot that was identified.

    Attributes:
        drives: What was recorded.
        fit: The model that fits best.
        estimates: By name of the figure, in order of the table.
        nominal: Parameters that were known before.
    """

    drives: Sequence[Drive]
    fit: Fit
    estimates: Mapping[str, Estimate]
    nominal: Mapping[str, Any]

    @property
    def stamped(self) -> bool:
        """Whether commands were TwistStamped."""
        return self.drives[0].stamped

    def known(self, key: str) -> Interval | None:
        """The interval of a figure, if it is identifiable."""
        return self.estimates[key].interval


def identification(drives: Sequence[Drive], nominal: Mapping[str, Any]) -> Identification:
    """Identify one robot from all drives."""
    found, times = times_of(fit(drives))
    return Identification(drives, found, dict(_estimates(found, times)), nominal)


def _estimates(found: Fit, times: Times) -> Iterator[tuple[str, Estimate]]:
    drives = found.model.drives
    scales = [interval_of(found, SCALE + axis) for axis in found.model.axes]
    unmoved = all(each.low <= 0.0 for each in scales)
    problem = 'the robot did not follow the commands' if unmoved else ''
    if not found.model.axes:
        problem = 'the commands never were anything but 0'
    elif all(
        sum(len(one[axis][0]) for one in found.model.changes) < 4 for axis in found.model.axes
    ):
        problem = problem or 'the commands never changed'
    yield from _times(drives, times, problem)
    for axis, (name, _, _) in enumerate(AXES):
        reason = '' if axis in found.model.axes else f'there was no {name} command'
        interval = None if reason or unmoved else interval_of(found, SCALE + axis)
        yield f'scale_{name}', _judged(f'{name} scale', '', interval, reason or problem)
    yield from _limits(found, problem)
    yield 'rate', _rate(drives)
    yield 'age', _age(drives)
    for axis, (kind, (_, _, unit)) in enumerate(zip(('position', 'heading'), AXES, strict=True)):
        remark = 'standard deviation, along the path' if axis == 0 else 'standard deviation'
        noise = found.noises[axis]
        interval = Interval(noise.pose, *noise.possible(found.steps(axis), QUANTILE))
        yield kind, Estimate(f'{kind} noise', unit, interval, remark)
    if math.isfinite(found.model.timeout):
        timeout = Interval(found.model.timeout, found.model.timeout, found.model.timeout)
        yield 'timeout', Estimate('command timeout', 's', timeout, 'the nearest of some usual ones')


def _times(drives: Sequence[Drive], times: Times, problem: str) -> Iterator[tuple[str, Estimate]]:
    age = float(np.mean([each.age for each in drives]))
    answers = [each.answer for each in drives if each.answer is not None]
    clocks = 'from its reception, by the clocks of bag and robot'
    yield 'delay', _judged('delay of a command', 's', times.delay.shifted(-age), problem, clocks)
    yield 'lag', _judged('wheel lag', 's', times.lag, problem, 'first-order time constant')
    together = times.together.shifted(-age)
    yield 'together', _judged('delay and lag together', 's', together, problem, clocks)
    remark = (
        'from the stamp of the odometry that a command answers'
        if answers
        else 'the age of odometry included, the time of a control step not: add it'
    )
    delay = times.together.shifted(float(np.mean(answers)) if answers else 0.0)
    yield 'command_delay', _judged('command_delay, lag included', 's', delay, problem, remark)


def _judged(
    name: str, unit: str, interval: Interval | None, problem: str, remark: str = ''
) -> Estimate:
    if interval is None or problem:
        return Estimate(name, unit, None, f'not identifiable: {problem}')
    if interval.half_width > _MOST_OFF[unit] * (1.0 if unit else abs(interval.value)):
        between = f'anything from {interval.low:.3g} to {interval.high:.3g} {unit}'.rstrip()
        return Estimate(name, unit, None, f'not identifiable: too little excitation, {between}')
    return Estimate(name, unit, interval, remark)


def _limits(found: Fit, problem: str) -> Iterator[tuple[str, Estimate]]:
    fitted = {limit: LIMIT + place for place, limit in enumerate(found.model.limits)}
    reached = reached_by(found)
    for axis, (name, unit, _) in enumerate(AXES):
        fields = ('speed', 'max_speed', unit), ('acceleration', 'max_acceleration', f'{unit}^2')
        for value, (kind, field, units) in zip(reached[axis], fields, strict=True):
            key, title = f'{kind}_{name}', f'{name} {kind} limit'
            place = fitted.get((axis, field))
            if problem or axis not in found.model.axes:
                why = problem or f'there was no {name} command'
                yield key, Estimate(title, units, None, f'not identifiable: {why}')
            elif place is None:
                why = f'not identifiable: not reached, up to {value:.3g} {units}'
                yield key, Estimate(title, units, None, why)
            else:
                yield key, Estimate(title, units, interval_of(found, place), 'was reached')


def _median(values: Array) -> Interval:
    """The median, with an interval by its rank."""
    ordered, n = np.sort(values), len(values)
    away = _QUANTILE * math.sqrt(n) / 2.0
    low, high = max(math.floor(n / 2 - away), 0), min(math.ceil(n / 2 + away), n - 1)
    return Interval(float(np.median(ordered)), float(ordered[low]), float(ordered[high]))


def _rate(drives: Sequence[Drive]) -> Estimate:
    durations = np.concatenate([np.diff(each.stamps) for each in drives])
    period = _median(durations)
    rate = Interval(1.0 / period.value, 1.0 / period.high, 1.0 / period.low)
    remark = f'longest gap {1e3 * durations.max():.0f} ms'
    return Estimate('odometry rate', 'Hz', rate, remark)


def _age(drives: Sequence[Drive]) -> Estimate:
    ages = np.concatenate([each.ages for each in drives])
    remark = f'when received: {1e3 * ages.min():.1f} to {1e3 * ages.max():.1f} ms'
    if ages.min() < 0.0:
        remark += f'; the clock of the robot is ahead by {-1e3 * ages.min():.1f} ms or more'
    return Estimate('odometry age', 's', _median(ages), remark)
