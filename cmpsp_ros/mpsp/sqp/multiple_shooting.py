"""Multiple shooting: states as unknowns beside the controls, with exact second derivatives.

Where the C-MPSP iteration does not converge, this usually does. The linearised dynamics have a gap
at each stage, ``dX_(k+1) = A dX_k + B dU_k + d_k`` with ``d_k = F_k(X_k, U_k) - X_(k+1)``. With the
response ``e`` to the gaps alone, ``dX = e + dX'``, what is left is the program (45) (54) (57) in
``dX'`` and ``dU`` at shifted values, and the same solver answers it.

The Hessian is made convex as interior-point methods do it: by weights on the rows that hold, which
change no step along them, and if that is not enough by a term on the diagonal [A. Waechter,
L. Biegler, On the implementation of an interior-point filter line-search algorithm, 2006, Sec. 3].

A step is accepted by a funnel: it lowers the cost where the constraints are met well enough, or
else the violation, or a merit of both [D. Kiessling, S. Leyffer, C. Vanaret, A unified funnel
restoration SQP algorithm, 2024]. A second-order correction is tried first where the full step fails
[Nocedal and Wright, Sec. 18.3].
"""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from cmpsp_ros.arrays import Array
from cmpsp_ros.mpsp.options import Options
from cmpsp_ros.mpsp.problem import Evaluation, Linearisation, OptimalControlProblem
from cmpsp_ros.mpsp.qp import RICCATI_ACTIVE_SET, QPStatus, solve_qp
from cmpsp_ros.mpsp.qp.active_set.records import (
    is_positive_definite,
    program_in,
    put_derivatives,
    put_solution,
)
from cmpsp_ros.mpsp.qp.back_ends import answer_in
from cmpsp_ros.mpsp.qp.riccati.program import Outcome
from cmpsp_ros.mpsp.qp.subproblem import Subproblem
from cmpsp_ros.mpsp.results import Iterate, Step
from cmpsp_ros.mpsp.sqp.cmpsp import CMPSP
from cmpsp_ros.mpsp.sqp.iteration import LEVELS, relax
from cmpsp_ros.mpsp.sqp.lagrangian import Curvature, lagrangian_curvature, stage_blocks
from cmpsp_ros.mpsp.sqp.shooting_program import Direction, Point, entries_for, memory

# Violation of the start above which the Hessian is that of Gauss and Newton while it is as large.
_FAR = 0.3
# Weight of held rows, and least and largest term on the diagonal, relative to the Hessian.
_HELD, _LEAST, _MOST = 1e2, 1e-4, 1e3
_ATTEMPTS, _SHORTEST, _SHORT = 12, 1e-4, 0.2
# Relaxed steps that leave this much of the violation, so many times running, are in vain.
_NO_GAIN, _PATIENCE = 0.99, 5
_ROUNDING = 1e-12
# Decrease of the cost, relative to the violation, from which on a step is for the cost.
_SWITCH = 1e-2


class MultipleShooting:
    """The iteration from one point; it remembers funnel and proximal term between steps."""

    def __init__(
        self,
        problem: OptimalControlProblem,
        options: Options,
        papers: CMPSP,
        at: Iterate,
        *,
        exact: bool,
    ) -> None:
        """Take a problem that gives `next_states` and `constraint_curvature`, and a start.

        It works in the records of `papers`, which have the weights of the rows. Unless `exact`, the
        Hessian is that of Gauss and Newton as long as the violation is large.
        """
        self._problem, self._options, self._papers = problem, options, papers
        self._space = space = papers.space
        self._memory = memory(problem.size)
        self._compiled = entries_for(*space.program.stages['B'].shape[1:])
        relax(space.program, 0)
        self._here = self._point(at.X, at.U)
        violation = self._here.violation
        self._funnel, self.is_exact = max(1.0, 1.25 * violation), exact or violation < _FAR
        self._proximal = self._convexifying = 0.0
        self._violation, self._in_vain, self._is_cautious = 0.0, 0, False
        space.warm.clear()

    def step(self, at: Iterate, subproblem: Subproblem) -> Iterate:
        """One iteration; an iterate that cannot be improved keeps its controls.

        Of the subproblem it takes the derivatives, with the exact Hessian of the cost.
        """
        point = self._here
        found = lagrangian_curvature(self._problem, at, subproblem.linearisation)
        if point.violation > _FAR and not self.is_exact:
            lin = self._problem.linearise(at.X, at.U, 'gauss_newton')
            found = found._replace(H=stage_blocks(lin.L_XX, lin.L_UX, lin.L_UU))
        size, attempt = max(1e-6, float(np.abs(found.H).max())), 0
        if not np.isfinite(size):
            return replace(at, index=at.index + 1, previous_U=at.U, step=_not_finite(at, found))
        self._load(at, point, found)
        while True:
            way = self._direction(point, found, size)
            if way.status is QPStatus.SOLVED:
                length, after, is_corrected = self._search(point, way)
                if length > 0.0 and not self._is_in_vain(way, point):
                    if attempt == 0:
                        self._adapt(length, size)
                    return self._moved(at, after, way, length, is_corrected)
            attempt += 1
            if attempt == _ATTEMPTS or self._in_vain == _PATIENCE:
                step = self._summary(at, way, 0.0)
                return replace(at, index=at.index + 1, previous_U=at.U, step=step)
            self._proximal = max(_LEAST * size, 10.0 * self._proximal)
            # No proximal term shortens a step to constraints that nearly depend on each other.
            self._is_cautious = self._options.elastic

    def _load(self, at: Iterate, point: Point, found: Curvature) -> None:
        """Put derivatives and multipliers where the program is assembled from."""
        lin, s, p = found.linearisation, self._memory, self._space.program
        if self._papers.loaded is not lin:
            put_derivatives(self._space.derivatives, lin)
        self._papers.loaded = None
        p.head['trust_radius'], p.head['horizon'] = np.inf, len(lin.A)
        n = lin.A.shape[1]
        s.H[:], s.gradient[:, :n], s.gradient[:, n:] = found.H, lin.L_X, lin.L_U
        _, s.path[:], s.bounds[:] = at.multipliers_on(lin)
        self._set_values(point, lin)

    def _set_values(self, point: Point, lin: Linearisation) -> None:
        s = self._memory
        np.subtract(point.ahead, point.X[1:], out=s.gaps)
        s.output_error[:] = point.evaluation.output_error
        s.g[:] = np.where(lin.g == -np.inf, -np.inf, point.evaluation.g)

    def _point(self, X: Array, U: Array) -> Point:
        with np.errstate(all='ignore'):
            value, ahead = self._problem.evaluate_with_next(X, U)
        arrays = (X, ahead, value.output_error, value.g)
        X, ahead, error, g = [np.ascontiguousarray(each, float) for each in arrays]
        violation, _, _ = self._measured(X, ahead, error, g)
        return Point(X, U, Evaluation(value.cost, error, g), ahead, violation)

    def _measured(self, *point: Array) -> tuple[float, float, float]:
        self._compiled.measure(self._space.program, self._memory, *point)
        violation, hard, weighted, _ = self._memory.sums.tolist()
        return violation, hard, weighted

    def _merit(self, point: Point, above: float) -> float:
        """Weighted violation: what a merit adds to the cost."""
        _, hard, weighted = self._measured(*point.values)
        return above * hard + weighted

    def _solve_at(self, point: Point, shift: float, held: float, level: int) -> QPStatus | None:
        """Solve the program at a point, relaxed as far as it is asked for, or has to be.

        None where it is not convex; the level that was enough is that of the program.
        """
        space, problem, name = self._space, self._problem, self._options.qp
        bounds = problem.control_lower, problem.control_upper
        self._compiled.assemble(space.program, self._memory, point.U, *bounds, shift, held)
        self._level = level
        while True:
            is_hard = relax(space.program, self._level)
            if self._level:
                space.warm.clear()
            if name == RICCATI_ACTIVE_SET:
                outcome = space.solve(space.warm)
                if outcome is Outcome.SOLVED:
                    return QPStatus.SOLVED
                if outcome is Outcome.NO_CURVATURE:
                    return None
                answer = answer_in(space, outcome, space.warm, lambda: program_in(space))
            else:
                subproblem, penalties = program_in(space)
                if not is_positive_definite(subproblem):
                    return None
                answer = solve_qp(subproblem, name, penalties)
            if answer.status is QPStatus.SOLVED:
                subproblem, _ = program_in(space)
                put_solution(space, answer, subproblem.propagate(answer.dU))
                return answer.status
            if not (is_hard and self._options.elastic):
                return answer.status
            self._level += 1

    def _direction(self, point: Point, found: Curvature, size: float) -> Direction:
        """Step of the program at a point, relaxed where it has no solution or caution is due."""
        least, status = LEVELS if self._is_cautious else 0, None
        for shift, held in self._convexifications(size):
            self._set_values(point, found.linearisation)
            status = self._solve_at(point, shift, held, least)
            if status is not None or shift > _MOST * size:
                break
        space, s, r = self._space, self._memory, self._problem.size.control
        self._compiled.read_direction(space.program, s, self._level > 0)
        falls, largest, left, weighted = s.sums.tolist()
        largest = max(largest, float(np.abs(found.costates).max()))
        new = (
            space.program.terminal['multiplier'].copy(),
            space.program.path['multiplier'].copy(),
            space.program.stages['bounds'][:, :r].copy(),
        )
        return Direction(
            status or QPStatus.FAILED, new, shift, held, self._level,
            falls, 1.1 * largest, left, weighted,
        )  # fmt: skip

    def _convexifications(self, size: float) -> Iterator[tuple[float, float]]:
        """Terms on the diagonal and weights of held rows that may make the Hessian convex.

        None; with the rows held that are active, which changes no step that keeps them; and with
        ever larger terms, from a third of the last one that was needed.
        """
        yield self._proximal, 0.0
        held = _HELD * max(1.0, size)
        yield self._proximal, held
        term = max(_LEAST * size, self._convexifying / 3.0)
        while True:
            self._convexifying = term
            yield self._proximal + term, held
            term *= 4.0

    def _search(self, point: Point, way: Direction) -> tuple[float, Point, bool]:
        """Step length, 0 if none is accepted; where it leads; corrected."""
        s, length, falls = self._memory, 1.0, way.falls
        rounding = _ROUNDING * (1.0 + abs(point.evaluation.cost) + way.above)
        before = self._merit(point, way.above)
        leaves_most = way.left > 0.9 * point.violation

        def accepts(after: Point, length: float) -> bool:
            if not after.is_finite:
                return False
            now, then = point.violation, after.violation
            gain = point.evaluation.cost - after.evaluation.cost + rounding
            if then <= self._funnel:
                if falls > 0.0 and falls * length > _SWITCH * now:
                    if gain >= 1e-4 * length * falls:
                        return True
                elif then <= (1.0 - 1e-2 * length) * now + 1e-12 and not leaves_most:
                    self._funnel = max(0.5 * (self._funnel + then), 1e-10)
                    return True
            gain += before - self._merit(after, way.above)
            return bool(gain >= 1e-4 * length * (falls + before - way.weighted))

        while length > _SHORTEST:
            after = self._moved_point(point, length * s.dX, length * s.dU)
            if accepts(after, length):
                return length, after, False
            is_full = length == 1.0 and after.is_finite and way.level == 0
            if is_full and after.violation >= point.violation:
                corrected = self._corrected(point, way, after)
                if corrected is not None and accepts(corrected, 1.0):
                    return 1.0, corrected, True
            length *= 0.5
        return 0.0, point, False

    def _moved_point(self, point: Point, dX: Array, dU: Array) -> Point:
        lower, upper = self._problem.control_lower, self._problem.control_upper
        return self._point(point.X + dX, np.minimum(np.maximum(point.U + dU, lower), upper))

    def _corrected(self, point: Point, way: Direction, after: Point) -> Point | None:
        """Step for the constraints' values after the full step, at unchanged derivatives."""
        space, s = self._space, self._memory
        n, r = s.dX.shape[1], s.dU.shape[1]
        self._compiled.set_correction(space.program, s, *after.values)
        if self._solve_at(point, way.shift, way.held, 0) is not QPStatus.SOLVED or self._level:
            return None
        dX = space.program.stages['dX'][:, :n] + s.response
        return self._moved_point(point, dX, space.program.stages['dU'][:, :r])

    def _closed(self, point: Point) -> tuple[Point, float]:
        """The same controls with the states they lead to, where those nearly agree; the gap."""
        if point.violation <= 1e-6:
            closed = self._point(self._problem.predict(point.U), point.U)
            if closed.violation <= max(1e-6, point.violation):
                return closed, 0.0
        return point, float(np.abs(point.ahead - point.X[1:]).max())

    def _is_in_vain(self, way: Direction, point: Point) -> bool:
        """True where relaxed steps have left the violation as it was several times running."""
        is_free = way.level > 0 and not self._is_cautious
        is_idle = is_free and way.left >= _NO_GAIN * point.violation
        is_idle = is_idle and point.violation >= _NO_GAIN * self._violation
        self._violation = point.violation
        self._in_vain = self._in_vain + 1 if is_idle else 0
        return self._in_vain >= _PATIENCE

    def _adapt(self, length: float, size: float) -> None:
        """Proximal term of the next step: less after a full one, more after a short one."""
        if length == 1.0:
            self._is_cautious = False
            self._proximal = 0.1 * self._proximal if self._proximal > 1e-9 * size else 0.0
        elif length <= _SHORT:
            self._proximal = min(max(_LEAST * size, 4.0 * self._proximal), size)

    def _moved(
        self, at: Iterate, to: Point, way: Direction, length: float, is_corrected: bool
    ) -> Iterate:
        self._here, gap = self._closed(to)
        step = replace(self._summary(at, way, length), corrected=is_corrected)
        there, X, value = self._here.U, self._here.X, self._here.evaluation
        return Iterate(at.index + 1, there, X, value, at.guess_size, at.U, step, gap)

    def _summary(self, at: Iterate, way: Direction, length: float) -> Step:
        """Summary of a step; multipliers move as far as the controls do."""
        s, head = self._memory, self._space.program.head
        terminal, path, bounds = (
            old + length * (then - old) if length else old
            for old, then in zip(at.multipliers, way.multipliers, strict=True)
        )
        change, whole = (np.sqrt((each * each).sum(axis=1)).sum() for each in (s.dU, at.U))
        return Step(
            way.status, way.level > 0, s.slack_terminal.copy(), s.slack_path.copy(), length,
            terminal, path, bounds, int(np.count_nonzero(path) + np.count_nonzero(bounds)),
            int(head['iterations'][0]), float(change / (whole or 1.0)), way.shift,
        )  # fmt: skip


def _not_finite(at: Iterate, found: Curvature) -> Step:
    """Summary of a step that could not be looked for."""
    lin = found.linearisation
    terminal, path, bounds = at.multipliers_on(lin)
    return Step(
        QPStatus.FAILED, False, np.zeros_like(terminal), np.zeros_like(path), 0.0, terminal, path,
        bounds, 0, 0, not_finite=lin.not_finite or 'the curvature of the constraints',
    )  # fmt: skip
