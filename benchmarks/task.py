"""The task for all methods: Case 3 or another preset, with any number of steps."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from benchmarks.drives import Preset
from cmpsp_ros.arrays import Array
from cmpsp_ros.guidance import GuidanceSettings
from cmpsp_ros.guidance.formulation import (
    GuidanceData,
    GuidanceProblem,
    guidance_data,
    sample_space,
)
from cmpsp_ros.guidance.planning import initial_guess
from cmpsp_ros.guidance.prediction import PlanStart
from cmpsp_ros.world import FreeSpace

_LARGEST_VIOLATION = 1e-3


@dataclass(frozen=True)
class TaskOutcome:
    """Outcome of a control history, by the project's own model: first term of (95), miss [m].

    The violation of road edges and obstacles at the samples [m] is negative if they are clear.
    """

    cost: float
    miss: float
    violation: float
    wheel_speed: float


@dataclass(frozen=True, eq=False)
class Task:
    """A preset at any number of steps: the same time, road, obstacles, start and guess.

    The space to keep to at the samples is that of the preset's own control period at every number
    of steps. It would be empty with ten steps otherwise, and another problem with each number.
    """

    settings: GuidanceSettings
    pose: Array
    space: FreeSpace

    @classmethod
    def case3(cls) -> Task:
        """The preset `case3`."""
        return cls.of(Preset.load('case3'))

    @classmethod
    def of(cls, preset: Preset) -> Task:
        """The task of a preset."""
        # One plan, as every method has; how many iterations it begins with is the methods' own.
        given = preset.settings.solver
        solver = replace(given, candidates=1, initial_iterations=given.iterations_per_step)
        settings = replace(preset.settings, solver=solver)
        return cls(settings, preset.pose, sample_space(settings, settings.world))

    @property
    def steps(self) -> int:
        """Control periods in the preset's time."""
        return round(self.settings.final_time / self.settings.control_period)

    def durations(self, steps: int) -> Array:
        """Lengths of the steps, shape ``(N,)`` [s]."""
        return np.full(steps, self.settings.final_time / steps)

    def guess(self, steps: int) -> Array:
        """The preset's first control history, shape ``(N + 1, 2)`` [rad/s]."""
        return initial_guess(
            self.settings,
            PlanStart(self.pose, self.settings.robot, self.settings.world),
            self.settings.target,
            self.durations(steps),
        )

    def settings_for(self, steps: int) -> GuidanceSettings:
        """The preset's settings with that many control periods."""
        return replace(self.settings, control_period=self.settings.final_time / steps)

    def problem(self, pose: Array, durations: Array) -> GuidanceProblem:
        """Problem from ``pose (3,)`` [m, m, rad] on; ``durations (n,)`` of the steps left [s]."""
        settings = self.settings
        goal = np.array(settings.goal)
        return GuidanceProblem(settings.robot, self.space, settings.weights, pose, goal, durations)

    def data(self, pose: Array, durations: Array) -> GuidanceData:
        """The same for compiled code."""
        settings = self.settings
        goal = np.array(settings.goal)
        return guidance_data(settings.robot, self.space, settings.weights, pose, goal, durations)

    def outcome(self, U: Array) -> TaskOutcome:
        """Outcome of a control history ``U (N + 1, 2)`` [rad/s] over the whole time."""
        problem = self.problem(self.pose, self.durations(len(U) - 1))
        evaluation = problem.evaluate(problem.predict(U), U)
        return TaskOutcome(
            evaluation.cost,
            float(np.linalg.norm(evaluation.output_error)),
            float(evaluation.g.max()),
            float(np.abs(U).max()),
        )

    def failure(self, outcome: TaskOutcome) -> str:
        """Reason why an outcome does not solve the task, '' if it does."""
        settings = self.settings
        if not outcome.miss <= settings.goal_tolerance:
            return f'it misses the goal by {outcome.miss:.3g} m'
        if not outcome.violation <= _LARGEST_VIOLATION:
            return f'it comes {outcome.violation:.3g} m too close to an edge or an obstacle'
        limit = settings.robot.max_wheel_speed
        if not outcome.wheel_speed <= limit * (1.0 + _LARGEST_VIOLATION):
            return f'its wheels turn at {outcome.wheel_speed:.4g} rad/s, the limit is {limit:g}'
        return ''
