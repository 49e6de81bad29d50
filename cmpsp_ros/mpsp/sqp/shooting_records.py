"""Points, directions and steps of multiple shooting, and how violation is weighed."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from cmpsp_ros.arrays import Array
from cmpsp_ros.mpsp.problem import Evaluation
from cmpsp_ros.mpsp.qp import Penalties, QPSolution, QPStatus
from cmpsp_ros.mpsp.results import Iterate, Step
from cmpsp_ros.mpsp.sqp.lagrangian import Curvature, multipliers


class Point(NamedTuple):
    """States, controls, their evaluation, gaps ``(N, n)``, and the sum of all violations."""

    X: Array
    U: Array
    evaluation: Evaluation
    gaps: Array
    violation: float

    @property
    def is_finite(self) -> bool:
        """True where cost and violation are."""
        return bool(np.isfinite(self.evaluation.cost + self.violation))


class Direction(NamedTuple):
    """Step of a subproblem, its multipliers, and the violation that its linearisation leaves."""

    dX: Array
    dU: Array
    solution: QPSolution
    convex: Curvature
    shift: float
    is_relaxed: bool
    weights: Penalties
    slack_terminal: Array
    slack_path: Array

    @property
    def slack(self) -> float:
        """Violation of the linearised constraints."""
        return float(np.abs(self.slack_terminal).sum() + self.slack_path.sum())

    def left(self, weights: Penalties) -> float:
        """Weighted violation of the linearised constraints."""
        return _weighted(self.slack_terminal, self.slack_path, weights)

    def merit_weights(self, above: float) -> Penalties:
        """Weights of the merit: the penalties at work, `above` all multipliers for hard rows."""
        terminal, path = self.weights.terminal, self.weights.path
        return Penalties(
            np.where(np.isinf(terminal), above, terminal), np.where(np.isinf(path), above, path)
        )


def _weighted(terminal: Array, path: Array, weights: Penalties) -> float:
    return float(np.abs(terminal) @ weights.terminal + np.vdot(np.maximum(path, 0.0), weights.path))


def weighted_violation(point: Point, of_gaps: float, weights: Penalties) -> float:
    """Weighted violation: what a merit adds to the cost."""
    value = point.evaluation
    return of_gaps * float(np.abs(point.gaps).sum()) + _weighted(
        value.output_error, value.g, weights
    )


def relaxation_levels(weights: Penalties) -> list[Penalties]:
    """Penalties of hard rows alone; with the lightest finite; the next lightest too; all."""
    both = np.concatenate([weights.terminal, weights.path.ravel()])
    *lightest, heaviest = np.unique(both) if both.size else np.zeros(1)
    return [
        Penalties(
            np.where(weights.terminal <= limit, weights.terminal, np.inf),
            np.where(weights.path <= limit, weights.path, np.inf),
        )
        for limit in (-np.inf, *lightest[:2], heaviest)
    ]


def not_finite(at: Iterate, found: Curvature) -> Step:
    """Summary of a step that could not be looked for."""
    lin = found.linearisation
    terminal, path, bounds = multipliers(at, lin)
    return Step(
        QPStatus.FAILED, False, np.zeros_like(terminal), np.zeros_like(path), 0.0, terminal, path,
        bounds, 0, 0, not_finite=lin.not_finite or 'the curvature of the constraints',
    )  # fmt: skip


def summary(at: Iterate, way: Direction, found: Curvature, length: float) -> Step:
    """Summary of a step; multipliers move as far as the controls do."""
    solution, lin = way.solution, found.linearisation
    before = multipliers(at, lin)
    new = solution.terminal, solution.path, solution.bounds
    terminal, path, bounds = (
        old + length * (then - old) for old, then in zip(before, new, strict=True)
    )
    change, whole = (np.linalg.norm(each, axis=1).sum() for each in (way.dU, at.U))
    return Step(
        solution.status,
        way.is_relaxed,
        way.slack_terminal,
        way.slack_path,
        length,
        terminal,
        path,
        bounds,
        int(np.count_nonzero(path) + np.count_nonzero(bounds)),
        solution.iterations,
        float(change / (whole or 1.0)),
        way.shift,
    )
