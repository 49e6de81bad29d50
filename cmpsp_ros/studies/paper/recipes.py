"""Other controllers for the same runs, to measure the benefit of the law's additions to the paper.

They use the method and the model of the guidance law, but nothing of the law itself: no new plan
beside a defective one, no audit, no fallback levels.
"""

from __future__ import annotations

from dataclasses import replace
from enum import Enum
from typing import Any

import numpy as np

from cmpsp_ros.arrays import Array
from cmpsp_ros.guidance import GuidanceSettings, remaining, shift, to_nanoseconds
from cmpsp_ros.guidance.formulation import (
    N_EDGE_CONSTRAINTS,
    PENALTIES,
    GuidanceProblem,
    sample_space,
)
from cmpsp_ros.guidance.planning import initial_guess
from cmpsp_ros.guidance.prediction import PlanStart
from cmpsp_ros.mpsp import Evaluation, Hessian, Linearisation, Options
from cmpsp_ros.mpsp.sqp import CMPSP
from cmpsp_ros.robots import Robot
from cmpsp_ros.studies.paper.drives import Path, drive_open
from cmpsp_ros.studies.paper.experiments import Experiment
from cmpsp_ros.world import FreeSpace


class Recipe(Enum):
    """How the two iterations of a control step are computed.

    Attributes:
        AS_WRITTEN: Squared constraints (92) (93), hard, and the full step (43).
        ONE_PLAN: The law's relaxation, trust region and line search, but the warm start alone.
    """

    AS_WRITTEN = 'as written'
    ONE_PLAN = 'one plan'


class SquaredConstraints(GuidanceProblem):
    """The same problem with the squared distances of (92) and (93)."""

    def __init__(self, robot: Robot, space: FreeSpace, *rest: Any) -> None:
        """Set the problem up; arguments as of `GuidanceProblem`."""
        super().__init__(robot, space, *rest)
        edges = space.annulus
        self._centers = np.vstack([edges.center, edges.center, space.centers])
        self._radii = np.concatenate([edges.outer, edges.inner, space.radii])

    def evaluate(self, X: Array, U: Array) -> Evaluation:
        """Value, miss and violations [m^2]."""
        evaluation = super().evaluate(X, U)
        return replace(evaluation, g=evaluation.g * (self._distance(X) + self._radii))

    def linearise(self, X: Array, U: Array, hessian: Hessian = 'gauss_newton') -> Linearisation:
        """Derivatives, by the product rule from those of the distances."""
        linear = super().linearise(X, U, hessian)
        distance = self._distance(X)
        return replace(
            linear,
            g=linear.g * (distance + self._radii),
            g_X=linear.g_X * (2.0 * distance[:, :, None]),
        )

    def _distance(self, X: Array) -> Array:
        away: Array = np.linalg.norm(X[:, None, :2] - self._centers, axis=2)
        return away


def follow(experiment: Experiment, recipe: Recipe, *, between_samples: bool = False) -> Path:
    """Drive a run of the paper by one of the recipes, two iterations a control step.

    Args:
        experiment: The run.
        recipe: How to iterate.
        between_samples: Whether the path between samples is to be kept clear too.
    """
    settings = experiment.with_bound(between_samples)
    pose = np.array(experiment.pose)
    period, final = to_nanoseconds(settings.control_period), to_nanoseconds(settings.final_time)
    horizon = remaining(0, period, final)
    plan = initial_guess(
        settings,
        PlanStart(pose, settings.robot, settings.world),
        settings.target,
        horizon.durations,
    )
    driven = []
    for now in range(0, final, period):
        later = remaining(now, period, final)
        plan = _improve(settings, recipe, pose, shift(plan, horizon, later), later.durations)
        horizon = later
        driven.append(plan[0])
        pose = settings.robot.roll_out(pose, plan[:1], later.durations[:1])[-1]
    return drive_open(settings, np.array(experiment.pose), np.array(driven))


def _improve(
    settings: GuidanceSettings, recipe: Recipe, pose: Array, guess: Array, durations: Array
) -> Array:
    goal = np.array(settings.goal)
    kind = SquaredConstraints if recipe is Recipe.AS_WRITTEN else GuidanceProblem
    space = sample_space(settings, settings.world)
    problem = kind(settings.robot, space, settings.weights, pose, goal, durations)
    obstacles = [PENALTIES['obstacle']] * len(settings.obstacles)
    adds = recipe is Recipe.ONE_PLAN
    options = Options(
        penalty_terminal=np.full(2, PENALTIES['terminal_error']),
        penalty_path=np.array([PENALTIES['edge']] * N_EDGE_CONSTRAINTS + obstacles),
        elastic=adds,
        line_search=adds,
        trust_radius=(
            np.array([np.inf, np.inf, settings.solver.heading_trust_region]) if adds else None
        ),
    )
    iteration = CMPSP(problem, options)
    iterate = iteration.init(guess)
    for _ in range(settings.solver.iterations_per_step):
        iterate = iteration.step(iterate)
    return iterate.U
