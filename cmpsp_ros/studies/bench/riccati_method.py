"""The compiled iteration by itself."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

# Imported whole: a file that takes names from it counts as one with kernels of its own.
from cmpsp_ros.mpsp.jit import compiled
from cmpsp_ros.mpsp.iterate import SLACK_TOLERANCE
from cmpsp_ros.mpsp.realtime.iteration import OUTCOME, Rules, improve
from cmpsp_ros.mpsp.realtime.packed import pack
from cmpsp_ros.mpsp.realtime.workspace import workspace
from cmpsp_ros.mpsp.riccati.outcome import SOLVED
from cmpsp_ros.robot.guidance_problem import begun_at
from cmpsp_ros.studies.bench.errors import BenchError
from cmpsp_ros.studies.bench.methods import ITERATIONS, PENALTY
from cmpsp_ros.studies.bench.task import Task

Array = NDArray[np.float64]

# With no change small enough, all iterations are done however good the plan is already.
_RULES = Rules(
    iterations=ITERATIONS,
    line_search=False,
    output_tolerance=0.0,
    control_tolerance=0.0,
    violation_tolerance=0.0,
    slack_tolerance=SLACK_TOLERANCE,
    growth_limit=math.inf,
)


class RiccatiActiveSet:
    """Bare iterations along the stages, in compiled code: no line search, no audit.

    The active rows of a step are the hint of the next one, as in the guidance law.
    """

    name = 'riccati active set'
    largest = 400

    def __init__(self, task: Task) -> None:
        """Take the task."""
        self._task = task
        self._make_room(1)

    def prepare(self, steps: int) -> None:
        """Make room for the longest horizon."""
        if steps >= len(self._room.lower):
            self._make_room(steps)

    def begin(self, steps: int) -> None:
        """Forget the active rows: all stages of the last plan count as over."""
        self._left = steps + len(self._room.lower)

    def step(self, pose: Array, U: Array, durations: Array) -> Array:
        """Two iterations.

        Raises:
            BenchError: A program was not solved.
        """
        steps, room = len(durations), self._room
        over, self._left = self._left - steps, steps
        room.at.U[: steps + 1] = U
        data = begun_at(self._data, pose, durations, math.nan)
        self._improve(data, self._packed, steps, over, _RULES)
        if room.counts[OUTCOME] != SOLVED:
            raise BenchError('it does not solve one of its programs')
        return room.at.U[: steps + 1].copy()

    def _make_room(self, steps: int) -> None:
        pose, durations = self._task.pose, self._task.durations(steps)
        problem = self._task.problem(pose, durations)
        size = problem.size
        room = workspace(
            size,
            np.full(size.output, PENALTY),
            np.full(size.path, PENALTY),
            np.full(size.state, math.inf),
        )
        room.lower[:], room.upper[:] = problem.control_lower, problem.control_upper
        self._packed, self._room = pack(room)
        self._data = problem.data
        self._improve = compiled.entry_for(improve, self._data, self._packed, steps, 0, _RULES)
