"""A cost and limits on the change of the control from one stage to the next, for any problem.

The form (1)-(6) knows costs and constraints of one stage only, so the previous control joins the
state: it is the last ``r`` components of ``X_k``, and the cost has cross terms ``L_XU``. A limit on
the change of the change adds the control before it, in the ``r`` components ahead of those.
"""

from __future__ import annotations

import math
from typing import Any, Final, NamedTuple

import numpy as np

from cmpsp_ros.arrays import Array
from cmpsp_ros.mpsp.arguments import ProblemError
from cmpsp_ros.mpsp.jit.compiled import allocation_free, call, call_for_float
from cmpsp_ros.mpsp.problem import (
    Dimensions,
    Evaluation,
    Hessian,
    Linearisation,
    OptimalControlProblem,
)
from cmpsp_ros.mpsp.qp.active_set.records import derivative_arrays, derivatives_in, put_derivatives
from cmpsp_ros.mpsp.qp.active_set.state import Indices
from cmpsp_ros.mpsp.qp.riccati.program import Records, row_type, stage_type
from cmpsp_ros.mpsp.sqp.driver import Functions


class Rates(NamedTuple):
    """A cost and limits on changes of the control; ``U_N`` moves nothing."""

    steps: int  # ``N``
    weight: float  # ``w`` of the cost ``w/2 sum |U_k - U_(k-1)|^2``
    # Controls held before the horizon begins, the last one last: ``(1, r)``, or ``(2, r)`` with a
    # limit on the second difference.
    held: Array
    # Largest change of each row of `rows` at the stages ``0 ... N - 1``; infinite for no limit.
    max_change: float
    rows: Array  # limited linear functions of the control, shape ``(q, r)``
    # Largest second difference ``U_k - 2 U_(k-1) + U_(k-2)`` of each of `second_rows` there, and at
    # the stage ``N`` with ``U_N = 0``; infinite for none.
    max_second: float
    max_second_at_end: float
    second_rows: Array  # likewise

    @classmethod
    def of(
        cls, steps: int, weight: float, previous: Array, max_change: float, rows: Array
    ) -> Rates:
        """Rates without a limit on the second difference, after a control ``(r,)``."""
        return cls(steps, weight, previous[None], max_change, rows, math.inf, math.inf, rows)


class ControlRateData(NamedTuple):
    """Data of a compiled problem with a cost and limits on the change of the control."""

    inner: object  # data of the problem without them
    rates: Rates
    functions: Indices | None = None  # `Functions.addresses` of the problem without them


def rate_rows(limit: float, rows: Array) -> int:
    """Number of path constraints that limit a change: two for each row, none without."""
    return 2 * len(rows) if limit < math.inf else 0


@allocation_free
def _predict(data: Any, U: Array, X: Array) -> None:
    call(data.functions[0], (data.inner, U, X))
    _put_previous(data.rates, U, X)


@allocation_free
def _evaluate(data: Any, X: Array, U: Array, output_error: Array, g: Array) -> float:
    cost: float = call_for_float(data.functions[1], (data.inner, X, U, output_error, g))
    return cost + _evaluate_changes(data.rates, X, U, g)


@allocation_free
def _linearise(
    data: Any, X: Array, U: Array, stages: Records, path: Records, terminal: Records
) -> None:
    call(data.functions[2], (data.inner, X, U, stages, path, terminal))
    _add_derivatives(data.rates, X, U, stages, path)


# A compiled problem with cost and limits, for `ControlRateData`. The problem's own functions leave
# the last path constraints of a stage alone: `rate_rows` of second differences, then of changes.
CONTROL_RATE: Final = Functions(_predict, _evaluate, _linearise)


class ControlRateProblem(OptimalControlProblem):
    """The same for a problem in Python."""

    def __init__(
        self,
        problem: OptimalControlProblem,
        weight: float,
        previous: Array,
        max_change: float = math.inf,
        rows: Array | None = None,
    ) -> None:
        """Wrap a problem; `previous` is the control before, ``(r,)``, others are as in `Rates`.

        Without `rows` all controls are limited.

        Raises:
            ProblemError: The weight is negative, the limit not positive, or ``previous`` has the
                wrong shape.
        """
        inner = problem.size
        if not weight >= 0.0:
            raise ProblemError(f'weight: found {weight}, wanted a number >= 0')
        if not max_change > 0.0:
            raise ProblemError(f'max_change: found {max_change}, wanted a number > 0')
        if previous.shape != (inner.control,):
            raise ProblemError(f'previous: found shape {previous.shape}, wanted {(inner.control,)}')
        rows = np.eye(inner.control) if rows is None else rows
        self._rates = Rates.of(inner.horizon, weight, previous, max_change, rows)
        self.size = Dimensions(
            inner.horizon,
            inner.state + inner.control,
            inner.control,
            inner.output,
            inner.path + rate_rows(max_change, rows),
        )
        self.control_lower = problem.control_lower
        self.control_upper = problem.control_upper
        self.target = problem.target
        self._inner = problem

    def predict(self, U: Array) -> Array:
        """States of the inner problem, each beside the control before it."""
        X = np.empty((self.size.horizon + 1, self.size.state))
        X[:, : self._inner.size.state] = self._inner.predict(U)
        _put_previous(self._rates, np.ascontiguousarray(U), X)
        return X

    def next_states(self, X: Array, U: Array) -> Array:
        """States of the inner problem at the next stage, each beside the control before it."""
        return np.hstack([self._inner.next_states(X[:, : self._inner.size.state], U), U[:-1]])

    def evaluate(self, X: Array, U: Array) -> Evaluation:
        """Value of the inner problem and the cost of its changes of control."""
        inner = self._inner.evaluate(X[:, : self._inner.size.state], U)
        g = np.empty((self.size.horizon + 1, self.size.path))
        g[:, : self._inner.size.path] = inner.g
        X, U = np.ascontiguousarray(X), np.ascontiguousarray(U)
        cost = _evaluate_changes(self._rates, X, U, g)
        return Evaluation(inner.cost + cost, inner.output_error, g)

    def linearise(self, X: Array, U: Array, hessian: Hessian = 'gauss_newton') -> Linearisation:
        """Derivatives of the inner problem, with those of the added cost and constraints."""
        size, K = self.size, self.size.horizon + 1
        row = row_type(size.state, size.control)
        stages = np.zeros(K, stage_type(size.state, size.control))
        path, terminal = np.zeros((K, size.path), row), np.zeros(size.output, row)
        inner = self._inner.linearise(X[:, : self._inner.size.state], U, hessian)
        put_derivatives(derivative_arrays(stages, path, terminal, inner.size), inner)
        X, U = np.ascontiguousarray(X), np.ascontiguousarray(U)
        _add_derivatives(self._rates, X, U, stages, path)
        return derivatives_in(stages, path, terminal, size)

    def constraint_curvature(
        self, X: Array, U: Array, costates: Array, terminal: Array, path: Array
    ) -> tuple[Array, Array, Array]:
        """Curvature of the inner problem: the added constraints are linear."""
        inner, r, stages = self._inner.size, self.size.control, len(U)
        n = inner.state
        found = self._inner.constraint_curvature(
            X[:, :n], U, costates[:, :n], terminal, path[:, : inner.path]
        )
        XX, UX = np.zeros((stages, n + r, n + r)), np.zeros((stages, r, n + r))
        XX[:, :n, :n], UX[:, :, :n] = found[:2]
        return XX, UX, found[2]


@allocation_free
def _put_previous(rates: Any, U: Array, X: Array) -> None:
    count, r = rates.held.shape
    for k in range(rates.steps + 1):
        for age in range(1, count + 1):
            for a in range(r):
                before = U[k - age, a] if k >= age else rates.held[count + k - age, a]
                X[k, X.shape[1] - age * r + a] = before


@allocation_free
def _limited(rates: Any) -> Any:
    """Numbers of limited changes and of limited second differences."""
    changes = rates.rows.shape[0] if rates.max_change < math.inf else 0
    return changes, rates.second_rows.shape[0] if rates.max_second < math.inf else 0


@allocation_free
def _evaluate_changes(rates: Any, X: Array, U: Array, g: Array) -> float:
    """Cost of the changes; the limits' path constraints are filled in."""
    r, N = U.shape[1], rates.steps
    changes, seconds = _limited(rates)
    n, first = X.shape[1] - r, g.shape[1] - 2 * changes
    total = 0.0
    for k in range(N + 1):
        for i in range(seconds):
            second = _second_difference(rates, i, U, X, k)
            limit = rates.max_second if k < N else rates.max_second_at_end
            g[k, first - 2 * (seconds - i)] = second - limit
            g[k, first - 2 * (seconds - i) + 1] = -second - limit
        for a in range(r):
            total += (U[k, a] - X[k, n + a]) ** 2
        for i in range(changes):
            change = _change(rates.rows, i, U, X, k)
            g[k, first + 2 * i] = change - rates.max_change if k < N else -math.inf
            g[k, first + 2 * i + 1] = -change - rates.max_change if k < N else -math.inf
    cost: float = 0.5 * rates.weight * total
    return cost


@allocation_free
def _change(rows: Array, i: int, U: Array, X: Array, k: int) -> float:
    """Change of a row from the control before."""
    change, n = 0.0, X.shape[1] - U.shape[1]
    for a in range(U.shape[1]):
        change += rows[i, a] * (U[k, a] - X[k, n + a])
    return change


@allocation_free
def _second_difference(rates: Any, i: int, U: Array, X: Array, k: int) -> float:
    """Second difference of a row, with ``U_N = 0``."""
    found, r = 0.0, U.shape[1]
    n = X.shape[1] - 2 * r
    for a in range(r):
        now = U[k, a] if k < rates.steps else 0.0
        found += rates.second_rows[i, a] * (now - 2.0 * X[k, n + r + a] + X[k, n + a])
    return found


@allocation_free
def _add_derivatives(rates: Any, X: Array, U: Array, stages: Records, path: Records) -> None:
    r, N, weight, rows = U.shape[1], rates.steps, rates.weight, rates.rows
    changes, seconds = _limited(rates)
    n, first = X.shape[1] - r, path.shape[1] - 2 * changes
    for k in range(N + 1):
        stage = stages[k]
        for a in range(r):
            slope = weight * (U[k, a] - X[k, n + a])
            stage.L_X[n + a] = -slope
            stage.L_U[a] += slope
            stage.L_XX[n + a, n + a] = weight
            stage.L_UX[a, n + a] = -weight
            stage.L_UU[a, a] += weight
            stage.B[n + a, a] = 1.0
            if seconds:
                stage.A[n - r + a, n + a] = 1.0
        for i in range(seconds):
            second = _second_difference(rates, i, U, X, k)
            limit = rates.max_second if k < N else rates.max_second_at_end
            for side in range(2):
                row, sign = path[k, first - 2 * (seconds - i) + side], 1.0 - 2.0 * side
                row.value = sign * second - limit
                for a in range(r):
                    factor = sign * rates.second_rows[i, a]
                    row.U[a] = factor if k < N else 0.0
                    row.X[n + a], row.X[n - r + a] = -2.0 * factor, factor
        for i in range(changes):
            above, below = path[k, first + 2 * i], path[k, first + 2 * i + 1]
            change = _change(rows, i, U, X, k)
            above.value = change - rates.max_change if k < N else -math.inf
            below.value = -change - rates.max_change if k < N else -math.inf
            for a in range(r):
                above.U[a], above.X[n + a] = rows[i, a], -rows[i, a]
                below.U[a], below.X[n + a] = -rows[i, a], rows[i, a]
