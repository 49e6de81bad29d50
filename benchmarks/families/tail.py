"""How much longer than usual the longest control steps take, in this process.

Steps of a closed loop differ in what there is to do: its first has the whole horizon. How much one
and the same step varies is what the machine and the code do to it, so both are looked at.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from benchmarks.families.spread import Spread
from benchmarks.families.task import Task
from benchmarks.families.timing import close_loop
from benchmarks.methods.method import Method
from benchmarks.quiet import collector_off
from cmpsp_ros.arrays import Array


@dataclass(frozen=True)
class Tail:
    """Control steps of one method.

    Attributes:
        name: Of the method.
        times: Of every step of many closed loops, shape ``(K,)`` [us].
        again: Of their first step, made again and again, shape ``(K,)`` [us].
    """

    name: str
    times: Array
    again: Array

    @property
    def spread(self) -> Spread:
        """Of the times [us]."""
        return Spread.of(self.times)

    @property
    def ratio(self) -> float | None:
        """99.9th percentile beside the median; None with too few steps for it."""
        return _ratio(self.spread)

    @property
    def spread_again(self) -> Spread:
        """Of one and the same step [us]."""
        return Spread.of(self.again)

    @property
    def ratio_again(self) -> float | None:
        """99.9th percentile of one and the same step beside its median."""
        return _ratio(self.spread_again)


def tails(
    task: Task,
    methods: Sequence[Method],
    steps: int,
    count: int,
    progress: Callable[[], None] = lambda: None,
) -> list[Tail]:
    """Time many control steps, the methods in turn, with the collector off all the while."""
    times: list[list[Array]] = [[] for _ in methods]
    again: list[list[Array]] = [[] for _ in methods]
    with collector_off():
        for _ in range(loops(count, steps)):
            for method, of_method, of_first in zip(methods, times, again, strict=True):
                of_method.append(close_loop(task, method, steps).times)
                of_first.append(_first_step(task, method, steps))
            progress()
    return [
        Tail(method.name, np.concatenate(of_method), np.concatenate(of_first))
        for method, of_method, of_first in zip(methods, times, again, strict=True)
    ]


def _first_step(task: Task, method: Method, steps: int) -> Array:
    """Times of the first step, made as often as there are steps in a closed loop [us]."""
    pose, durations, guess = task.pose, task.durations(steps), task.guess(steps)
    times = np.empty(steps)
    for k in range(steps):
        method.begin(steps)
        began = time.perf_counter_ns()
        method.step(pose, guess, durations)
        times[k] = (time.perf_counter_ns() - began) * 1e-3
    return times


def _ratio(spread: Spread) -> float | None:
    return None if spread.p999 is None else spread.p999 / spread.median


def loops(count: int, steps: int) -> int:
    """Closed loops that so many control steps are."""
    return -(-count // steps)
