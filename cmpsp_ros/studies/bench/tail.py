"""How much longer than usual the longest control steps take, in this process."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cmpsp_ros.studies.bench.methods import Method
from cmpsp_ros.studies.bench.quiet import collector_off
from cmpsp_ros.studies.bench.spread import Spread
from cmpsp_ros.studies.bench.task import Task
from cmpsp_ros.studies.bench.timing import close_loop

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Tail:
    """Control steps of one method, over many closed loops.

    Attributes:
        name: Of the method.
        times: Of every step, shape ``(K,)`` [us].
    """

    name: str
    times: Array

    @property
    def spread(self) -> Spread:
        """Of the times [us]."""
        return Spread.of(self.times)

    @property
    def ratio(self) -> float | None:
        """99.9th percentile beside the median; None with too few steps for it."""
        spread = self.spread
        return None if spread.p999 is None else spread.p999 / spread.median


def tails(
    task: Task,
    methods: Sequence[Method],
    steps: int,
    count: int,
    progress: Callable[[], None] = lambda: None,
) -> list[Tail]:
    """Time many control steps, the methods in turn, with the collector off all the while.

    Args:
        task: The task.
        methods: Methods that solve it.
        steps: Steps of the full horizon.
        count: Steps of each method, but for those that fill up its last closed loop.
        progress: Told after each closed loop of all methods.
    """
    times: list[list[Array]] = [[] for _ in methods]
    with collector_off():
        for _ in range(loops(count, steps)):
            for method, of_method in zip(methods, times, strict=True):
                of_method.append(close_loop(task, method, steps).times)
            progress()
    return [
        Tail(method.name, np.concatenate(of_method))
        for method, of_method in zip(methods, times, strict=True)
    ]


def loops(count: int, steps: int) -> int:
    """Closed loops that so many control steps are."""
    return -(-count // steps)
