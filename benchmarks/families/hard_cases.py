"""Full steps where programs are hard: many active rows, or none that meets all of them.

One plan is improved and followed to the end, as in the paper, even where it is a trap: the guidance
law makes another one beside a plan that needs slack.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from benchmarks.families.presets import Preset, of_tables
from benchmarks.families.task import Task
from benchmarks.families.timing import close_loop
from benchmarks.methods.guidance_methods import FullStep
from cmpsp_ros.arrays import Array


@dataclass(frozen=True)
class HardCase:
    """Computing times of one run.

    Attributes:
        name: Of the run.
        times: Of every step, shape ``(runs, N)`` [ms].
        elastic: Steps in which the last program needed slack.
    """

    name: str
    times: Array
    elastic: int

    @property
    def longest(self) -> float:
        """Median over the runs of that step for which it is the greatest [ms]."""
        return float(np.median(self.times, axis=0).max())


def presets() -> list[Preset]:
    """Case 3 at 45 rad/s, where most wheel speeds are at their limit, and the paper's tables."""
    return [Preset.load('case3_45'), *of_tables()]


def measure(
    cases: Sequence[Preset], runs: int, progress: Callable[[], None] = lambda: None
) -> list[HardCase]:
    """Drive every case in turn, again and again, and take the times.

    Raises:
        BenchError: A program was not solved, or a plan may not be followed.
    """
    tasks = [Task.of(each) for each in cases]
    methods = [FullStep(task) for task in tasks]
    times: list[list[Array]] = [[] for _ in cases]
    for _ in range(runs):
        for task, method, of_runs in zip(tasks, methods, times, strict=True):
            of_runs.append(close_loop(task, method, task.steps).times / 1e3)
            progress()
    return [
        HardCase(each.name, np.array(of_runs), method.elastic)
        for each, of_runs, method in zip(cases, times, methods, strict=True)
    ]
