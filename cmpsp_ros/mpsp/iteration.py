"""The C-MPSP iteration of Sec. 4 as a state machine: `init`, `step`, `terminate`."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import numpy as np

from cmpsp_ros.mpsp.closed_form import has_closed_form, solve_closed_form
from cmpsp_ros.mpsp.condensing import CondensedQP, condense
from cmpsp_ros.mpsp.convergence import Record, record
from cmpsp_ros.mpsp.curvature import convexify
from cmpsp_ros.mpsp.errors import ProblemError
from cmpsp_ros.mpsp.iterate import Iterate, Size, Step
from cmpsp_ros.mpsp.merit import Merit, Trial, search, second_order_correction
from cmpsp_ros.mpsp.problem import Array, Evaluation, Hessian, OptimalControlProblem
from cmpsp_ros.mpsp.qp import Penalties, QPSolution, QPStatus, backend, solve_qp
from cmpsp_ros.mpsp.status import Solution, Status, violations


@dataclass(frozen=True)
class Options:
    """How the iteration is run.

    Attributes:
        penalty_terminal: Weight of each terminal output in merit and relaxation, shape ``(m,)``.
        penalty_path: Weight of each path constraint in merit and relaxation, shape ``(l,)``.
        qp: Name of the QP back end; not asked where the closed form (35) will do.
        hessian: Which Hessian of the cost.
        elastic: Whether a subproblem without a feasible point is solved relaxed.
        trust_radius: Largest predicted change of each state component in one iteration, shape
            ``(n,)``, infinite where free; None for no trust region.
        line_search: Whether a step is shortened until it lowers the merit; the paper's iteration
            (43) takes the full step.
        output_tolerance: ``eps_Y`` of Sec. 4.
        control_tolerance: ``eps_U`` of Sec. 4.
        violation_tolerance: Largest path constraint (4) at a solution, absolute. Sec. 4 does not
            ask for it, but without it a point outside the constraints could pass for one.
        growth_limit: Growth of the controls or the cost since the guess, as a factor, from which
            on a run has diverged.
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
    violation_tolerance: float = 1e-6
    growth_limit: float = 1e10


class _Answer(NamedTuple):
    """Solution of a subproblem, and what had to be done to get it."""

    qp: CondensedQP
    solution: QPSolution
    elastic: bool
    shift: float


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
        evaluation = self._problem.evaluate(X, U)
        return Iterate(0, U, X, evaluation, _size(U, evaluation))

    def subproblem(self, at: Iterate) -> CondensedQP:
        """The quadratic program (45) (54) (57) at an iterate."""
        options, problem = self._options, self._problem
        linearisation = problem.linearise(at.X, at.U, options.hessian)
        lower, upper = problem.control_lower - at.U, problem.control_upper - at.U
        return condense(linearisation, lower, upper, options.trust_radius)

    def step(self, at: Iterate, qp: CondensedQP | None = None) -> Iterate:
        """One iteration; an iterate that cannot be improved keeps its controls.

        Args:
            at: The iterate.
            qp: Its `subproblem`, where it is at hand already.
        """
        answer = self._solve(self.subproblem(at) if qp is None else qp)
        trial = Trial(0.0, at.U, at.X, at.evaluation)
        if answer.solution.status is QPStatus.SOLVED:
            trial = self._advance(trial, answer, 0.0 if at.step is None else at.step.length)
        step = _summary(answer, trial, at.U, self._merit.path.shape)
        return Iterate(at.index + 1, trial.U, trial.X, trial.evaluation, at.guess_size, at.U, step)

    def terminate(self, at: Iterate) -> Status | None:
        """Status where the iteration is over by itself, else None.

        Converged is an iterate whose terminal error, control change and constraint violation are
        below their tolerances. The terminal error is relative to ``Y_N*`` as in Sec. 4, absolute
        where ``Y_N*`` is 0; the control change is that of the full step, so that a step which the
        line search made short does not pass for a small one.

        Diverged is an iterate whose cost or largest control is, in magnitude and each plus 1,
        `Options.growth_limit` times that of the guess. The merit function's other part, the
        violation, cannot grow without bound unless the controls or the states do, which is soon
        not finite.
        """
        options, step = self._options, at.step
        if not at.is_finite or (step is not None and not step.is_finite):
            return Status.NOT_FINITE
        size, limit = _size(at.U, at.evaluation), options.growth_limit
        if size.cost > limit * at.guess_size.cost or size.control > limit * at.guess_size.control:
            return Status.DIVERGED
        if step is None:
            return None
        if step.qp_status is not QPStatus.SOLVED:
            return Status.QP_FAILED
        settled = step.full_change <= options.control_tolerance
        if settled and step.needed_slack:
            return Status.INFEASIBLE
        if settled and self._is_met(at.evaluation):
            return Status.CONVERGED
        if step.length == 0.0:
            at_bottom = step.gains_nothing_on(at.evaluation)
            return Status.INFEASIBLE if at_bottom else Status.STALLED
        return None

    def conclude(self, at: Iterate, status: Status, history: Sequence[Record]) -> Solution:
        """What a run that ends at an iterate has come to."""
        size, step = self._problem.size, at.step
        stages = size.horizon + 1
        output_tolerance = self._options.output_tolerance * self._target_size
        return Solution(
            at,
            status,
            tuple(history),
            np.zeros(size.output) if step is None else step.terminal_multipliers,
            np.zeros((stages, size.path)) if step is None else step.path_multipliers,
            np.zeros((stages, size.control)) if step is None else step.bound_multipliers,
            violations(at.evaluation, output_tolerance, self._options.violation_tolerance),
        )

    @property
    def _target_size(self) -> float:
        return float(np.linalg.norm(self._problem.target)) or 1.0

    def _is_met(self, evaluation: Evaluation) -> bool:
        """Whether terminal and path constraints are within their tolerances."""
        miss = np.linalg.norm(evaluation.output_error)
        return bool(
            miss <= self._options.output_tolerance * self._target_size
            and evaluation.g.max(initial=-np.inf) <= self._options.violation_tolerance
        )

    def _solve(self, qp: CondensedQP) -> _Answer:
        """Solve a subproblem, relaxed where its constraints contradict each other."""
        options, shift = self._options, 0.0
        if options.hessian == 'exact':
            qp, shift = convexify(qp)
        answer = _with_curvature(qp, shift, self._solve_hard)
        if answer.solution.status is QPStatus.SOLVED or not options.elastic:
            return answer
        penalties = Penalties(options.penalty_terminal, options.penalty_path[qp.path_index])
        relaxed = partial(solve_qp, name=options.qp, penalties=penalties)
        return _with_curvature(answer.qp, answer.shift, relaxed)._replace(elastic=True)

    def _solve_hard(self, qp: CondensedQP) -> QPSolution:
        # Most programs have path rows, which is told sooner than that they have no bounds.
        if not len(qp.g) and has_closed_form(qp):
            return solve_closed_form(qp)
        return solve_qp(qp, self._options.qp)

    def _advance(self, start: Trial, answer: _Answer, last_length: float) -> Trial:
        qp, solution = answer.qp, answer.solution
        dU = solution.dU.reshape(start.U.shape)
        if self._options.line_search:
            merit = self._merit.above_multipliers(qp, solution)
            promised = merit.predicted_decrease(qp, solution.dU)
            # A relaxed step leaves rows violated that no correction could mend.
            correction = None if answer.elastic else partial(second_order_correction, qp, solution)
            # What can no longer be checked relies on the length that could: a Hessian too flat
            # for full steps would otherwise swing about the solution at the level of rounding.
            longest = 1.0
            if 0.0 < last_length < 1.0 and not merit.can_check(promised, start.evaluation):
                longest = last_length
            return search(self._problem, start, dU, merit, promised, correction, longest)
        U = np.clip(start.U + dU, self._problem.control_lower, self._problem.control_upper)
        X = self._problem.predict(U)
        return Trial(1.0, U, X, self._problem.evaluate(X, U))


def _size(U: Array, evaluation: Evaluation) -> Size:
    return Size(1.0 + abs(evaluation.cost), 1.0 + float(np.abs(U).max()))


def _with_curvature(
    qp: CondensedQP, shift: float, solver: Callable[[CondensedQP], QPSolution]
) -> _Answer:
    """Solve a program, once more with its Hessian shifted where curvature is what it lacks.

    Asking for curvature first would cost a factorisation in every iteration, and Hessians that
    are not exact seldom lack it: they are positive semi-definite by construction.
    """
    solution = solver(qp)
    if solution.status is QPStatus.FAILED and not shift:
        qp, shift = convexify(qp)
        solution = solver(qp) if shift else solution
    return _Answer(qp, solution, False, shift)


def _summary(answer: _Answer, trial: Trial, U: Array, shape: tuple[int, ...]) -> Step:
    qp, solution, elastic, shift = answer
    rows = qp.path_stage, qp.path_index
    slack, multipliers = np.zeros(shape), np.zeros(shape)
    miss = np.zeros_like(qp.output_error)
    finite = True
    if solution.status is not QPStatus.SOLVED:
        data = (qp.H, qp.c, qp.S_N, qp.output_error, qp.B_C, qp.g)
        finite = all(bool(np.isfinite(part).all()) for part in data)
    if elastic and finite:
        slack[rows] = np.maximum(qp.B_C @ solution.dU - qp.g, 0.0)
        miss = qp.S_N @ solution.dU + qp.output_error
    multipliers[rows] = solution.path
    active = (solution.path, solution.trust, solution.bounds)
    change, norm = _sum_of_norms(solution.dU.reshape(U.shape)), _sum_of_norms(U)
    return Step(
        solution.status,
        elastic,
        miss,
        slack,
        trial.length,
        solution.terminal,
        multipliers,
        solution.bounds.reshape(U.shape),
        sum(int(np.count_nonzero(part)) for part in active),
        solution.iterations,
        change / (norm or 1.0),
        shift,
        trial.corrected,
        finite,
    )


def _sum_of_norms(U: Array) -> float:
    """``sum |U_k|``, the measure of ``eps_U`` in Sec. 4."""
    return float(np.sqrt(np.einsum('kr,kr->k', U, U)).sum())


def solve(
    problem: OptimalControlProblem, U: Array, options: Options, max_iterations: int
) -> Solution:
    """Iterate from a guess until the iteration ends by itself or at the limit.

    Args:
        problem: The problem.
        U: Guessed control history ``U^0``, shape ``(N + 1, r)``.
        options: How the iteration is run.
        max_iterations: Iterations at most.

    Returns:
        How the run ended, with a record of every iterate.

    Raises:
        ProblemError: The guess or an option does not fit the problem, or the problem's bounds,
            target or derivatives do not fit its dimensions.
    """
    problem.check()
    iteration = CMPSP(problem, options)
    iterate = iteration.init(U)
    if iterate.is_finite:
        problem.linearise(iterate.X, iterate.U, options.hessian).check_shapes(problem.size)
    history = []
    while True:
        status = iteration.terminate(iterate)
        # The subproblem at the new iterate gives its KKT residual, and the next step needs it.
        qp = iteration.subproblem(iterate) if iterate.is_finite else None
        history.append(record(iterate, qp))
        if status is None and iterate.index >= max_iterations:
            status = Status.ITERATION_LIMIT
        if status is not None:
            return iteration.conclude(iterate, status, history)
        iterate = iteration.step(iterate, qp)
