"""`solve`: scaling, the paper's iteration, multiple shooting where it fails, honest endings."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from cmpsp_ros.arrays import Array
from cmpsp_ros.mpsp.arguments import ProblemError
from cmpsp_ros.mpsp.jit.watch import progress as compiling
from cmpsp_ros.mpsp.options import Options
from cmpsp_ros.mpsp.problem import OptimalControlProblem
from cmpsp_ros.mpsp.qp import QPStatus
from cmpsp_ros.mpsp.qp.subproblem import Subproblem
from cmpsp_ros.mpsp.results import Iterate, Record, Solution, Status, Step, violations
from cmpsp_ros.mpsp.scaling import Scaling
from cmpsp_ros.mpsp.sqp.cmpsp import CMPSP
from cmpsp_ros.mpsp.sqp.lagrangian import descent_curvature
from cmpsp_ros.mpsp.sqp.multiple_shooting import MultipleShooting

# Iterations of the paper's kind, after which ``auto`` goes on by multiple shooting.
_PAPERS: Final = 15

# It goes on so before where a step is shortened although the constraints are met this well: what is
# missing is their curvature. And after so many steps running that are no longer than that.
_MET, _SHORT, _PATIENCE = 1e-6, 1.0 / 16.0, 4

# Violation, relative to that of the guess, up to which multiple shooting begins where the paper's
# iteration ended.
_WORTH_KEEPING = 0.1
# Iterations of a second try from the guess, after which it must have removed more of the violation.
_SECOND = 50
# How often a point that is no minimum is left along a direction of negative curvature, and how far.
_ESCAPES, _ESCAPE = 3, 0.1


def solve(
    problem: OptimalControlProblem,
    U: ArrayLike,
    options: Options | None = None,
    max_iterations: int = 200,
    *,
    time_limit: float = np.inf,
    progress: Callable[[Record], object] | None = None,
    warm: Solution | None = None,
) -> Solution:
    """Iterate from a guess until the iteration ends by itself or at a limit.

    Args:
        problem: The problem.
        U: Guessed control history ``U^0``, shape ``(N + 1, r)``.
        options: How the iteration is run.
        max_iterations: Iterations at most.
        time_limit: Time after which no iteration begins [s].
        progress: Called with the record of each iterate.
        warm: Solution of a problem like this one, whose multipliers multiple shooting begins with,
            at once; of no effect where the problem does not give what that asks for.

    Returns:
        How the run ended, with a record of every iterate.

    Raises:
        ProblemError: The guess or an option does not fit the problem, or the problem's bounds,
            target or derivatives do not fit its dimensions.
    """
    options = options or Options()
    if isinstance(max_iterations, bool) or max_iterations != int(max_iterations):
        raise ProblemError(f'max_iterations: found {max_iterations!r}, wanted a whole number')
    if max_iterations < 0:
        raise ProblemError(f'max_iterations: found {max_iterations}, wanted at least 0')
    if not time_limit > 0.0:
        raise ProblemError(f'time_limit: found {time_limit}, wanted a positive number of seconds')
    problem.check()
    options.fitted(problem.size)
    guess = np.clip(problem.checked_controls(U), problem.control_lower, problem.control_upper)
    deadline = time.monotonic() + time_limit
    with compiling():
        run = _Run.begin(problem, guess, options)
        if warm is not None:
            run.warm = _warm(problem, warm, run.scaling)
        return run.finish(int(max_iterations), deadline, progress or (lambda _: None))


@dataclass
class _Run:
    """A run in scaled units: the problem, both iterations, the iterate and what came of it."""

    given: OptimalControlProblem
    problem: OptimalControlProblem
    scaling: Scaling
    options: Options
    papers: CMPSP
    at: Iterate
    can_shoot: bool
    shooting: MultipleShooting | None = None
    escapes: int = 0
    short: int = 0
    before: Iterate | None = None
    until: int | None = None
    warm: Step | None = None

    @classmethod
    def begin(cls, problem: OptimalControlProblem, U: Array, options: Options) -> _Run:
        X = problem.predict(U)
        scaling = Scaling.none(problem)
        if np.isfinite(X).all():
            lin = problem.linearise(X, U, options.hessian)
            lin.check_shapes(problem.size)
            if options.scaling:
                scaling = Scaling.of(problem, options, X, U, lin)
        scaled = scaling.applied_to(problem)
        if options.scaling:
            options = scaling.options(options, scaled)
        papers = CMPSP(scaled, options)
        at = papers.init(U / scaling.control)
        can_shoot = options.method != 'cmpsp' and options.line_search and np.isfinite(X).all()
        return cls(problem, scaled, scaling, options, papers, at, bool(can_shoot))

    def finish(
        self, max_iterations: int, deadline: float, progress: Callable[[Record], object]
    ) -> Solution:
        """Iterate to the end."""
        guess, history = self.at, list[Record]()
        begins = self.options.method == 'multiple_shooting' or self.warm is not None
        if begins and self._shoot(guess):
            self.at = replace(self.at, step=self.warm)
        elif self.options.method == 'multiple_shooting':
            raise ProblemError(
                "method: found 'multiple_shooting', but the problem lacks next_states or "
                'constraint_curvature, or is not finite along the guess'
            )
        while True:
            at = self.at
            # The subproblem at the new iterate gives its KKT residual, and the next step needs it.
            subproblem = None if at.not_finite else self._subproblem()
            residual = math.nan if subproblem is None else self.papers.residual(at, subproblem)
            history.append(self._record(residual))
            progress(history[-1])
            status, is_minimum, goes_on = self._status(residual), None, False
            is_last = at.index >= max_iterations
            if status is Status.CONVERGED:
                direction, is_minimum = self._judge(subproblem)
                if direction is not None:
                    status = Status.NOT_A_MINIMUM
                    goes_on = not is_last and self._escape(direction)
            elif not is_last:
                goes_on = self._go_on_elsewhere(status, guess)
            if not goes_on:
                if at.index == self.until and self._resume(Status.ITERATION_LIMIT, is_last):
                    continue
                if status is None and is_last:
                    status = Status.ITERATION_LIMIT
                if status is None and time.monotonic() >= deadline:
                    status = Status.TIME_LIMIT
                if status is not None:
                    if self._resume(status, is_last):
                        continue
                    return self._conclude(status, history, is_minimum)
            if goes_on or subproblem is None:
                subproblem = self._subproblem()
            self.at = (self.shooting or self.papers).step(self.at, subproblem)

    def _subproblem(self) -> Subproblem:
        return self.papers.subproblem(self.at, 'exact' if self.shooting else None)

    def _record(self, residual: float) -> Record:
        """Measurements of the iterate in the user's units, in which bounds hold to the last bit."""
        at, unit, step, value = self.at, self.scaling, self.at.step, self.at.evaluation
        lower, upper = self.given.control_lower, self.given.control_upper
        U = np.minimum(np.maximum(at.U * unit.control, lower), upper)
        terminal, path, bounds = unit.unscaled_multipliers(at.multipliers)
        change = 0.0 if at.previous_U is None else _length((at.U - at.previous_U) * unit.control)
        return Record(
            at.index, U, value.cost * unit.cost, change, 0.0 if step is None else step.length,
            _length(value.output_error * unit.output),
            float((value.g * unit.path).max(initial=0.0)) if value.g.size else 0.0,
            at.gap, residual,
            terminal, path, bounds, 0.0 if step is None else step.shift,
        )  # fmt: skip

    def _status(self, residual: float) -> Status | None:
        """Status as of `CMPSP.terminate`; converged only where the KKT conditions hold."""
        status = self.papers.terminate(self.at)
        if status is Status.CONVERGED:
            holds = residual <= self.options.kkt_tolerance and self.at.gap == 0.0
            return status if holds else None
        return status

    def _go_on_elsewhere(self, status: Status | None, guess: Iterate) -> bool:
        """Go on by multiple shooting, or by it from the guess, where this gets no further."""
        at = self.at
        if self.shooting:
            is_over = status in {Status.INFEASIBLE, Status.STALLED, Status.QP_FAILED}
            if not is_over or self.shooting.is_exact:
                return False
            if self.before is None or _violation(at) <= _violation(self.before):
                self.before = at
            self.until = at.index + _SECOND
            return self._shoot(replace(guess, index=at.index), exact=True)
        if not self.can_shoot or (status is None and not self._is_slow()):
            return False
        self.before = at
        is_worth_keeping = _violation(at) <= _WORTH_KEEPING * _violation(guess)
        return self._shoot(at if is_worth_keeping else replace(guess, index=at.index))

    def _is_slow(self) -> bool:
        """True where the paper's iteration has had its time, or does not get on."""
        length = 1.0 if self.at.step is None else self.at.step.length
        self.short = self.short + 1 if length <= _SHORT else 0
        is_flat = length < 1.0 and _violation(self.at) <= _MET
        return self.at.index >= _PAPERS or is_flat or self.short >= _PATIENCE

    def _resume(self, status: Status, is_last: bool) -> bool:
        """Go back to an iterate with less violation, and on by the paper's iteration from there."""
        before, self.before = self.before, None
        if before is None or is_last or status in {Status.CONVERGED, Status.NOT_A_MINIMUM}:
            return False
        if _violation(before) >= _violation(self.at):
            return False
        self.at = replace(before, index=self.at.index + 1)
        self.can_shoot, self.shooting = False, None
        return True

    def _shoot(self, at: Iterate, *, exact: bool = False) -> bool:
        """Go on from an iterate by multiple shooting; false where the problem cannot."""
        self.can_shoot = self.can_shoot and _can_shoot(self.problem, at)
        if self.can_shoot:
            self.shooting = MultipleShooting(
                self.problem, self.options, self.papers, at, exact=exact
            )
            self.at = replace(at, step=None)
        return self.shooting is not None

    def _judge(self, subproblem: Subproblem | None) -> tuple[Array | None, bool | None]:
        """Direction of negative curvature at the iterate, and whether it is a minimum."""
        is_exact = self.shooting is not None or self.options.hessian == 'exact'
        lin = subproblem.linearisation if is_exact and subproblem is not None else None
        try:
            direction = descent_curvature(self.problem, self.at, lin)
        except ProblemError:
            return None, None
        return direction, direction is None

    def _escape(self, direction: Array) -> bool:
        """Leave a point that is no minimum; false where that was tried often enough."""
        if not self.can_shoot or self.escapes == _ESCAPES:
            return False
        self.escapes += 1
        U = self.at.U + _ESCAPE * direction / np.abs(direction).max()
        at = self.papers.init(U)
        if at.not_finite:
            return False
        return self._shoot(replace(at, index=self.at.index, guess_size=self.at.guess_size))

    def _conclude(self, status: Status, history: list[Record], is_minimum: bool | None) -> Solution:
        """The solution, with the last iterate in the user's units."""
        last, options = history[-1], self.options
        at = replace(self.scaling.unscaled(self.at), U=last.U)
        length = float(np.linalg.norm(self.problem.target)) or 1.0
        scaled = violations(
            self.at.evaluation, options.output_tolerance * length, options.violation_tolerance
        )
        named = {(each.stage, each.index, each.is_terminal) for each in scaled}
        return Solution(
            at,
            status,
            tuple(history),
            last.terminal_multipliers,
            last.path_multipliers,
            last.bound_multipliers,
            tuple(
                each
                for each in (violations(at.evaluation, 0.0, 0.0) if named else ())
                if (each.stage, each.index, each.is_terminal) in named
            ),
            is_minimum,
            self.scaling,
        )


def _warm(problem: OptimalControlProblem, warm: Solution, units: Scaling) -> Step:
    """Multipliers of another solution, in units, as those of a step that has not settled."""
    size, rows = problem.size, warm.path_multipliers
    shapes = rows.shape, warm.bound_multipliers.shape, warm.terminal_multipliers.shape
    stages = size.horizon + 1
    wanted = (stages, size.path), (stages, size.control), (size.output,)
    if shapes != wanted:
        raise ProblemError(f'warm: found multipliers of shapes {shapes}, wanted {wanted}')
    return Step(
        QPStatus.SOLVED, False, np.zeros(size.output), np.zeros_like(rows), 1.0,
        warm.terminal_multipliers * units.output / units.cost, rows * units.path / units.cost,
        warm.bound_multipliers * units.control / units.cost, 0, 0, full_change=np.inf,
    )  # fmt: skip


def _length(of: Array) -> float:
    """Euclidean norm; numpy's takes several times as long."""
    return math.sqrt(np.vdot(of, of))


def _violation(at: Iterate) -> float:
    """Violation of an iterate, infinite where it is not finite."""
    value = at.evaluation
    total = float(np.abs(value.output_error).sum() + np.maximum(value.g, 0.0).sum())
    return np.inf if at.not_finite else total


def _can_shoot(problem: OptimalControlProblem, at: Iterate) -> bool:
    """True where the problem gives what multiple shooting asks for."""
    size = problem.size
    try:
        problem.next_states(at.X, at.U)
        problem.constraint_curvature(
            at.X, at.U, np.zeros((size.horizon, size.state)), np.zeros(size.output),
            np.zeros((size.horizon + 1, size.path)),
        )  # fmt: skip
    except ProblemError:
        return False
    return True
