"""Multiple shooting: states as unknowns beside the controls, with exact second derivatives.

Where the C-MPSP iteration does not converge, this usually does. The linearised dynamics have a gap
at each stage, ``dX_(k+1) = A dX_k + B dU_k + d_k`` with ``d_k = F_k(X_k, U_k) - X_(k+1)``. With the
response ``e`` to the gaps alone, ``dX = e + dX'``, what is left is the program (45) (54) (57) in
``dX'`` and ``dU`` at shifted values, and the same solver answers it.

A step is accepted by a funnel: it lowers the cost where the constraints are met well enough, or
else the violation, or a merit of both [D. Kiessling, S. Leyffer, C. Vanaret, A unified funnel
restoration SQP algorithm, 2024]. A second-order correction is tried first where the full step fails
[Nocedal and Wright, Sec. 18.3].
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from cmpsp_ros.arrays import Array
from cmpsp_ros.mpsp.options import Options
from cmpsp_ros.mpsp.problem import Linearisation, OptimalControlProblem
from cmpsp_ros.mpsp.qp import (
    RICCATI_ACTIVE_SET,
    Penalties,
    QPSolution,
    QPStatus,
    no_warm_start,
    solve_qp,
)
from cmpsp_ros.mpsp.qp.active_set.records import is_positive_definite
from cmpsp_ros.mpsp.qp.subproblem import Subproblem
from cmpsp_ros.mpsp.results import Iterate, residual_at
from cmpsp_ros.mpsp.sqp.lagrangian import (
    Curvature,
    hold_rows,
    lagrangian_curvature,
    multipliers,
    response,
    stage_blocks,
)
from cmpsp_ros.mpsp.sqp.shooting_records import (
    Direction,
    Point,
    not_finite,
    relaxation_levels,
    summary,
    weighted_violation,
)

# Violation above which the Hessian is that of Gauss and Newton, and below which the step is held
# short by a proximal term instead of by the line search alone.
_FAR, _NEAR = 0.3, 3e-3
# Least curvature left by a projection, and weight of held rows, relative to the Hessian.
_FLOOR, _HELD = 1e-6, 1e2
_ATTEMPTS, _SHORT, _SHORTEST = 12, 4, 1e-4
# A relaxed step that leaves this much of the violation, so many times running, is the last.
_NO_GAIN, _PATIENCE = 0.99, 5
# Length below which the next steps are relaxed, so that the proximal term can hold them short.
_CAUTION = 0.02
_ROUNDING = 1e-12
# Decrease of the cost, relative to the violation, from which on a step is for the cost.
_SWITCH = 1e-2


class MultipleShooting:
    """The iteration for one problem; it remembers funnel and proximal term between steps."""

    def __init__(self, problem: OptimalControlProblem, options: Options) -> None:
        """Take a problem that gives `next_states` and `constraint_curvature`, and the options."""
        self._problem, self._options = problem, options
        terminal, path, _ = options.fitted(problem.size)
        rows = Penalties(terminal, np.tile(path, (problem.size.horizon + 1, 1)))
        self._levels = relaxation_levels(rows)
        self._hard = Penalties(np.full_like(rows.terminal, np.inf), np.full_like(rows.path, np.inf))
        self._funnel = np.inf
        self._begins_near = False
        self._proximal, self._last_length, self._in_vain = 0.0, 0.0, 0
        self._is_cautious, self._violation = False, 0.0
        self._here: Point | None = None
        # The first Hessian that is tried, and the active rows of the last program.
        self._delta, self._warm = 0.0, no_warm_start(problem.size)

    def start(self, at: Iterate) -> Iterate:
        """Begin at an iterate; its multipliers are forgotten, and estimated anew."""
        self._here = self._point(at.X, at.U)
        violation = self._here.violation
        self._funnel, self._begins_near = max(1.0, 1.25 * violation), violation < _FAR
        self._proximal, self._last_length, self._in_vain = 0.0, 0.0, 0
        self._is_cautious, self._delta = False, 0.0
        self._warm.clear()
        return replace(at, step=None)

    def subproblem(self, at: Iterate) -> Subproblem:
        """Derivatives at an iterate with the exact Hessian of the cost; gaps are not in it."""
        lin = self._problem.linearise(at.X, at.U, 'exact')
        return self._with_bounds(lin, at.U)

    residual = staticmethod(residual_at)

    def step(self, at: Iterate, subproblem: Subproblem) -> Iterate:
        """One iteration; an iterate that cannot be improved keeps its controls."""
        point = self._here
        if point is None or point.X is not at.X:
            point = self._point(at.X, at.U)
        found = lagrangian_curvature(self._problem, at, subproblem.linearisation)
        if point.violation > _FAR and not self._begins_near:
            lin = self._problem.linearise(at.X, at.U, 'gauss_newton')
            found = found._replace(H=stage_blocks(lin.L_XX, lin.L_UX, lin.L_UU))
        size = max(1e-6, float(np.abs(found.H).max()))
        if not np.isfinite(size):
            return replace(at, index=at.index + 1, previous_U=at.U, step=not_finite(at, found))
        is_near, way = point.violation < _NEAR, None
        for attempt in range(_ATTEMPTS):
            way = self._direction(at, point, found, size)
            if way.solution.status is QPStatus.SOLVED:
                is_patient = attempt < _SHORT and (is_near or self._is_cautious)
                shortest = 0.2 if is_patient else _SHORTEST
                length, after, is_corrected = self._search(point, found, way, shortest)
                if length > 0.0:
                    if self._is_in_vain(way, point):
                        break
                    self._adapt(length, attempt, size, point.violation)
                    return self._moved(at, after, way, found, length, is_corrected)
            self._proximal = max(1e-4 * size, 10.0 * self._proximal)
            # No proximal term shortens a step to constraints that nearly depend on each other.
            self._is_cautious |= attempt >= _SHORT and self._options.elastic
        step = not_finite(at, found) if way is None else summary(at, way, found, 0.0)
        return replace(at, index=at.index + 1, previous_U=at.U, step=step)

    def _point(self, X: Array, U: Array) -> Point:
        with np.errstate(all='ignore'):
            value, ahead = self._problem.evaluate_with_next(X, U)
            gaps = ahead - X[1:]
            total = np.abs(gaps).sum() + np.abs(value.output_error).sum()
        return Point(X, U, value, gaps, float(total + np.maximum(value.g, 0.0).sum()))

    def _with_bounds(self, lin: Linearisation, U: Array) -> Subproblem:
        free = np.full(self._problem.size.state, np.inf)
        return Subproblem(
            lin, self._problem.control_lower - U, self._problem.control_upper - U, free
        )

    def _shifted(
        self,
        found: Curvature,
        H: Array,
        point: Point,
        gaps: Array | None = None,
        values: tuple[Array, Array] | None = None,
    ) -> tuple[Subproblem, Array]:
        """Subproblem without gaps that stands for one with them, and the response ``e``.

        Gaps, and terminal error and path constraints, are those of the point unless given.
        """
        lin, U = found.linearisation, point.U
        gaps = point.gaps if gaps is None else gaps
        error, g = values or (point.evaluation.output_error, point.evaluation.g)
        e = response(lin.A, gaps)
        n = e.shape[1]
        change = np.einsum('kij,kj->ki', H[:, :, :n], e)
        XX, UX, UU = map(np.ascontiguousarray, (H[:, :n, :n], H[:, n:, :n], H[:, n:, n:]))
        lin = Linearisation(
            lin.A, lin.B, lin.L_X + change[:, :n], lin.L_U + change[:, n:], XX, UX, UU,
            error + lin.h_X @ e[-1], lin.h_X, lin.h_U,
            self._changed(lin, g, np.einsum('kli,ki->kl', lin.g_X, e)), lin.g_X, lin.g_U,
        )  # fmt: skip
        return self._with_bounds(lin, U), e

    def _changed(self, lin: Linearisation, g: Array, change: Array) -> Array:
        """Path constraints with a change, those that apply."""
        with np.errstate(invalid='ignore'):
            return np.where(lin.g == -np.inf, lin.g, g + change)

    def _direction(self, at: Iterate, point: Point, found: Curvature, size: float) -> Direction:
        """Step of the program at a point, relaxed where it has no solution or caution is due."""
        weights, is_relaxed = self._hard, self._is_cautious
        solution, delta = None, 0.0
        for delta, convex in self._convex_choices(at, point, found, size):
            qp, e = self._shifted(convex, convex.H, point)
            if is_relaxed:
                if not is_positive_definite(qp):
                    continue
                solution, weights = self._relaxed(qp)
                break
            solution = self._solved(qp)
            if solution is not None:
                if solution.status is not QPStatus.SOLVED and self._options.elastic:
                    solution, weights = self._relaxed(qp)
                    is_relaxed = True
                break
        if solution is None:
            solution = QPSolution.unsolved(qp.size, QPStatus.FAILED)
        lin = qp.linearisation
        dX = response(lin.A, np.einsum('kia,ka->ki', lin.B, solution.dU[:-1]))
        slack, miss = np.zeros_like(lin.g), np.zeros_like(lin.output_error)
        if is_relaxed:
            slack, miss = np.maximum(qp.path(solution.dU, dX), 0.0), qp.terminal(solution.dU, dX)
        H = stage_blocks(lin.L_XX, lin.L_UX, lin.L_UU)
        return Direction(dX + e, solution.dU, solution, H, delta, is_relaxed, weights, miss, slack)

    def _solved(self, qp: Subproblem) -> QPSolution | None:
        """Solution of a program; None where it is not convex."""
        is_ours = self._options.qp == RICCATI_ACTIVE_SET
        if not is_ours and not is_positive_definite(qp):
            return None
        solution = solve_qp(qp, self._options.qp, None, self._warm)
        is_doubtful = is_ours and solution.status is QPStatus.FAILED
        return None if is_doubtful and not is_positive_definite(qp) else solution

    def _convex_choices(
        self, at: Iterate, point: Point, found: Curvature, size: float
    ) -> Iterator[tuple[float, Curvature]]:
        """Hessians that give the same step near a solution and may be positive definite."""
        unit = np.eye(found.H.shape[1])
        H = found.H + self._proximal * unit
        lin, weight = found.linearisation, _HELD * max(1.0, size)
        _, rho, beta = multipliers(at, lin)
        yield self._proximal, found._replace(H=H)
        found = found._replace(H=H)
        held = hold_rows(found, rho > 1e-8, beta != 0.0, weight)
        yield self._proximal, held
        delta = max(1e-4 * size, self._delta / 3.0)
        while delta < 1e3 * size:
            self._delta = delta
            yield delta + self._proximal, held._replace(H=held.H + delta * unit)
            delta *= 4.0

    def _relaxed(self, qp: Subproblem) -> tuple[QPSolution, Penalties]:
        """Solution with the lightest rows relaxed, or more of them; all at once in caution."""
        solution, weights = QPSolution.unsolved(qp.size, QPStatus.FAILED), self._levels[-1]
        for weights in self._levels[-1:] if self._is_cautious else self._levels:
            solution = solve_qp(qp, self._options.qp, weights)
            if solution.status is QPStatus.SOLVED:
                break
        return solution, weights

    def _search(
        self, point: Point, found: Curvature, way: Direction, shortest: float
    ) -> tuple[float, Point, bool]:
        """Step length, 0 if none of at least `shortest` is accepted; where it leads; corrected."""
        lin, length = found.linearisation, 1.0
        falls = -float(np.vdot(lin.L_X, way.dX) + np.vdot(lin.L_U, way.dU))
        largest = [way.solution.terminal, way.solution.path, found.costates]
        largest += [w[np.isfinite(w)] for w in (way.weights.terminal, way.weights.path)]
        above = 1.1 * max(float(np.abs(each).max(initial=0.0)) for each in largest)
        rounding = _ROUNDING * (1.0 + abs(point.evaluation.cost) + above)
        weights = way.merit_weights(above)
        before, left = weighted_violation(point, above, weights), way.left(weights)
        leaves_most = way.slack > 0.9 * point.violation

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
            gain += before - weighted_violation(after, above, weights)
            return gain >= 1e-4 * length * (falls + before - left)

        while length > shortest:
            after = self._moved_point(point, length * way.dX, length * way.dU)
            if accepts(after, length):
                return length, after, False
            is_full = length == 1.0 and after.is_finite and not way.is_relaxed
            if is_full and after.violation >= point.violation:
                corrected = self._corrected(point, found, way, after)
                if corrected is not None and accepts(corrected, 1.0):
                    return 1.0, corrected, True
            length *= 0.5
        return 0.0, point, False

    def _moved_point(self, point: Point, dX: Array, dU: Array) -> Point:
        lower, upper = self._problem.control_lower, self._problem.control_upper
        return self._point(point.X + dX, np.clip(point.U + dU, lower, upper))

    def _corrected(
        self, point: Point, found: Curvature, way: Direction, after: Point
    ) -> Point | None:
        """Step for the constraints' values after the full step, at unchanged derivatives."""
        dX, dU, value, lin = way.dX, way.dU, after.evaluation, found.linearisation
        moved = np.einsum('kij,kj->ki', lin.A, dX[:-1]) + np.einsum('kia,ka->ki', lin.B, dU[:-1])
        error = value.output_error - lin.h_X @ dX[-1] - lin.h_U @ dU[-1]
        change = np.einsum('kli,ki->kl', lin.g_X, dX) + np.einsum('kla,ka->kl', lin.g_U, dU)
        values = error, self._changed(lin, value.g, -change)
        qp, e = self._shifted(found, way.H, point, after.gaps + dX[1:] - moved, values)
        solution = solve_qp(qp, self._options.qp)
        if solution.status is not QPStatus.SOLVED:
            return None
        moved = response(lin.A, np.einsum('kia,ka->ki', lin.B, solution.dU[:-1]))
        return self._moved_point(point, moved + e, solution.dU)

    def _closed(self, point: Point) -> tuple[Point, float]:
        """The same controls with the states they lead to, where those nearly agree; the gap."""
        if point.violation <= 1e-6:
            closed = self._point(self._problem.predict(point.U), point.U)
            if closed.violation <= max(1e-6, point.violation):
                return closed, 0.0
        return point, float(np.abs(point.gaps).max())

    def _is_in_vain(self, way: Direction, point: Point) -> bool:
        """True where relaxed steps have left the violation as it was several times running."""
        is_free = way.is_relaxed and not self._is_cautious
        least = _NO_GAIN * point.violation
        is_idle = is_free and way.slack >= least and point.violation >= _NO_GAIN * self._violation
        self._violation = point.violation
        self._in_vain = self._in_vain + 1 if is_idle else 0
        return self._in_vain >= _PATIENCE

    def _adapt(self, length: float, attempt: int, size: float, violation: float) -> None:
        """Proximal term of the next step: less after a full one, more after a short one."""
        self._last_length = length
        if violation < _NEAR or (attempt == 0 and length == 1.0 and self._proximal == 0.0):
            self._is_cautious = False
        elif length < _CAUTION and self._options.elastic:
            self._is_cautious = True
        if attempt == 0 and length == 1.0:
            self._proximal = 0.1 * self._proximal if self._proximal > 1e-9 * size else 0.0
        elif attempt == 0 and length <= 0.2:
            is_tangential = violation < 0.03 or self._is_cautious
            limit = 1e2 * size if is_tangential else 1e-2 * size
            self._proximal = min(max(1e-4 * size, 4.0 * self._proximal), limit)

    def _moved(
        self,
        at: Iterate,
        to: Point,
        way: Direction,
        found: Curvature,
        length: float,
        is_corrected: bool,
    ) -> Iterate:
        self._here, gap = self._closed(to)
        step = replace(summary(at, way, found, length), corrected=is_corrected)
        there, X, value = self._here.U, self._here.X, self._here.evaluation
        return Iterate(at.index + 1, there, X, value, at.guess_size, at.U, step, gap)
