"""Control steps as the guidance law does them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from benchmarks.errors import BenchError
from benchmarks.families.task import Task
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
from cmpsp_ros.guidance.formulation import OcpFormulation
from cmpsp_ros.guidance.planning import Planner, PlanningContext
from cmpsp_ros.guidance.safety import Audit


class _Parts(NamedTuple):
    """What a step is put together from, for one control period [ns] and final time [ns]."""

    settings: GuidanceSettings
    planner: Planner
    audit: Audit
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
        self._task = task
        self._made: dict[int, _Parts] = {}

    def prepare(self, steps: int) -> None:
        """Nothing depends on the steps that are left."""

    def begin(self, steps: int) -> None:
        """Forget the plan."""
        if steps not in self._made:
            settings = self._task.settings_for(steps)
            period, final = map(to_nanoseconds, (settings.control_period, settings.final_time))
            self._made[steps] = _Parts(
                settings,
                Planner(OcpFormulation(settings, settings.world)),
                Audit(settings),
                period,
                final,
            )
        self._parts = self._made[steps]
        self._parts.planner.forget()
        self._plan: Plan | None = None
        self._held = np.zeros(2)
        self._now = self.elastic = 0

    def step(self, pose: Array, U: Array, durations: Array) -> Array:  # noqa: ARG002 (by the clock)
        """Shift, improve, audit.

        Raises:
            BenchError: The plan may not be followed.
        """
        settings, planner, audit, period, final = self._parts
        horizon = remaining(self._now, period, final)
        guess = U if self._plan is None else shift(self._plan.controls, self._plan.horizon, horizon)
        context = PlanningContext.at_pose(settings, settings.world, pose, horizon, self._held)
        result = planner.improve(context, guess)
        plan = result.plan
        verdict = audit.check(context.start, plan.controls, horizon.durations)
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
        self._task = task
        self._made: dict[int, tuple[GuidanceLaw, int]] = {}

    def prepare(self, steps: int) -> None:
        """Nothing depends on the steps that are left."""

    def begin(self, steps: int) -> None:
        """Reset the law."""
        if steps not in self._made:
            settings = self._task.settings_for(steps)
            self._made[steps] = (
                GuidanceLaw(settings, settings.world),
                to_nanoseconds(settings.control_period),
            )
        self._law, self._period = self._made[steps]
        self._law.reset()
        self._stamp = 0

    def step(self, pose: Array, U: Array, durations: Array) -> Array:  # noqa: ARG002 (its own)
        """Decide.

        Raises:
            BenchError: The decision is to stop.
        """
        decision = self._law.step(Observation(self._stamp, pose))
        if decision is None or decision.plan is None:
            raise BenchError(decision.reason if decision else 'it has nothing to decide')
        self._stamp += self._period
        return decision.plan.controls
