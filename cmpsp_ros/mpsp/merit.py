"""The exact L1 merit function, and the line search along a step that lowers it."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from cmpsp_ros.mpsp.problem import Array, Evaluation, OptimalControlProblem
from cmpsp_ros.mpsp.qp.solution import QPSolution
from cmpsp_ros.mpsp.subproblem import Subproblem

_SUFFICIENT_DECREASE = 1e-4
_STEP_LENGTHS = (1.0, 0.5, 0.25, 0.125, 0.0625)
# Tried only where all of those fail, which otherwise ends the iteration.
_LAST_RESORTS = tuple(0.5**halvings for halvings in range(5, 13))
_ABOVE_MULTIPLIER = 1.1
# Rounding of a merit, relative to its magnitude: thousands of terms, and states that went through
# a whole roll-out. A smaller difference between two merits says nothing.
_ROUNDING = 1e-13
# A promise below this, relative to the same magnitude, is too close to rounding to be checked.
_UNCHECKABLE = 1e-11


@dataclass(frozen=True)
class Merit:
    """``J + terminal |Y_N - Y_N*| + path max(0, g)``, each row with a weight of its own.

    Attributes:
        terminal: Weights of the terminal outputs, shape ``(m,)``.
        path: Weights of the path constraints at each stage, shape ``(N + 1, l)``.
    """

    terminal: Array
    path: Array

    def above_multipliers(self, solution: QPSolution) -> Merit:
        """The same merit, raised where a multiplier is larger than its weight.

        Only then is the solution of the subproblem a direction of descent.
        """
        terminal = np.maximum(self.terminal, _ABOVE_MULTIPLIER * np.abs(solution.terminal))
        path = np.maximum(self.path, _ABOVE_MULTIPLIER * solution.path)
        return Merit(terminal, path)

    def value(self, evaluation: Evaluation) -> float:
        """Merit of a trajectory; infinite where it is not finite."""
        value = evaluation.cost + self.violation(evaluation)
        return value if math.isfinite(value) else math.inf

    def magnitude(self, evaluation: Evaluation) -> float:
        """What the rounding of a merit is relative to, its penalties at unit violation."""
        return abs(evaluation.cost) + float(self.terminal.sum())

    def can_check(self, promised: float, evaluation: Evaluation) -> bool:
        """Whether a promised decrease stands clear of rounding."""
        return promised > _UNCHECKABLE * self.magnitude(evaluation)

    def violation(self, evaluation: Evaluation) -> float:
        """Weighted violation of the constraints, the part of the merit that is not cost."""
        return self._weighted(evaluation.output_error, evaluation.g)

    def predicted_decrease(self, subproblem: Subproblem, dU: Array) -> float:
        """Decrease of the merit that its linearisation promises for the full step.

        Args:
            subproblem: The linearisation.
            dU: The step, shape ``(N + 1, r)``.
        """
        lin, dX = subproblem.linearisation, subproblem.propagate(dU)
        now = self._weighted(lin.output_error, lin.g)
        then = self._weighted(subproblem.terminal(dU, dX), subproblem.path(dU, dX))
        return now - then - subproblem.slope(dU, dX)

    def _weighted(self, miss: Array, g: Array) -> float:
        return float(self.terminal @ np.abs(miss) + (self.path * np.maximum(g, 0.0)).sum())


@dataclass(frozen=True)
class Trial:
    """A control history tried by the line search.

    Attributes:
        length: Step length in (0, 1], or 0 where no step lowers the merit.
        U: Controls, shape ``(N + 1, r)``.
        X: Predicted states, shape ``(N + 1, n)``.
        evaluation: Value along them.
        corrected: Whether a second-order correction bent the step.
    """

    length: float
    U: Array
    X: Array
    evaluation: Evaluation
    corrected: bool = False


Correction = Callable[[Evaluation], Array]
"""From the value after the full step to the control deviations that mend its violation."""


def search(
    problem: OptimalControlProblem,
    start: Trial,
    dU: Array,
    merit: Merit,
    promised: float,
    correction: Correction | None = None,
    longest: float = 1.0,
) -> Trial:
    """Backtrack from the full step until the merit falls by enough.

    Where the full step is refused although it does not lower the violation, the search goes back
    along the arc ``a dU + a^2 w``, with ``w`` the second-order correction.

    Args:
        problem: The problem.
        start: Where the step begins.
        dU: Search direction, shape ``(N + 1, r)``.
        merit: Merit function of this step.
        promised: Its predicted decrease for the full step.
        correction: Gives ``w``; None for none.
        longest: Step length to begin with.

    Returns:
        The first trial that keeps its promise, else the best one that lowers the merit at all,
        else the start with step length 0. A rise within rounding counts as none.
    """
    before = merit.value(start.evaluation)

    def keeps_promise(trial: Trial) -> bool:
        wanted = before - _SUFFICIENT_DECREASE * trial.length * max(promised, 0.0)
        value = merit.value(trial.evaluation)
        return value <= wanted or value <= wanted + _ROUNDING * merit.magnitude(start.evaluation)

    first = _trial(problem, start, dU, None, longest)
    if keeps_promise(first):
        return first
    trials, bend = [first], None
    if correction is not None and longest == 1.0:
        bend = _bend(start, first, dU, merit, correction)
    for length in _STEP_LENGTHS:
        # The first one again only if it is now a different one.
        if length > longest or (length == longest and bend is None):
            continue
        trials.append(_trial(problem, start, dU, bend, length))
        if keeps_promise(trials[-1]):
            return trials[-1]
    best = min(trials, key=lambda trial: merit.value(trial.evaluation))
    if merit.value(best.evaluation) < before:
        return best
    shorter = (_trial(problem, start, dU, bend, length) for length in _LAST_RESORTS)
    return _first_lower(shorter, merit, before) or Trial(0.0, start.U, start.X, start.evaluation)


def _first_lower(trials: Iterator[Trial], merit: Merit, before: float) -> Trial | None:
    return next((trial for trial in trials if merit.value(trial.evaluation) < before), None)


def _bend(
    start: Trial, full: Trial, dU: Array, merit: Merit, correction: Correction
) -> Array | None:
    """The correction, where violation is what the full step is refused for, and it is small."""
    violation = merit.violation(full.evaluation)
    if not (np.isfinite(violation) and violation > merit.violation(start.evaluation)):
        return None
    bend = correction(full.evaluation)
    # A correction as long as the step itself is none: the constraints bend too much for it.
    return bend if np.linalg.norm(bend) < np.linalg.norm(dU) else None


def _trial(
    problem: OptimalControlProblem, start: Trial, dU: Array, bend: Array | None, length: float
) -> Trial:
    U = start.U + length * dU
    if bend is not None:
        U += length * length * bend
    U = np.clip(U, problem.control_lower, problem.control_upper)
    X = problem.predict(U)
    return Trial(length, U, X, problem.evaluate(X, U), bend is not None)
