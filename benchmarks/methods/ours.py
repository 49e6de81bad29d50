"""The project's own methods of a control step: two iterations from a warm start."""

import math
from collections.abc import Callable
from typing import NamedTuple, Protocol

import numpy as np

from benchmarks.common import BenchError
from benchmarks.task import Task
from cmpsp_ros.arrays import Array
from cmpsp_ros.guidance import (
    GuidanceLaw,
    GuidanceSettings,
    Observation,
    Plan,
    remaining,
    shift,
    to_nanoseconds,
)
from cmpsp_ros.guidance.formulation import FUNCTIONS, OcpFormulation
from cmpsp_ros.guidance.planning import Planner, PlanningContext
from cmpsp_ros.guidance.safety import Validator
from cmpsp_ros.mpsp import SLACK_TOLERANCE, Options
from cmpsp_ros.mpsp.qp.riccati import Outcome
from cmpsp_ros.mpsp.sqp import CMPSP, Driver

ITERATIONS = 2  # iterations of a control step

PENALTY = 1e4  # largest multiplier of a row that is relaxed because no point meets all of them


class Method(Protocol):
    """One way to do a control step."""

    name: str  # for tables and pictures
    largest: int  # longest horizon that it is worth being asked for [steps]

    def prepare(self, steps: int) -> None:
        """Do the offline work for horizons of that many steps."""

    def begin(self, steps: int) -> None:
        """Reset: a new run of that many steps begins."""

    def step(self, pose: Array, U: Array, durations: Array) -> Array:
        """Improve a control history; this alone is timed.

        Args:
            pose: Pose of the robot, shape ``(3,)`` [m, m, rad].
            U: Warm start, shape ``(N + 1, 2)`` [rad/s]; to be left as it is.
            durations: Lengths of the steps, shape ``(N,)`` [s].

        Returns:
            Controls, shape ``(N + 1, 2)`` [rad/s].
        """


class CondensedDaqp:
    """Bare iterations on the condensed program, solved by daqp: no line search, no audit."""

    name = 'condensed + daqp'
    largest = 200

    def __init__(self, task: Task) -> None:
        """Take the task."""
        self.task = task

    def prepare(self, steps: int) -> None:
        """Nothing depends on the horizon alone."""

    def begin(self, steps: int) -> None:
        """Nothing is carried from step to step but the controls."""

    def step(self, pose: Array, U: Array, durations: Array) -> Array:
        """Two iterations."""
        problem = self.task.problem(pose, durations)
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


class RiccatiActiveSet:
    """Bare iterations along the stages, in compiled code: no line search, no audit.

    The active rows of a step are the warm start of the next one, as in the guidance law.
    """

    name = 'riccati active set'
    largest = 400

    def __init__(self, task: Task) -> None:
        """Take the task."""
        self.task = task
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
        """Two iterations."""
        steps, ws = len(durations), self._driver.ws
        over, self._left = self._left - steps, steps
        ws.trial.U[: steps + 1] = U
        data = self._data._replace(pose=pose, durations=durations, progress=math.nan)
        self._driver.improve(self._functions, data, steps, over)
        if self._driver.results.outcome != Outcome.SOLVED:
            raise BenchError('it does not solve one of its programs')
        return ws.now.U[: steps + 1].copy()

    def _allocate(self, steps: int) -> None:
        pose, durations = self.task.pose, self.task.durations(steps)
        problem = self.task.problem(pose, durations)
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
        self._data = problem.data
        self._functions = FUNCTIONS.entries(self._data, ws)


class _Parts(NamedTuple):
    """Components of a step, for one control period [ns] and final time [ns]."""

    settings: GuidanceSettings
    planner: Planner
    validator: Validator
    period: int
    final: int


class FullStep:
    """One plan of the guidance law: warm start, iterations with line search, audit.

    It keeps clear of everything between samples as far as its own control period asks for. That
    is the task's space at 50 steps only; fewer have less room, and with a few there is none.

    Attributes:
        elastic: Steps of this run in which the last program needed slack.
    """

    name = 'riccati active set, full step'
    largest = 400

    def __init__(self, task: Task) -> None:
        """Take the task."""
        self.task = task
        self._made: dict[int, _Parts] = {}

    def prepare(self, steps: int) -> None:
        """Nothing depends on the steps that are left."""

    def begin(self, steps: int) -> None:
        """Forget the plan."""
        if steps not in self._made:
            settings = self.task.settings_for(steps)
            period, final = map(to_nanoseconds, (settings.control_period, settings.final_time))
            self._made[steps] = _Parts(
                settings,
                Planner(OcpFormulation(settings, settings.world)),
                Validator(settings),
                period,
                final,
            )
        self._parts = self._made[steps]
        self._parts.planner.forget()
        self._plan: Plan | None = None
        self._held = np.zeros(2)
        self._now = self.elastic = 0

    def step(self, pose: Array, U: Array, durations: Array) -> Array:  # noqa: ARG002 (by the clock)
        """Shift, improve, audit."""
        settings, planner, validator, period, final = self._parts
        horizon = remaining(self._now, period, final)
        guess = U if self._plan is None else shift(self._plan.controls, self._plan.horizon, horizon)
        context = PlanningContext.at_pose(settings, settings.world, pose, horizon, self._held)
        result = planner.improve(context, guess)
        plan = result.plan
        verdict = validator.check(context.start, plan.controls, horizon.durations)
        if not result.solved:
            raise BenchError(result.reason)
        if not verdict.passed:
            raise BenchError(verdict.reason)
        self._plan, self._held = plan, plan.controls[0]
        self._now += period
        self.elastic += result.elastic
        return plan.controls


class Law:
    """The guidance law itself, from a pose to a decision; the remark on `FullStep` holds as well.

    It makes its own first guess and keeps its own plan; where a plan needs slack it makes a second
    one.
    """

    name = 'guidance law'
    largest = 400

    def __init__(self, task: Task) -> None:
        """Take the task."""
        self.task = task
        self._made: dict[int, tuple[GuidanceLaw, int]] = {}

    def prepare(self, steps: int) -> None:
        """Nothing depends on the steps that are left."""

    def begin(self, steps: int) -> None:
        """Reset the law."""
        if steps not in self._made:
            settings = self.task.settings_for(steps)
            self._made[steps] = (
                GuidanceLaw(settings, settings.world),
                to_nanoseconds(settings.control_period),
            )
        self._law, self._period = self._made[steps]
        self._law.reset()
        self._stamp = 0

    def step(self, pose: Array, U: Array, durations: Array) -> Array:  # noqa: ARG002 (its own)
        """Decide."""
        decision = self._law.step(Observation(self._stamp, pose))
        if decision is None or decision.plan is None:
            raise BenchError(decision.reason if decision else 'it has nothing to decide')
        self._stamp += self._period
        return decision.plan.controls


# The first of them is what all others are compared with; the rest are what is driven with.
OURS: tuple[Callable[[Task], Method], ...] = (CondensedDaqp, RiccatiActiveSet, FullStep, Law)
