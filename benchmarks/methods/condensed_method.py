"""The obvious implementation: condense the program and hand it to a dense solver."""

from __future__ import annotations

import numpy as np

from benchmarks.families.task import Task
from benchmarks.methods.method import ITERATIONS, PENALTY
from cmpsp_ros.arrays import Array
from cmpsp_ros.mpsp import Options
from cmpsp_ros.mpsp.sqp import CMPSP


class CondensedDaqp:
    """Bare iterations on the condensed program, solved by daqp: no line search, no audit."""

    name = 'condensed + daqp'
    largest = 200

    def __init__(self, task: Task) -> None:
        """Take the task."""
        self._task = task

    def prepare(self, steps: int) -> None:
        """Nothing depends on the horizon alone."""

    def begin(self, steps: int) -> None:
        """Nothing is carried from step to step but the controls."""

    def step(self, pose: Array, U: Array, durations: Array) -> Array:
        """Two iterations."""
        problem = self._task.problem(pose, durations)
        options = Options(
            penalty_terminal=np.full(problem.size.output, PENALTY),
            penalty_path=np.full(problem.size.path, PENALTY),
            qp='daqp',
            line_search=False,
        )
        iteration = CMPSP(problem, options)
        iterate = iteration.init(U)
        for _ in range(ITERATIONS):
            iterate = iteration.step(iterate)
        return iterate.U
