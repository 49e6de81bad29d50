"""What the project has set out to reach, and whether it does here."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from benchmarks.families.robot_drives import LIMITED, MODELS
from benchmarks.families.spread import Spread
from benchmarks.methods.condensed_method import CondensedDaqp
from benchmarks.methods.guidance_methods import FullStep, Law
from benchmarks.methods.riccati_method import RiccatiActiveSet
from benchmarks.results import Results

PIQP = 'sqpmethod + piqp'
"""What the machine is measured by on which the targets in milliseconds were set."""

PIQP_THERE = 1.12
"""Median of all its steps of Case 3 on that machine, with `_STEPS_THERE` of them [ms]."""

_STEPS_THERE = 50

# Most that a bare step may take beside another method: the first step, and all steps.
_BESIDE = {CondensedDaqp.name: (0.1, 0.2), PIQP: (0.04, 0.03)}
_FULL = 2.5
_EXPONENT = 1.5
_TAIL = 3.0
_EIGHT = 1.0
_LONG = 400

# Robots on long horizons: first step, 99th percentile and median [ms]; and growth with N.
_ROBOTS = {'first step': 50.0, 'p99': 10.0, 'median': 3.0}
_GROWTH = 1.2

_CAR = 3.0


@dataclass(frozen=True)
class Target:
    """One figure and what it is to be.

    Attributes:
        what: What is measured, in words.
        at_most: What it may be.
        found: What it is; None if it was not measured.
    """

    what: str
    at_most: float
    found: float | None

    @property
    def holds(self) -> bool | None:
        """Whether it is; None if that is not known."""
        return None if self.found is None else self.found <= self.at_most


def targets(results: Results) -> Iterator[Target]:
    """All targets, with what was found."""
    yield from _of_long_horizons(results)
    bare, full = RiccatiActiveSet.name, FullStep.name
    for below, (first, loop) in _BESIDE.items():
        yield from _beside(results, bare, below, first, loop)
    yield from _beside(results, full, bare, _FULL, _FULL)
    exponents = {each.name: each.exponent for each in results.growth}
    yield Target(f'{bare}: exponent of N from 100 steps on', _EXPONENT, exponents.get(bare))
    times = {each.name: dict(zip(each.steps, each.times, strict=True)) for each in results.growth}
    long = times.get(bare, {}).get(_LONG)
    yield Target(f'{bare}: N = {_LONG} [ms]', 1.0, None if long is None else long / 1e3)
    yield Target(
        'full step, hard cases: median of the slowest [ms]',
        0.2,
        max((float(np.median(each.times)) for each in results.hard), default=None),
    )
    yield Target(
        'full step, hard cases: longest step [ms]',
        1.0,
        max((float(each.times.max()) for each in results.hard), default=None),
    )
    ratios = {each.name: each.ratio for each in results.tails}
    again = {each.name: each.ratio_again for each in results.tails}
    for name in (bare, full, Law.name):
        what = f'{name}: 99.9th percentile / median'
        yield Target(what, _TAIL, ratios.get(name))
        yield Target(f'{what}, first step alone', _TAIL, again.get(name))
    times_of = {each.name: each.times for each in results.models}
    one, car = MODELS
    for limits in ('', LIMITED):
        ratio = None
        if {one + limits, car + limits} <= set(times_of):
            ratio = float(np.median(times_of[car + limits] / times_of[one + limits]))
        yield Target(f'car / differential drive{limits}: every step, median', _CAR, ratio)
    of_plans = {each.count: float(np.median(each.second)) / 1e3 for each in results.plans}
    yield Target('control step with eight plans: median [ms]', _EIGHT, of_plans.get(8))
    yield from _of_latency(results)


def pace(results: Results) -> float | None:
    """How many times as long this machine takes as that of the targets; None if not measured."""
    times = {each.name: each.times for each in results.comparison.timed}
    if PIQP not in times or results.comparison.steps != _STEPS_THERE:
        return None
    return float(np.median(times[PIQP])) / 1e3 / PIQP_THERE


def _beside(results: Results, name: str, below: str, first: float, loop: float) -> Iterator[Target]:
    found = results.comparison.ratios(name, below)
    both = (None, None) if found is None else (found.first, found.loop)
    yield Target(f'{name} / {below}: first step', first, both[0])
    yield Target(f'{name} / {below}: every step, median', loop, both[1])


def _of_long_horizons(results: Results) -> Iterator[Target]:
    """Of the robots the slowest counts."""
    spreads = [Spread.of(each.times) for each in results.robots]
    found = {
        'first step': [float(np.median(each.times[:, 0])) for each in results.robots],
        'p99': [each.largest if each.p99 is None else each.p99 for each in spreads],
        'median': [each.median for each in spreads],
    }
    for name, at_most in _ROBOTS.items():
        what = f'robots on long horizons, the slowest: {name} [ms]'
        yield Target(what, at_most, max(found[name], default=None))
    exponent = results.long_horizons.exponent()
    yield Target('long horizons, half of the wheel limits active: exponent of N', _GROWTH, exponent)


def _of_latency(results: Results) -> Iterator[Target]:
    median = p99 = under_way = own = start = None
    if results.latency is not None:
        total = Spread.of(results.latency.total)
        median, p99 = total.median, total.p99
        under_way = results.latency.under_way.p99
        own = Spread.of(results.latency.own).median
        start = Spread.of(results.latency.starts).median
    yield Target('odometry to command over DDS: median [ms]', 1.2, median)
    yield Target('odometry to command over DDS: p99 [ms]', 4.0, p99)
    yield Target('odometry to command, first steps aside: p99 [ms]', 4.0, under_way)
    yield Target('of that the node itself: median [ms]', 0.3, own)
    yield Target('from the start of the process to an active node: median [s]', 1.5, start)
