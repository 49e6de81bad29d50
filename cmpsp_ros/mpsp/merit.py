"""The exact L1 merit function, and the line search along a step that lowers it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cmpsp_ros.mpsp.condensing import CondensedQP
from cmpsp_ros.mpsp.problem import Array, Evaluation, OptimalControlProblem
from cmpsp_ros.mpsp.qp.solution import QPSolution

_SUFFICIENT_DECREASE = 1e-4
_STEP_LENGTHS = (1.0, 0.5, 0.25, 0.125, 0.0625)
_ABOVE_MULTIPLIER = 1.1


@dataclass(frozen=True)
class Merit:
    """``J + terminal |Y_N - Y_N*| + path max(0, g)``, each row with a weight of its own.

    Attributes:
        terminal: Weights of the terminal outputs, shape ``(m,)``.
        path: Weights of the path constraints at each stage, shape ``(N + 1, l)``.
    """

    terminal: Array
    path: Array

    def above_multipliers(self, qp: CondensedQP, solution: QPSolution) -> Merit:
        """The same merit, raised where a multiplier is larger than its weight.

        Only then is the solution of the subproblem a direction of descent.
        """
        terminal = np.maximum(self.terminal, _ABOVE_MULTIPLIER * np.abs(solution.terminal))
        path = self.path.copy()
        rows = qp.path_stage, qp.path_index
        path[rows] = np.maximum(path[rows], _ABOVE_MULTIPLIER * solution.path)
        return Merit(terminal, path)

    def value(self, evaluation: Evaluation) -> float:
        """Merit of a trajectory; infinite where it is not finite."""
        miss = self.terminal @ np.abs(evaluation.output_error)
        violation = (self.path * np.maximum(evaluation.g, 0.0)).sum()
        value = float(evaluation.cost + miss + violation)
        return value if np.isfinite(value) else np.inf

    def predicted_decrease(self, qp: CondensedQP, dU: Array) -> float:
        """Decrease of the merit that its linearisation promises for the full step."""
        weights = self.path[qp.path_stage, qp.path_index]
        now = self.terminal @ np.abs(qp.output_error) + weights @ np.maximum(-qp.g, 0.0)
        miss = np.abs(qp.S_N @ dU + qp.output_error)
        then = qp.c @ dU + self.terminal @ miss + weights @ np.maximum(qp.B_C @ dU - qp.g, 0.0)
        return float(now - then)


@dataclass(frozen=True)
class Trial:
    """A control history tried by the line search.

    Attributes:
        length: Step length in (0, 1], or 0 where no step lowers the merit.
        U: Controls, shape ``(N + 1, r)``.
        X: Predicted states, shape ``(N + 1, n)``.
        evaluation: Value along them.
    """

    length: float
    U: Array
    X: Array
    evaluation: Evaluation


def search(
    problem: OptimalControlProblem, start: Trial, dU: Array, merit: Merit, promised: float
) -> Trial:
    """Backtrack from the full step until the merit falls by enough.

    Args:
        problem: The problem.
        start: Where the step begins.
        dU: Search direction, shape ``(N + 1, r)``.
        merit: Merit function of this step.
        promised: Its predicted decrease for the full step.

    Returns:
        The first trial that keeps its promise, else the best one that lowers the merit at all,
        else the start with step length 0.
    """
    before = merit.value(start.evaluation)
    best, least = Trial(0.0, start.U, start.X, start.evaluation), before
    for length in _STEP_LENGTHS:
        U = np.clip(start.U + length * dU, problem.control_lower, problem.control_upper)
        X = problem.predict(U)
        trial = Trial(length, U, X, problem.evaluate(X, U))
        value = merit.value(trial.evaluation)
        if value <= before - _SUFFICIENT_DECREASE * length * max(promised, 0.0):
            return trial
        if value < least:
            best, least = trial, value
    return best
