"""The compiled iteration by itself."""

from __future__ import annotations

import math

import numpy as np

from benchmarks.errors import BenchError
from benchmarks.families.task import Task
from benchmarks.methods.method import ITERATIONS, PENALTY
from cmpsp_ros.arrays import Array
from cmpsp_ros.guidance.planning import FUNCTIONS
from cmpsp_ros.mpsp import SLACK_TOLERANCE
from cmpsp_ros.mpsp.qp.riccati import Outcome
from cmpsp_ros.mpsp.sqp import Driver


class RiccatiActiveSet:
    """Bare iterations along the stages, in compiled code: no line search, no audit.

    The active rows of a step are the warm start of the next one, as in the guidance law.
    """

    name = 'riccati active set'
    largest = 400

    def __init__(self, task: Task) -> None:
        """Take the task."""
        self._task = task
        self._allocate(1)

    def prepare(self, steps: int) -> None:
        """Allocate memory for the longest horizon."""
        if steps >= len(self._driver.ws.lower):
            self._allocate(steps)

    def begin(self, steps: int) -> None:
        """Forget the active rows."""
        self._driver.forget()
        self._left = steps

    def step(self, pose: Array, U: Array, durations: Array) -> Array:
        """Two iterations.

        Raises:
            BenchError: A program was not solved.
        """
        steps, ws = len(durations), self._driver.ws
        over, self._left = self._left - steps, steps
        ws.trial.U[: steps + 1] = U
        data = self._data._replace(pose=pose, durations=durations, progress=math.nan)
        self._driver.improve(self._functions, data, steps, over)
        if self._outcome[0] != Outcome.SOLVED:
            raise BenchError('it does not solve one of its programs')
        return ws.now.U[: steps + 1].copy()

    def _allocate(self, steps: int) -> None:
        pose, durations = self._task.pose, self._task.durations(steps)
        problem = self._task.problem(pose, durations)
        size = problem.size
        self._driver = driver = Driver(
            size,
            np.full(size.output, PENALTY),
            np.full(size.path, PENALTY),
            np.full(size.state, math.inf),
        )
        ws = driver.ws
        ws.lower[:], ws.upper[:] = problem.control_lower, problem.control_upper
        # With no change small enough, all iterations are done however good the plan is already.
        ws.run['max_iterations'], ws.run['line_search'] = ITERATIONS, 0
        ws.run['slack_tolerance'], ws.run['growth_limit'] = SLACK_TOLERANCE, math.inf
        self._outcome, self._data = ws.run['outcome'], problem.data
        self._functions = FUNCTIONS.entries(self._data, ws)
