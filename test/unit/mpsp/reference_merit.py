"""The exact merit by its definition, in a few lines of numpy."""

import math
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Merit:
    """``J + terminal |Y_N - Y_N*| + path max(0, g)``; weights of shape ``(m,)``, ``(N + 1, l)``."""

    terminal: np.ndarray
    path: np.ndarray

    def above_multipliers(self, solution):
        terminal = np.maximum(self.terminal, 1.1 * np.abs(solution.terminal))
        return Merit(terminal, np.maximum(self.path, 1.1 * solution.path))

    def value(self, evaluation):
        value = evaluation.cost + self.violation(evaluation)
        return value if math.isfinite(value) else math.inf

    def magnitude(self, evaluation):
        return abs(evaluation.cost) + self.terminal.sum()

    def violation(self, evaluation):
        return self._weighted(evaluation.output_error, evaluation.g)

    def predicted_decrease(self, subproblem, dU):
        lin, dX = subproblem.linearisation, subproblem.propagate(dU)
        now = self._weighted(lin.output_error, lin.g)
        then = self._weighted(subproblem.terminal(dU, dX), subproblem.path(dU, dX))
        return now - then - np.vdot(lin.L_X, dX) - np.vdot(lin.L_U, dU)

    def _weighted(self, error, g):
        return self.terminal @ np.abs(error) + (self.path * np.maximum(g, 0.0)).sum()
