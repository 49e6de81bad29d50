"""Closed loops of several methods in turn: compared, their longest steps, and hard cases."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from benchmarks.common import BenchError, Spread, collector_off, in_turn, timed, unheard
from benchmarks.drives import Preset, of_tables
from benchmarks.methods.ours import FullStep, Method
from benchmarks.task import Task, TaskOutcome
from cmpsp_ros.arrays import Array


@dataclass(frozen=True)
class Loop:
    """Wheel speeds ``(N + 1, 2)`` [rad/s] of one closed loop, and times of its steps ``(N,)`` [us].

    The last pair of wheel speeds moves nothing.
    """

    wheel_speeds: Array
    times: Array


@dataclass(frozen=True)
class Timed:
    """A method that solves the task, and times of every step of every run, ``(runs, N)`` [us]."""

    name: str
    outcome: TaskOutcome
    times: Array

    @property
    def first(self) -> Spread:
        """Times of the first step, with the full horizon and the preset's guess [us]."""
        return Spread.of(self.times[:, 0])

    @property
    def loop(self) -> Spread:
        """Times of all steps of the shrinking horizon [us]."""
        return Spread.of(self.times)


@dataclass(frozen=True)
class Ratios:
    """One method beside another: medians of quotients in the first step, and in all, of a run."""

    first: float
    loop: float

    @classmethod
    def of(cls, times: Array, below: Array) -> Ratios:
        """From times of both, shape ``(runs, N)``."""
        quotients = times / below
        return cls(float(np.median(quotients[:, 0])), float(np.median(quotients)))


@dataclass(frozen=True)
class MethodComparison:
    """Closed loops of methods that solve the task, the first of them the baseline.

    Reasons why the others were not timed are by name.
    """

    steps: int
    runs: int
    timed: list[Timed]
    left_out: dict[str, str]

    def ratios(self, name: str, below: str) -> Ratios | None:
        """Time ratios of two methods; None if either was not timed."""
        times = {each.name: each.times for each in self.timed}
        if name not in times or below not in times:
            return None
        return Ratios.of(times[name], times[below])


def close_loop(task: Task, method: Method, steps: int) -> Loop:
    """Let a method drive the exact model from start to end, with a horizon that shrinks.

    One untimed step goes before, to warm the processor's caches. The method must be prepared for
    all horizons up to ``steps``.
    """
    robot, durations = task.settings.robot, task.durations(steps)
    pose, U = task.pose, task.guess(steps)
    driven, times = np.empty((steps + 1, 2)), np.empty(steps)
    with collector_off():
        method.begin(steps)
        method.step(pose, U, durations)
        method.begin(steps)
        for k in range(steps):
            left = durations[k:]
            began = time.perf_counter_ns()
            U = method.step(pose, U, left)
            times[k] = (time.perf_counter_ns() - began) * 1e-3
            pose = robot.roll_out(pose, U[:1], left[:1])[-1]
            driven[k : k + 2] = U[0]
            U = U[1:]
    return Loop(driven, times)


def compare(
    task: Task,
    methods: Sequence[Method],
    steps: int,
    runs: int,
    progress: Callable[[], None] = lambda: None,
) -> MethodComparison:
    """Time methods against the first of them.

    A method that does not solve the task is not timed: how long a wrong answer takes is no time.
    """
    trials = {}
    for method in methods:
        trials[method.name] = _try(task, method, steps)
        progress()
    outcomes = {name: found for name, found in trials.items() if isinstance(found, TaskOutcome)}
    left_out = {name: found for name, found in trials.items() if isinstance(found, str)}
    if methods[0].name in left_out:
        raise BenchError(f'{methods[0].name}: {left_out[methods[0].name]}')
    able = [method for method in methods if method.name in outcomes]
    loops_of = {method.name: partial(close_loop, task, method, steps) for method in able}
    driven = in_turn(loops_of, runs, progress)
    times = {name: np.array([loop.times for loop in found]) for name, found in driven.items()}
    solved = [Timed(name, outcome, times[name]) for name, outcome in outcomes.items()]
    return MethodComparison(steps, runs, solved, left_out)


def _try(task: Task, method: Method, steps: int) -> TaskOutcome | str:
    """Outcome of a method's closed loop, or the reason why it does not solve the task."""
    try:
        with unheard():
            for left in range(steps, 0, -1):
                method.prepare(left)
            outcome = task.outcome(close_loop(task, method, steps).wheel_speeds)
    except BenchError as error:
        return str(error)
    return task.failure(outcome) or outcome


@dataclass(frozen=True)
class Tail:
    """Times of all steps of many closed loops, and of their first, repeated, ``(K,)`` [us]."""

    name: str
    times: Array
    again: Array

    @property
    def spread(self) -> Spread:
        """Statistics of the times [us]."""
        return Spread.of(self.times)

    @property
    def ratio(self) -> float | None:
        """Ratio of 99.9th percentile and median; None with too few steps."""
        return _ratio(self.spread)

    @property
    def spread_again(self) -> Spread:
        """Statistics of the repeated step [us]."""
        return Spread.of(self.again)

    @property
    def ratio_again(self) -> float | None:
        """Ratio of 99.9th percentile and median of the repeated step."""
        return _ratio(self.spread_again)


def tails(
    task: Task,
    methods: Sequence[Method],
    steps: int,
    count: int,
    progress: Callable[[], None] = lambda: None,
) -> list[Tail]:
    """Time many control steps, the methods in turn, with the collector off all the while."""
    both = {
        (method.name, loop): partial(time_loop, task, method, steps)
        for method in methods
        for loop, time_loop in enumerate((_loop_times, _first_step_times))
    }
    with collector_off():
        found = in_turn(both, loops(count, steps), progress)
    return [
        Tail(each.name, *(np.concatenate(found[each.name, loop]) for loop in (0, 1)))
        for each in methods
    ]


def _loop_times(task: Task, method: Method, steps: int) -> Array:
    return close_loop(task, method, steps).times


def _first_step_times(task: Task, method: Method, steps: int) -> Array:
    """Times of the first step, made as often as there are steps in a closed loop [us]."""
    pose, durations, guess = task.pose, task.durations(steps), task.guess(steps)
    times = np.empty(steps)
    for k in range(steps):
        method.begin(steps)
        times[k] = timed(method.step, pose, guess, durations)
    return times


def _ratio(spread: Spread) -> float | None:
    return None if spread.p999 is None else spread.p999 / spread.median


def loops(count: int, steps: int) -> int:
    """Number of closed loops with that many control steps."""
    return -(-count // steps)


@dataclass(frozen=True)
class HardCase:
    """Times of all steps of a case ``(runs, N)`` [ms], and steps whose last program had slack."""

    name: str
    times: Array
    elastic: int

    @property
    def longest(self) -> float:
        """Median over the runs of that step for which it is the greatest [ms]."""
        return float(np.median(self.times, axis=0).max())


def hard_cases() -> list[Preset]:
    """Case 3 at 45 rad/s, where most wheel speeds are at their limit, and the paper's tables."""
    return [Preset.load('case3_45'), *of_tables()]


def time_hard_cases(
    cases: Sequence[Preset], runs: int, progress: Callable[[], None] = lambda: None
) -> list[HardCase]:
    """Drive every case in turn, repeatedly, and take the times."""
    methods = {each.name: FullStep(Task.of(each)) for each in cases}
    driven = in_turn(
        {
            name: partial(close_loop, method.task, method, method.task.steps)
            for name, method in methods.items()
        },
        runs,
        progress,
    )
    return [
        HardCase(name, np.array([loop.times / 1e3 for loop in found]), methods[name].elastic)
        for name, found in driven.items()
    ]
