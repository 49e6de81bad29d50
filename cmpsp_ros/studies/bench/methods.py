"""Ways to do one control step: two iterations on a horizon, from a warm start."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from cmpsp_ros.mpsp.iteration import CMPSP, Options
from cmpsp_ros.studies.bench.task import Task

Array = NDArray[np.float64]

ITERATIONS = 2
"""Iterations of a control step."""

_PENALTY = 1e4


class Method(Protocol):
    """One way to do a control step.

    Attributes:
        name: For tables and pictures.
        largest: Longest horizon that it is worth being asked for [steps].
    """

    name: str
    largest: int

    def prepare(self, steps: int) -> None:
        """Do once what can be done before a horizon of so many steps is known any better."""

    def begin(self) -> None:
        """Forget what earlier steps have left behind: a new run begins."""

    def step(self, pose: Array, U: Array, durations: Array) -> Array:
        """Improve a control history; this alone is timed.

        Args:
            pose: Where the robot is, shape ``(3,)`` [m, m, rad].
            U: Warm start, shape ``(N + 1, 2)`` [rad/s]; to be left as it is.
            durations: Lengths of the steps, shape ``(N,)`` [s].

        Returns:
            Controls, shape ``(N + 1, 2)`` [rad/s].

        Raises:
            BenchError: It cannot.
        """


class CondensedDaqp:
    """Bare iterations on the condensed program, solved by daqp: no line search, no audit."""

    name = 'condensed + daqp'
    largest = 200

    def __init__(self, task: Task) -> None:
        """Take the task."""
        self._task = task

    def prepare(self, steps: int) -> None:
        """Nothing depends on the horizon alone."""

    def begin(self) -> None:
        """Nothing is carried from step to step but the controls."""

    def step(self, pose: Array, U: Array, durations: Array) -> Array:
        """Two iterations."""
        problem = self._task.problem(pose, durations)
        options = Options(
            penalty_terminal=np.full(problem.size.output, _PENALTY),
            penalty_path=np.full(problem.size.path, _PENALTY),
            line_search=False,
        )
        iteration = CMPSP(problem, options)
        iterate = iteration.init(U)
        for _ in range(ITERATIONS):
            iterate = iteration.step(iterate)
        return iterate.U


OURS: tuple[Callable[[Task], Method], ...] = (CondensedDaqp,)
"""The project's own methods; the first of them is what all others are compared with."""
