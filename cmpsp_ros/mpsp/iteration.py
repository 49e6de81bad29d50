"""The C-MPSP iteration of Sec. 4 as a state machine: `init`, `step`, `terminate`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cmpsp_ros.mpsp.answer import Answer, answer
from cmpsp_ros.mpsp.convergence import Record, record
from cmpsp_ros.mpsp.errors import ProblemError
from cmpsp_ros.mpsp.iterate import Iterate, Size, Step
from cmpsp_ros.mpsp.merit import Merit, Trial, search
from cmpsp_ros.mpsp.problem import Array, Evaluation, Hessian, OptimalControlProblem
from cmpsp_ros.mpsp.qp import RICCATI_ACTIVE_SET, Penalties, QPStatus, backend
from cmpsp_ros.mpsp.qp.riccati_backend import second_order_correction
from cmpsp_ros.mpsp.status import Solution, Status, violations
from cmpsp_ros.mpsp.subproblem import Subproblem


@dataclass(frozen=True)
class Options:
    """How the iteration is run.

    Where constraints contradict each other those with the least penalty give way first and alone,
    and only where that is not enough all of them do.

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
    qp: str = RICCATI_ACTIVE_SET
    hessian: Hessian = 'gauss_newton'
    elastic: bool = True
    trust_radius: Array | None = None
    line_search: bool = True
    output_tolerance: float = 1e-9
    control_tolerance: float = 1e-6
    violation_tolerance: float = 1e-6
    growth_limit: float = 1e10


class CMPSP:
    """The iteration for one problem: predict, linearise, solve, update (43)."""

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
        self._penalties = Penalties(
            options.penalty_terminal, np.tile(options.penalty_path, (stages, 1))
        )
        self._merit = Merit(self._penalties.terminal, self._penalties.path)
        free = np.full(size.state, np.inf)
        self._trust_radius = free if options.trust_radius is None else options.trust_radius

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

    def subproblem(self, at: Iterate) -> Subproblem:
        """The quadratic program (45) (54) (57) at an iterate."""
        problem = self._problem
        linearisation = problem.linearise(at.X, at.U, self._options.hessian)
        lower, upper = problem.control_lower - at.U, problem.control_upper - at.U
        return Subproblem(linearisation, lower, upper, self._trust_radius)

    def step(self, at: Iterate, subproblem: Subproblem | None = None) -> Iterate:
        """One iteration; an iterate that cannot be improved keeps its controls.

        Args:
            at: The iterate.
            subproblem: Its `subproblem`, where it is at hand already.
        """
        options = self._options
        found = answer(
            self.subproblem(at) if subproblem is None else subproblem,
            options.qp,
            options.hessian,
            self._penalties if options.elastic else None,
        )
        trial = Trial(0.0, at.U, at.X, at.evaluation)
        if found.solution.status is QPStatus.SOLVED:
            trial = self._advance(trial, found, 0.0 if at.step is None else at.step.length)
        step = _summary(found, trial, at.U)
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

    def _advance(self, start: Trial, found: Answer, last_length: float) -> Trial:
        subproblem, solution, elastic = found
        dU = solution.dU
        if self._options.line_search:
            merit = self._merit.above_multipliers(solution)
            promised = merit.predicted_decrease(subproblem, dU)

            def mend(after: Evaluation) -> Array:
                return second_order_correction(subproblem, solution, after.output_error, after.g)

            # A relaxed step leaves rows violated that no correction could mend.
            correction = None if elastic else mend
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


def _summary(found: Answer, trial: Trial, U: Array) -> Step:
    subproblem, solution, elastic = found
    slack, miss = np.zeros_like(solution.path), np.zeros_like(solution.terminal)
    finite = solution.status is QPStatus.SOLVED or subproblem.is_finite
    if elastic and finite:
        dX = subproblem.propagate(solution.dU)
        slack = np.maximum(subproblem.path(solution.dU, dX), 0.0)
        miss = subproblem.terminal(solution.dU, dX)
    active = (solution.path, solution.trust, solution.bounds)
    change, norm = _sum_of_norms(solution.dU), _sum_of_norms(U)
    return Step(
        solution.status,
        elastic,
        miss,
        slack,
        trial.length,
        solution.terminal,
        solution.path,
        solution.bounds,
        sum(int(np.count_nonzero(part)) for part in active),
        solution.iterations,
        change / (norm or 1.0),
        subproblem.shift,
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
        subproblem = iteration.subproblem(iterate) if iterate.is_finite else None
        history.append(record(iterate, subproblem))
        if status is None and iterate.index >= max_iterations:
            status = Status.ITERATION_LIMIT
        if status is not None:
            return iteration.conclude(iterate, status, history)
        iterate = iteration.step(iterate, subproblem)
