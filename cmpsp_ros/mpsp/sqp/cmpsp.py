"""The C-MPSP iteration of Sec. 4 for problems in Python: `init`, `step`, `terminate`."""

import math
from collections import defaultdict
from weakref import finalize

import numpy as np
from numpy.typing import ArrayLike

from cmpsp_ros.arrays import Array
from cmpsp_ros.mpsp.options import Options
from cmpsp_ros.mpsp.problem import (
    Dimensions,
    Evaluation,
    Hessian,
    Linearisation,
    OptimalControlProblem,
)
from cmpsp_ros.mpsp.qp import QPStatus
from cmpsp_ros.mpsp.qp.active_set.records import put_derivatives, residual_without_step
from cmpsp_ros.mpsp.qp.subproblem import Subproblem
from cmpsp_ros.mpsp.results import SLACK_TOLERANCE, Iterate, Size, Status, Step
from cmpsp_ros.mpsp.sqp.driver import Driver, Functions
from cmpsp_ros.mpsp.sqp.workspace import Phase, set_weights

_idle: defaultdict[tuple[Dimensions, str, Hessian], list[Driver]] = defaultdict(list)


class CMPSP:
    """The iteration for one problem: predict, linearise, solve, update (43)."""

    def __init__(self, problem: OptimalControlProblem, options: Options) -> None:
        """Take the problem and the options.

        Raises:
            ProblemError: An option does not fit the problem, or its back end is not installed.
        """
        size = problem.size
        fitted = options.fitted(size)
        self._problem = problem
        self._options = options
        self._target_size = float(np.linalg.norm(problem.target)) or 1.0
        self._trust_radius = fitted[-1]
        idle = _idle[size, options.qp, options.hessian]
        self._driver = idle.pop() if idle else Driver(size, *fitted, (options.qp, options.hessian))
        self.space = self._driver.space
        # To make memory takes longer than a few iterations.
        finalize(self, idle.append, self._driver)
        # Derivatives that are in the records already.
        self.loaded: Linearisation | None = None
        self._functions = Functions(self._predict, self._evaluate, self._linearise)
        self._last: Iterate | None = None
        ws = self._driver.ws
        set_weights(ws.program, *fitted)
        ws.run['line_search'], ws.run['elastic'] = options.line_search, options.elastic
        # `full_change` is measured where there is a tolerance.
        ws.run['control_tolerance'], ws.run['slack_tolerance'] = np.inf, SLACK_TOLERANCE
        ws.lower[:, : size.control] = problem.control_lower
        ws.upper[:, : size.control] = problem.control_upper

    def init(self, U: ArrayLike) -> Iterate:
        """Predict along a guess ``U^0 (N + 1, r)``, brought within its bounds.

        Raises:
            ProblemError: The guess has the wrong shape or is not finite.
        """
        U = np.clip(
            self._problem.checked_controls(U),
            self._problem.control_lower,
            self._problem.control_upper,
        )
        X = self._problem.predict(U)
        evaluation = self._problem.evaluate(X, U)
        return Iterate(0, U, X, evaluation, _size(U, evaluation))

    def subproblem(self, at: Iterate, hessian: Hessian | None = None) -> Subproblem:
        """The quadratic program (45) (54) (57) at an iterate; gaps are not in it."""
        problem = self._problem
        linearisation = problem.linearise(at.X, at.U, hessian or self._options.hessian)
        lower, upper = problem.control_lower - at.U, problem.control_upper - at.U
        return Subproblem(linearisation, lower, upper, self._trust_radius)

    def residual(self, at: Iterate, subproblem: Subproblem) -> float:
        """KKT residual of an iterate with its latest multipliers."""
        self.loaded = lin = subproblem.linearisation
        return residual_without_step(self.space, subproblem, *at.multipliers_on(lin))

    def step(self, at: Iterate, subproblem: Subproblem | None = None) -> Iterate:
        """One iteration; an iterate that cannot be improved keeps its controls.

        The iterate's `subproblem` may be given where it is at hand already.
        """
        if subproblem is None:
            subproblem = self.subproblem(at)
        self._load(at)
        # A step depends on its iterate, and on the rows that were active in the step to it.
        if at is not self._last:
            self._driver.forget()
        self._driver.go_on(self._functions, subproblem.linearisation)
        self.loaded = None
        size, ws = self._problem.size, self._driver.ws
        U, X, evaluation = at.U, at.X, at.evaluation
        if ws.run['length'][0] > 0.0:
            U, X = ws.now.U[:, : size.control].copy(), ws.now.X[:, : size.state].copy()
            cost = float(ws.run['cost'][0])
            evaluation = Evaluation(cost, ws.now.output_error.copy(), ws.now.g.copy())
        step = _summary(self._driver, subproblem)
        self._last = Iterate(at.index + 1, U, X, evaluation, at.guess_size, at.U, step)
        return self._last

    def _load(self, at: Iterate) -> None:
        """Put an iterate where the iteration expects one that it has evaluated."""
        size, ws = self._problem.size, self._driver.ws
        run, there = ws.run, ws.trial
        ws.program.head['work'] = 0
        there.U[:, : size.control], there.X[:, : size.state] = at.U, at.X
        there.output_error[:], there.g[:] = at.evaluation.output_error, at.evaluation.g
        run['trial_cost'], run['phase'] = at.evaluation.cost, Phase.EVALUATED
        run['iterations'], run['max_iterations'] = at.index, at.index + 1
        run['length'] = 0.0 if at.step is None else at.step.length
        run['full_change'] = run['active_rows'] = run['is_corrected'] = 0

    # Functions of the derivatives at the iterate, that fill records with more room.
    def _predict(self, _: Linearisation, U: Array, X: Array) -> None:
        size = self._problem.size
        X[:, : size.state] = self._problem.predict(U[:, : size.control])

    def _evaluate(
        self, _: Linearisation, X: Array, U: Array, output_error: Array, g: Array
    ) -> float:
        size = self._problem.size
        found = self._problem.evaluate(X[:, : size.state], U[:, : size.control])
        output_error[:], g[:] = found.output_error, found.g
        return found.cost

    def _linearise(self, data: Linearisation, *_: object) -> None:
        if self.loaded is not data:
            put_derivatives(self.space.derivatives, data)

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
        if at.not_finite or (step is not None and step.not_finite):
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

    def _is_met(self, evaluation: Evaluation) -> bool:
        """True where terminal and path constraints are within their tolerances."""
        error, options = evaluation.output_error, self._options
        if not math.sqrt(np.vdot(error, error)) <= options.output_tolerance * self._target_size:
            return False
        return bool((evaluation.g <= options.violation_tolerance).all())


def _size(U: Array, evaluation: Evaluation) -> Size:
    return Size(1.0 + abs(evaluation.cost), 1.0 + float(np.abs(U).max()))


def _summary(driver: Driver, subproblem: Subproblem) -> Step:
    """Summary of the driver's last iteration."""
    run, back_end = driver.ws.run[0], driver.back_end
    assert back_end is not None  # noqa: S101 (a problem in Python has one)
    solution, elastic = back_end.solution, bool(run['level'] > 0)
    solved = solution.status is QPStatus.SOLVED
    not_finite = '' if solved else subproblem.linearisation.not_finite
    slack, miss = np.zeros(solution.path.shape), np.zeros(solution.terminal.shape)
    if elastic and not not_finite:
        dX = subproblem.propagate(solution.dU)
        slack = np.maximum(subproblem.path(solution.dU, dX), 0.0)
        miss = subproblem.terminal(solution.dU, dX)
    return Step(
        solution.status,
        elastic,
        miss,
        slack,
        float(run['length']),
        solution.terminal,
        solution.path,
        solution.bounds,
        int(run['active_rows']),
        solution.iterations,
        float(run['full_change']),
        back_end.shift,
        bool(run['is_corrected']),
        not_finite,
    )
