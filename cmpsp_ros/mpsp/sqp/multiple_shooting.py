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
        self, problem: OptimalControlProblem, options: Options, at: Iterate, *, exact: bool
    ) -> None:
        """Take a problem that gives `next_states` and `constraint_curvature`, and a start.

        Unless `exact`, the Hessian is that of Gauss and Newton as long as the violation is large.
        """
        self._problem, self._options = problem, options
        terminal, path, _ = options.fitted(problem.size)
        rows = Penalties(terminal, np.tile(path, (problem.size.horizon + 1, 1)))
        self._levels = relaxation_levels(rows)
        self._here = self._point(at.X, at.U)
        violation = self._here.violation
        self._funnel, self.is_exact = max(1.0, 1.25 * violation), exact or violation < _FAR
        self._proximal = self._convexifying = 0.0
        self._violation, self._in_vain, self._is_cautious = 0.0, 0, False
        self._warm = no_warm_start(problem.size)

    def subproblem(self, at: Iterate) -> Subproblem:
        """Derivatives at an iterate with the exact Hessian of the cost; gaps are not in it."""
        lin = self._problem.linearise(at.X, at.U, 'exact')
        return self._with_bounds(lin, at.U)

    residual = staticmethod(residual_at)

    def step(self, at: Iterate, subproblem: Subproblem) -> Iterate:
        """One iteration; an iterate that cannot be improved keeps its controls."""
        point = self._here
        found = lagrangian_curvature(self._problem, at, subproblem.linearisation)
        if point.violation > _FAR and not self.is_exact:
            lin = self._problem.linearise(at.X, at.U, 'gauss_newton')
            found = found._replace(H=stage_blocks(lin.L_XX, lin.L_UX, lin.L_UU))
        size, attempt = max(1e-6, float(np.abs(found.H).max())), 0
        if not np.isfinite(size):
            return replace(at, index=at.index + 1, previous_U=at.U, step=not_finite(at, found))
        while True:
            way = self._direction(at, point, found, size)
            if way.solution.status is QPStatus.SOLVED:
                length, after, is_corrected = self._search(point, found, way)
                if length > 0.0 and not self._is_in_vain(way, point):
                    if attempt == 0:
                        self._adapt(length, size)
                    return self._moved(at, after, way, found, length, is_corrected)
            attempt += 1
            if attempt == _ATTEMPTS or self._in_vain == _PATIENCE:
                step = summary(at, way, found, 0.0)
                return replace(at, index=at.index + 1, previous_U=at.U, step=step)
            self._proximal = max(_LEAST * size, 10.0 * self._proximal)
            # No proximal term shortens a step to constraints that nearly depend on each other.
            self._is_cautious = self._options.elastic

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
        self, found: Curvature, U: Array, gaps: Array, error: Array, g: Array
    ) -> tuple[Subproblem, Array]:
        """Subproblem without gaps that stands for one with them, and the response ``e``.

        `error` and `g` are terminal error and path constraints.
        """
        lin, H, e = found.linearisation, found.H, response(found.linearisation.A, gaps)
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
        value, hessians = point.evaluation, self._hessians(at, found, size)
        while True:
            shift, convex = next(hessians)
            qp, e = self._shifted(convex, point.U, point.gaps, value.output_error, value.g)
            solution, weights = self._solved(qp)
            if weights is not None or shift > _MOST * size:
                break
        lin = qp.linearisation
        dX = response(lin.A, np.einsum('kia,ka->ki', lin.B, solution.dU[:-1]))
        slack, miss = np.zeros_like(lin.g), np.zeros_like(lin.output_error)
        weights = weights or self._levels[0]
        is_relaxed = weights is not self._levels[0]
        if is_relaxed:
            slack, miss = np.maximum(qp.path(solution.dU, dX), 0.0), qp.terminal(solution.dU, dX)
        return Direction(
            dX + e, solution.dU, solution, convex, shift, is_relaxed, weights, miss, slack
        )

    def _solved(self, qp: Subproblem) -> tuple[QPSolution, Penalties | None]:
        """Solution of a program and its penalties; None where the program is not convex.

        All rows are hard at first, then the lightest are relaxed, or more of them; all in caution.
        """
        name = self._options.qp
        solution, weights = QPSolution.unsolved(qp.size, QPStatus.FAILED), None
        if name != RICCATI_ACTIVE_SET and not is_positive_definite(qp):
            return solution, None
        for weights in self._levels[-1:] if self._is_cautious else self._levels:
            is_hard = weights is self._levels[0]
            warm = self._warm if is_hard else None
            solution = solve_qp(qp, name, None if is_hard else weights, warm)
            if solution.status is QPStatus.SOLVED:
                break
            if solution.status is QPStatus.FAILED and not is_positive_definite(qp):
                return solution, None
            if not self._options.elastic:
                break
        return solution, weights

    def _hessians(
        self, at: Iterate, found: Curvature, size: float
    ) -> Iterator[tuple[float, Curvature]]:
        """Hessians that may be positive definite, with the terms on their diagonals.

        The Lagrangian's; with the rows held that are active, which changes no step that keeps
        them; and with ever larger terms, from a third of the last one that was needed.
        """
        unit = np.eye(found.H.shape[1])
        found = found._replace(H=found.H + self._proximal * unit)
        yield self._proximal, found
        _, rho, beta = multipliers(at, found.linearisation)
        found = hold_rows(found, rho > 1e-8, beta != 0.0, _HELD * max(1.0, size))
        yield self._proximal, found
        term = max(_LEAST * size, self._convexifying / 3.0)
        while True:
            self._convexifying = term
            yield self._proximal + term, found._replace(H=found.H + term * unit)
            term *= 4.0

    def _search(self, point: Point, found: Curvature, way: Direction) -> tuple[float, Point, bool]:
        """Step length, 0 if none is accepted; where it leads; corrected."""
        lin, length = found.linearisation, 1.0
        falls = -float(np.vdot(lin.L_X, way.dX) + np.vdot(lin.L_U, way.dU))
        largest = [way.solution.terminal, way.solution.path, found.costates]
        # Of a relaxed step no gap may weigh less than a row.
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

        while length > _SHORTEST:
            after = self._moved_point(point, length * way.dX, length * way.dU)
            if accepts(after, length):
                return length, after, False
            is_full = length == 1.0 and after.is_finite and not way.is_relaxed
            if is_full and after.violation >= point.violation:
                corrected = self._corrected(point, way, after)
                if corrected is not None and accepts(corrected, 1.0):
                    return 1.0, corrected, True
            length *= 0.5
        return 0.0, point, False

    def _moved_point(self, point: Point, dX: Array, dU: Array) -> Point:
        lower, upper = self._problem.control_lower, self._problem.control_upper
        return self._point(point.X + dX, np.clip(point.U + dU, lower, upper))

    def _corrected(self, point: Point, way: Direction, after: Point) -> Point | None:
        """Step for the constraints' values after the full step, at unchanged derivatives."""
        dX, dU, value, lin = way.dX, way.dU, after.evaluation, way.convex.linearisation
        moved = np.einsum('kij,kj->ki', lin.A, dX[:-1]) + np.einsum('kia,ka->ki', lin.B, dU[:-1])
        error = value.output_error - lin.h_X @ dX[-1] - lin.h_U @ dU[-1]
        change = np.einsum('kli,ki->kl', lin.g_X, dX) + np.einsum('kla,ka->kl', lin.g_U, dU)
        g, gaps = self._changed(lin, value.g, -change), after.gaps + dX[1:] - moved
        qp, e = self._shifted(way.convex, point.U, gaps, error, g)
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
        is_idle = is_free and way.slack >= _NO_GAIN * point.violation
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
