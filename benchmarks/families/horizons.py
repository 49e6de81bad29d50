"""How the first step's computing time grows with the number of steps."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from benchmarks.errors import BenchError
from benchmarks.families.task import Task
from benchmarks.methods.method import Method
from benchmarks.quiet import collector_off, unheard

HORIZONS = (10, 25, 50, 100, 200, 400)

_ASYMPTOTIC = 100
"""Steps from which on the growth is fitted: below, what does not grow counts too much."""


@dataclass(frozen=True)
class Growth:
    """One method over horizons.

    Attributes:
        name: Of the method.
        steps: Horizons, shape ``(K,)``.
        times: Median of the first step at each, shape ``(K,)`` [us].
        exponent: Slope of the logarithm of time over that of steps from 100 steps on; None with
            fewer than two horizons there.
    """

    name: str
    steps: list[int]
    times: list[float]
    exponent: float | None

    @classmethod
    def of(cls, name: str, times: dict[int, float]) -> Growth:
        """From the times by number of steps."""
        long = [each for each in times if each >= _ASYMPTOTIC]
        exponent = None
        if len(long) >= 2:
            slope, _ = np.polyfit(np.log(long), np.log([times[each] for each in long]), 1)
            exponent = float(slope)
        return cls(name, list(times), list(times.values()), exponent)


def grow(
    task: Task,
    methods: Sequence[Method],
    horizons: Sequence[int],
    runs: int,
    progress: Callable[[], None] = lambda: None,
) -> list[Growth]:
    """Time the first step of methods at several horizons, the methods in turn.

    A horizon at which a method's step does not bring the path nearer to the goal is left out.
    """
    times: dict[str, dict[int, float]] = {method.name: {} for method in methods}
    for steps in horizons:
        able = [each for each in methods if steps <= each.largest and _tries(task, each, steps)]
        samples = np.empty((runs, len(able)))
        with collector_off():
            for run in range(runs):
                for place, method in enumerate(able):
                    _step(task, method, steps)
                    samples[run, place] = _step(task, method, steps)
        for method, sample in zip(able, samples.T, strict=True):
            times[method.name][steps] = float(np.median(sample))
        progress()
    return [Growth.of(name, of_method) for name, of_method in times.items()]


def _tries(task: Task, method: Method, steps: int) -> bool:
    """Prepare a method, and see whether its step does what it should."""
    try:
        with unheard():
            method.prepare(steps)
            method.begin(steps)
            U = method.step(task.pose, task.guess(steps), task.durations(steps))
    except BenchError:
        return False
    return task.outcome(U).miss < task.outcome(task.guess(steps)).miss


def _step(task: Task, method: Method, steps: int) -> float:
    """Time of one first step [us]."""
    guess, durations = task.guess(steps), task.durations(steps)
    method.begin(steps)
    began = time.perf_counter_ns()
    method.step(task.pose, guess, durations)
    return (time.perf_counter_ns() - began) * 1e-3
