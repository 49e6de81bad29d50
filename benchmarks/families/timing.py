"""Methods in turn, each in its own closed loop; what the machine does falls on all of them."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from benchmarks.errors import BenchError
from benchmarks.families.spread import Spread
from benchmarks.families.task import Outcome, Task
from benchmarks.methods.method import Method
from benchmarks.quiet import collector_off, unheard
from cmpsp_ros.arrays import Array


@dataclass(frozen=True)
class Loop:
    """One closed loop over the whole time.

    Attributes:
        wheel_speeds: Driven, shape ``(N + 1, 2)`` [rad/s]; the last pair moves nothing.
        times: Computing time of every step, shape ``(N,)`` [us].
    """

    wheel_speeds: Array
    times: Array


@dataclass(frozen=True)
class Timed:
    """A method that solves the task, and its computing times.

    Attributes:
        name: Of the method.
        outcome: Of its closed loop.
        times: Of every step of every run, shape ``(runs, N)`` [us].
    """

    name: str
    outcome: Outcome
    times: Array

    @property
    def first(self) -> Spread:
        """Of the first step, with the full horizon and the preset's guess [us]."""
        return Spread.of(self.times[:, 0])

    @property
    def loop(self) -> Spread:
        """Of all steps of the shrinking horizon [us]."""
        return Spread.of(self.times)


@dataclass(frozen=True)
class Ratios:
    """One method beside another: medians of quotients in the same step of the same run.

    Attributes:
        first: Of the first step.
        loop: Of all steps.
    """

    first: float
    loop: float

    @classmethod
    def of(cls, times: Array, below: Array) -> Ratios:
        """From times of both, shape ``(runs, N)``."""
        quotients = times / below
        return cls(float(np.median(quotients[:, 0])), float(np.median(quotients)))


@dataclass(frozen=True)
class Comparison:
    """What came of comparing methods.

    Attributes:
        steps: Steps of the full horizon.
        runs: Closed loops of each method.
        timed: Methods that solve the task; the first is the baseline.
        left_out: Why the others were not timed, by name.
    """

    steps: int
    runs: int
    timed: list[Timed]
    left_out: dict[str, str]

    def ratios(self, name: str, below: str) -> Ratios | None:
        """How long a method takes beside another one; None if either was not timed."""
        times = {each.name: each.times for each in self.timed}
        if name not in times or below not in times:
            return None
        return Ratios.of(times[name], times[below])


def close_loop(task: Task, method: Method, steps: int) -> Loop:
    """Let a method drive the exact model from start to end, with a horizon that shrinks.

    One step that does not count goes before, so that what others have left in the processor's
    caches does not count either.

    Args:
        task: The task.
        method: Prepared for all horizons of ``steps`` steps and fewer.
        steps: Steps of the full horizon.
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
) -> Comparison:
    """Time methods against the first of them.

    A method that does not solve the task is not timed: how long a wrong answer takes is no time.

    Raises:
        BenchError: The first method does not solve the task.
    """
    trials = {}
    for method in methods:
        trials[method.name] = _try(task, method, steps)
        progress()
    outcomes = {name: found for name, found in trials.items() if isinstance(found, Outcome)}
    left_out = {name: found for name, found in trials.items() if isinstance(found, str)}
    if methods[0].name in left_out:
        raise BenchError(f'{methods[0].name}: {left_out[methods[0].name]}')
    able = [method for method in methods if method.name in outcomes]
    times = {method.name: np.empty((runs, steps)) for method in able}
    for run in range(runs):
        for method in methods:
            if method in able:
                times[method.name][run] = close_loop(task, method, steps).times
            progress()
    timed = [Timed(name, outcome, times[name]) for name, outcome in outcomes.items()]
    return Comparison(steps, runs, timed, left_out)


def _try(task: Task, method: Method, steps: int) -> Outcome | str:
    """What a method's closed loop comes to, or why it does not solve the task."""
    try:
        with unheard():
            for left in range(steps, 0, -1):
                method.prepare(left)
            outcome = task.outcome(close_loop(task, method, steps).wheel_speeds)
    except BenchError as error:
        return str(error)
    return task.failure(outcome) or outcome
