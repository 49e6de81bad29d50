"""Request and results of a benchmark, and the targets of the project."""

from __future__ import annotations

import shlex
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from benchmarks.common import Spread
from benchmarks.crowds import PlansTiming
from benchmarks.drives import LIMITED, MODELS, PresetTiming, RobotDrive, robots_that_fit
from benchmarks.general import GeneralTiming
from benchmarks.horizons import HORIZONS, LONG_HORIZONS, Growth, LongHorizons
from benchmarks.loops import HardCase, MethodComparison, Tail
from benchmarks.methods.ours import CondensedDaqp, FullStep, Law, RiccatiActiveSet

if TYPE_CHECKING:
    from benchmarks.over_dds.latency import Latency

COMPARED_STEPS = 50  # steps of Case 3


@dataclass(frozen=True)
class Order:
    """Measurements to make, and their output."""

    # Presets or parameter files whose control steps are timed; none for all presets and the runs of
    # the paper's tables.
    presets: Sequence[str]
    runs: int  # runs of each of them, and of each method
    tail: int  # number of control steps for tail latency
    peers: bool = False  # true to compare with third-party solvers
    latency: bool = False  # true to time the node over DDS
    output: Path | None = None  # a file that ends in `.json`, or a folder; None to write nothing
    steps: int = COMPARED_STEPS  # steps of the full horizon for comparing methods
    horizons: Sequence[int] = HORIZONS  # horizons [steps] for the growth of methods
    # Robots that drive on long horizons.
    robots: Sequence[str] = field(default_factory=robots_that_fit)
    # Horizons [steps] for the control step of one plan.
    long_horizons: Sequence[int] = LONG_HORIZONS

    @property
    def command(self) -> str:
        """Command line of the order."""
        options = [name for name in ('peers', 'latency') if getattr(self, name)]
        words = ['cmpsp', 'bench', *self.presets, '--runs', str(self.runs)]
        words += ['--tail', str(self.tail)]
        words += [f'--{name}' for name in options]
        if self.output is not None:
            words += ['--output', str(self.output)]
        return shlex.join(words)


@dataclass(frozen=True)
class Results:
    """All that was measured.

    Attributes:
        robots: Robots on long horizons.
        models: A differential drive and a car on one course.
        long_horizons: One plan's control steps over long horizons.
        comparison, growth: Methods at one horizon, and over horizons.
        tails: Many control steps of the project's own methods.
        general: Programs of other sizes than the robot's.
        missing: Reasons why other methods are missing, by name.
        resident: Resident set of this process at the end [MB].
    """

    order: Order
    machine: dict[str, str]
    robots: list[RobotDrive]
    models: list[RobotDrive]
    long_horizons: LongHorizons
    presets: list[PresetTiming]
    comparison: MethodComparison
    tails: list[Tail]
    hard: list[HardCase]
    plans: list[PlansTiming]
    growth: list[Growth]
    general: list[GeneralTiming]
    missing: dict[str, str]
    latency: Latency | None
    resident: float


PIQP = 'sqpmethod + piqp'  # method by which machines are compared

# PIQP's median of all steps of Case 3 on the machine of the targets, with `_STEPS_THERE` [ms].
PIQP_THERE = 1.12

_STEPS_THERE = 50

# Robots on long horizons: first step, 99th percentile and median [ms].
_ROBOTS = {'first step': 50.0, 'p99': 10.0, 'median': 3.0}
_TAIL = 3.0
_CAR = 3.0
_LONG = 400


@dataclass(frozen=True)
class Target:
    """One figure and its limit; None if it was not measured."""

    what: str
    at_most: float
    found: float | None

    @property
    def holds(self) -> bool | None:
        """True if the limit is kept; None if that is not known."""
        return None if self.found is None else self.found <= self.at_most


def targets(results: Results) -> Iterator[Target]:
    """All targets, with the figures found."""
    bare, full, law = RiccatiActiveSet.name, FullStep.name, Law.name
    spreads = [Spread.of(each.times) for each in results.robots]
    slowest = {
        'first step': [float(np.median(each.times[:, 0])) for each in results.robots],
        'p99': [each.largest if each.p99 is None else each.p99 for each in spreads],
        'median': [each.median for each in spreads],
    }
    for name, at_most in _ROBOTS.items():
        what = f'robots on long horizons, the slowest: {name} [ms]'
        yield Target(what, at_most, max(slowest[name], default=None))
    exponent = results.long_horizons.exponent()
    yield Target('long horizons, half of the wheel limits active: exponent of N', 1.2, exponent)
    for one, below, first, loop in (
        (bare, CondensedDaqp.name, 0.1, 0.2),
        (bare, PIQP, 0.04, 0.03),
        (full, bare, 2.5, 2.5),
    ):
        ratios = results.comparison.ratios(one, below)
        yield Target(f'{one} / {below}: first step', first, ratios.first if ratios else None)
        yield Target(f'{one} / {below}: every step, median', loop, ratios.loop if ratios else None)
    growth = {each.name: each for each in results.growth}
    found = growth.get(bare)
    times = dict(zip(found.steps, found.times, strict=True)) if found else {}
    exponent = found.exponent if found else None
    yield Target(f'{bare}: exponent of N from 100 steps on', 1.5, exponent)
    yield Target(f'{bare}: N = {_LONG} [ms]', 1.0, _in_ms(times.get(_LONG)))
    medians = [float(np.median(each.times)) for each in results.hard]
    longest = [float(each.times.max()) for each in results.hard]
    what = 'full step, hard cases'
    yield Target(f'{what}: median of the slowest [ms]', 0.2, max(medians, default=None))
    yield Target(f'{what}: longest step [ms]', 1.0, max(longest, default=None))
    tails = {each.name: each for each in results.tails}
    for name in (bare, full, law):
        tail, what = tails.get(name), f'{name}: 99.9th percentile / median'
        yield Target(what, _TAIL, tail.ratio if tail else None)
        yield Target(f'{what}, first step alone', _TAIL, tail.ratio_again if tail else None)
    models = {each.name: each.times for each in results.models}
    one, car = MODELS
    for limits in ('', LIMITED):
        ratio = None
        if {one + limits, car + limits} <= set(models):
            ratio = float(np.median(models[car + limits] / models[one + limits]))
        yield Target(f'car / differential drive{limits}: every step, median', _CAR, ratio)
    of_plans = {each.count: float(np.median(each.second)) for each in results.plans}
    yield Target('control step with eight plans: median [ms]', 1.0, _in_ms(of_plans.get(8)))
    latency = results.latency
    for what, at_most, figure in (
        ('odometry to command over DDS: median [ms]', 1.2, lambda of: Spread.of(of.total).median),
        ('odometry to command over DDS: p99 [ms]', 4.0, lambda of: Spread.of(of.total).p99),
        ('odometry to command, first steps aside: p99 [ms]', 4.0, lambda of: of.under_way.p99),
        ('in the node: median [ms]', 0.3, lambda of: Spread.of(of.own).median),
        (
            'from the start of the process to an active node: median [s]',
            1.5,
            lambda of: Spread.of(of.starts).median,
        ),
    ):
        yield Target(what, at_most, None if latency is None else figure(latency))


def pace(results: Results) -> float | None:
    """Slowness of this machine relative to that of the targets; None if not measured."""
    times = {each.name: each.times for each in results.comparison.timed}
    if PIQP not in times or results.comparison.steps != _STEPS_THERE:
        return None
    return float(np.median(times[PIQP])) / 1e3 / PIQP_THERE


def _in_ms(microseconds: float | None) -> float | None:
    return None if microseconds is None else microseconds / 1e3
