"""The C-MPSP iteration of Sec. 4 as a state machine: `init`, `step`, `terminate`."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from cmpsp_ros.mpsp.condensing import CondensedQP, condense
from cmpsp_ros.mpsp.errors import ProblemError
from cmpsp_ros.mpsp.merit import Merit, Trial, search
from cmpsp_ros.mpsp.problem import Array, Evaluation, Hessian, OptimalControlProblem
from cmpsp_ros.mpsp.qp import Penalties, QPSolution, QPStatus, backend, solve_qp
from cmpsp_ros.mpsp.status import Status

SLACK_TOLERANCE = 1e-6
"""Violation of a linearised constraint up to which it counts as met."""


@dataclass(frozen=True)
class Options:
    """How the iteration is run.

    Attributes:
        qp: Name of the QP back end.
        hessian: Which Hessian of the cost.
        penalty_terminal: Weight of each terminal output in merit and relaxation, shape ``(m,)``.
        penalty_path: Weight of each path constraint in merit and relaxation, shape ``(l,)``.
        elastic: Whether a subproblem without a feasible point is solved relaxed.
        trust_radius: Largest predicted change of each state component in one iteration, shape
            ``(n,)``, infinite where free; None for no trust region.
        line_search: Whether a step is shortened until it lowers the merit; the paper's iteration
            (43) takes the full step.
        output_tolerance: ``eps_Y`` of Sec. 4.
        control_tolerance: ``eps_U`` of Sec. 4.
    """

    penalty_terminal: Array
    penalty_path: Array
    qp: str = 'daqp'
    hessian: Hessian = 'gauss_newton'
    elastic: bool = True
    trust_radius: Array | None = None
    line_search: bool = True
    output_tolerance: float = 1e-9
    control_tolerance: float = 1e-6


@dataclass(frozen=True)
class Step:
    """What one iteration did.

    Attributes:
        qp_status: How the subproblem ended.
        elastic: Whether it had to be relaxed.
        slack_terminal: Violation of the linearised terminal constraint that was left, ``(m,)``.
        slack_path: Violation of the linearised path constraints that was left, ``(N + 1, l)``.
        length: Step length taken; 0 where no step was.
        terminal_multipliers: ``lambda``, shape ``(m,)``.
        path_multipliers: ``rho``, shape ``(N + 1, l)``.
        active_rows: Number of path rows, trust rows and bounds that are active.
        qp_iterations: Iterations of the QP back end.
    """

    qp_status: QPStatus
    elastic: bool
    slack_terminal: Array
    slack_path: Array
    length: float
    terminal_multipliers: Array
    path_multipliers: Array
    active_rows: int
    qp_iterations: int

    @property
    def slack(self) -> float:
        """Largest violation that the relaxation left in the linearised constraints."""
        parts = np.abs(self.slack_terminal).max(initial=0.0), self.slack_path.max(initial=0.0)
        return float(max(parts))

    @property
    def needed_slack(self) -> bool:
        """Whether the relaxation left a violation."""
        return self.elastic and self.slack > SLACK_TOLERANCE


@dataclass(frozen=True)
class Iterate:
    """State of the iteration.

    Attributes:
        index: Iterations done, ``i``.
        U: Controls, shape ``(N + 1, r)``.
        X: Predicted states, shape ``(N + 1, n)``.
        evaluation: Value along them.
        previous_U: Controls before the last step; None at the start.
        step: The last step; None at the start.
    """

    index: int
    U: Array
    X: Array
    evaluation: Evaluation
    previous_U: Array | None = field(default=None)
    step: Step | None = field(default=None)

    @property
    def is_finite(self) -> bool:
        """Whether prediction and cost are finite numbers."""
        return bool(np.isfinite(self.X).all() and np.isfinite(self.evaluation.cost))


class CMPSP:
    """The iteration for one problem: predict, linearise, condense, solve, update (43)."""

    def __init__(self, problem: OptimalControlProblem, options: Options) -> None:
        """Take the problem and the options.

        Raises:
            ProblemError: An option does not fit the problem, or its back end is not installed.
        """
        size = problem.size
        for name, length in (('penalty_terminal', size.output), ('penalty_path', size.path)):
            found = getattr(options, name).shape
            if found != (length,):
                raise ProblemError(f'{name}: found shape {found}, wanted {(length,)}')
        if options.trust_radius is not None and options.trust_radius.shape != (size.state,):
            found = options.trust_radius.shape
            raise ProblemError(f'trust_radius: found shape {found}, wanted {(size.state,)}')
        backend(options.qp)
        self._problem = problem
        self._options = options
        stages = size.horizon + 1
        self._merit = Merit(options.penalty_terminal, np.tile(options.penalty_path, (stages, 1)))

    def init(self, U: Array) -> Iterate:
        """Predict along a guessed control history, brought within its bounds.

        Args:
            U: Guess ``U^0``, shape ``(N + 1, r)``.

        Raises:
            ProblemError: The guess has the wrong shape or is not finite.
        """
        self._problem.check_controls(U)
        U = np.clip(U, self._problem.control_lower, self._problem.control_upper)
        X = self._problem.predict(U)
        return Iterate(0, U, X, self._problem.evaluate(X, U))

    def step(self, at: Iterate) -> Iterate:
        """One iteration; an iterate that cannot be improved keeps its controls."""
        options, problem = self._options, self._problem
        linearisation = problem.linearise(at.X, at.U, options.hessian)
        lower, upper = problem.control_lower - at.U, problem.control_upper - at.U
        qp = condense(linearisation, lower, upper, options.trust_radius)
        solution, penalties = self._solve(qp)
        trial = Trial(0.0, at.U, at.X, at.evaluation)
        if solution.status is QPStatus.SOLVED:
            trial = self._advance(trial, qp, solution)
        return Iterate(
            at.index + 1,
            trial.U,
            trial.X,
            trial.evaluation,
            at.U,
            _record(qp, solution, penalties is not None, trial.length, self._merit.path.shape),
        )

    def terminate(self, at: Iterate) -> Status | None:
        """Status where the iteration is over by itself, else None.

        The terminal error is relative to ``Y_N*`` as in Sec. 4, absolute where ``Y_N*`` is 0.
        """
        if not at.is_finite:
            return Status.NOT_FINITE
        if at.step is None or at.previous_U is None:
            return None
        if at.step.qp_status is not QPStatus.SOLVED:
            return Status.QP_FAILED
        if at.step.length == 0.0:
            return Status.STALLED
        change = np.linalg.norm(at.U - at.previous_U, axis=1).sum()
        settled = change <= self._options.control_tolerance * (
            np.linalg.norm(at.previous_U, axis=1).sum() or 1.0
        )
        if not settled:
            return None
        target = np.linalg.norm(self._problem.target) or 1.0
        if np.linalg.norm(at.evaluation.output_error) <= self._options.output_tolerance * target:
            return Status.INFEASIBLE if at.step.needed_slack else Status.CONVERGED
        return Status.INFEASIBLE if at.step.needed_slack else None

    def _solve(self, qp: CondensedQP) -> tuple[QPSolution, Penalties | None]:
        solution = solve_qp(qp, self._options.qp)
        if solution.status is QPStatus.SOLVED or not self._options.elastic:
            return solution, None
        path = self._options.penalty_path[qp.path_index]
        penalties = Penalties(self._options.penalty_terminal, path)
        return solve_qp(qp, self._options.qp, penalties), penalties

    def _advance(self, start: Trial, qp: CondensedQP, solution: QPSolution) -> Trial:
        dU = solution.dU.reshape(start.U.shape)
        if self._options.line_search:
            merit = self._merit.above_multipliers(qp, solution)
            promised = merit.predicted_decrease(qp, solution.dU)
            return search(self._problem, start, dU, merit, promised)
        U = np.clip(start.U + dU, self._problem.control_lower, self._problem.control_upper)
        X = self._problem.predict(U)
        return Trial(1.0, U, X, self._problem.evaluate(X, U))


def _record(
    qp: CondensedQP, solution: QPSolution, elastic: bool, length: float, shape: tuple[int, ...]
) -> Step:
    rows = qp.path_stage, qp.path_index
    slack, multipliers = np.zeros(shape), np.zeros(shape)
    slack[rows] = np.maximum(qp.B_C @ solution.dU - qp.g, 0.0) if elastic else 0.0
    multipliers[rows] = solution.path
    miss = qp.S_N @ solution.dU + qp.output_error
    active = (solution.path, solution.trust, solution.bounds)
    return Step(
        solution.status,
        elastic,
        miss if elastic else np.zeros_like(miss),
        slack,
        length,
        solution.terminal,
        multipliers,
        sum(int(np.count_nonzero(part)) for part in active),
        solution.iterations,
    )


def solve(
    problem: OptimalControlProblem, U: Array, options: Options, max_iterations: int
) -> tuple[Iterate, Status]:
    """Iterate from a guess until the iteration ends by itself or at the limit.

    Args:
        problem: The problem.
        U: Guessed control history ``U^0``, shape ``(N + 1, r)``.
        options: How the iteration is run.
        max_iterations: Iterations at most.

    Returns:
        The last iterate, and how the run ended.

    Raises:
        ProblemError: The guess or an option does not fit the problem.
    """
    iteration = CMPSP(problem, options)
    iterate = iteration.init(U)
    status = iteration.terminate(iterate)
    while status is None and iterate.index < max_iterations:
        iterate = iteration.step(iterate)
        status = iteration.terminate(iterate)
    return iterate, status or Status.ITERATION_LIMIT
