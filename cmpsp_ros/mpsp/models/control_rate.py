"""A cost on the change of the control from one stage to the next, for any problem."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from cmpsp_ros.mpsp.errors import ProblemError
from cmpsp_ros.mpsp.jit.compiled import allocation_free
from cmpsp_ros.mpsp.problem import (
    Array,
    Dimensions,
    Evaluation,
    Hessian,
    Linearisation,
    OptimalControlProblem,
)
from cmpsp_ros.mpsp.qp.riccati.program import Records
from cmpsp_ros.mpsp.sqp.driver import Functions


class ControlRateProblem(OptimalControlProblem):
    """Adds ``w/2 sum |U_k - U_(k-1)|^2`` to a problem.

    The form (1)-(6) knows only costs of one stage, so the previous control joins the state: it is
    the last ``r`` components of ``X_k``, and the cost has cross terms ``L_XU``.
    """

    def __init__(self, problem: OptimalControlProblem, weight: float, previous: Array) -> None:
        """Wrap a problem.

        Args:
            problem: The problem without the cost.
            weight: ``w``, not negative.
            previous: Control held before the horizon begins, shape ``(r,)``.

        Raises:
            ProblemError: The weight is negative, or ``previous`` has the wrong shape.
        """
        inner = problem.size
        if not weight >= 0.0:
            raise ProblemError(f'weight: found {weight}, wanted a number >= 0')
        if previous.shape != (inner.control,):
            raise ProblemError(f'previous: found shape {previous.shape}, wanted {(inner.control,)}')
        self.size = Dimensions(
            inner.horizon, inner.state + inner.control, inner.control, inner.output, inner.path
        )
        self.control_lower = problem.control_lower
        self.control_upper = problem.control_upper
        self.target = problem.target
        self._inner = problem
        self._weight = weight
        self._previous = previous

    def predict(self, U: Array) -> Array:
        """States of the inner problem, each beside the control before it."""
        return np.hstack([self._inner.predict(U), np.vstack([self._previous, U[:-1]])])

    def evaluate(self, X: Array, U: Array) -> Evaluation:
        """Value of the inner problem and the cost of its changes of control."""
        n = self._inner.size.state
        inner = self._inner.evaluate(X[:, :n], U)
        change = U - X[:, n:]
        cost = inner.cost + 0.5 * self._weight * float(np.vdot(change, change))
        return Evaluation(cost, inner.output_error, inner.g)

    def linearise(self, X: Array, U: Array, hessian: Hessian = 'gauss_newton') -> Linearisation:
        """Derivatives of the inner problem, with those of the added cost and state."""
        n, r, stages = self._inner.size.state, self.size.control, self.size.horizon + 1
        lin = self._inner.linearise(X[:, :n], U, hessian)
        pull = self._weight * (U - X[:, n:])
        curvature = self._weight * np.eye(r)
        A = np.zeros((stages - 1, n + r, n + r))
        A[:, :n, :n] = lin.A
        L_XX = np.zeros((stages, n + r, n + r))
        L_XX[:, :n, :n] = lin.L_XX
        L_XX[:, n:, n:] = curvature
        B = np.concatenate([lin.B, np.tile(np.eye(r), (stages - 1, 1, 1))], axis=1)
        L_UX = np.concatenate([lin.L_UX, np.tile(-curvature, (stages, 1, 1))], axis=2)
        no_rows = np.zeros((stages, self.size.path, r))
        return Linearisation(
            A=A,
            B=B,
            L_X=np.hstack([lin.L_X, -pull]),
            L_U=lin.L_U + pull,
            L_XX=L_XX,
            L_UX=L_UX,
            L_UU=lin.L_UU + curvature,
            output_error=lin.output_error,
            h_X=np.hstack([lin.h_X, np.zeros((self.size.output, r))]),
            h_U=lin.h_U,
            g=lin.g,
            g_X=np.concatenate([lin.g_X, no_rows], axis=2),
            g_U=lin.g_U,
        )

    def constraint_curvature(
        self, X: Array, U: Array, costates: Array, terminal: Array, path: Array
    ) -> tuple[Array, Array, Array]:
        """That of the inner problem: the added state follows a linear equation."""
        n, r, stages = self._inner.size.state, self.size.control, len(U)
        inner = self._inner.constraint_curvature(X[:, :n], U, costates[:, :n], terminal, path)
        XX, UX = np.zeros((stages, n + r, n + r)), np.zeros((stages, r, n + r))
        XX[:, :n, :n], UX[:, :, :n] = inner[:2]
        return XX, UX, inner[2]


class ControlRateData(NamedTuple):
    """Data of a compiled problem with the cost.

    Attributes:
        inner: Data of the problem without it.
        steps: ``N``.
        weight: ``w``.
        previous: Control held before the horizon begins, shape ``(r,)``.
    """

    inner: object
    steps: int
    weight: float
    previous: Array


def with_control_rate(functions: Functions) -> Functions:
    """The functions of a compiled problem, for `ControlRateData`."""

    def predict(data: ControlRateData, U: Array, X: Array) -> None:
        functions.predict(data.inner, U, X)
        _put_previous(data.previous, data.steps, U, X)

    def evaluate(data: ControlRateData, X: Array, U: Array, output_error: Array, g: Array) -> float:
        cost = functions.evaluate(data.inner, X, U, output_error, g)
        return cost + 0.5 * data.weight * _squared_changes(data.steps, X, U)

    def linearise(
        data: ControlRateData,
        X: Array,
        U: Array,
        stages: Records,
        path: Records,
        terminal: Records,
    ) -> None:
        functions.linearise(data.inner, X, U, stages, path, terminal)
        _add_derivatives(data.weight, data.steps, X, U, stages)

    return Functions(predict, evaluate, linearise)


@allocation_free
def _put_previous(previous: Array, steps: int, U: Array, X: Array) -> None:
    r = U.shape[1]
    n = X.shape[1] - r
    for k in range(steps + 1):
        for a in range(r):
            X[k, n + a] = U[k - 1, a] if k else previous[a]


@allocation_free
def _squared_changes(steps: int, X: Array, U: Array) -> float:
    r = U.shape[1]
    n = X.shape[1] - r
    total = 0.0
    for k in range(steps + 1):
        for a in range(r):
            total += (U[k, a] - X[k, n + a]) ** 2
    return total


@allocation_free
def _add_derivatives(weight: float, steps: int, X: Array, U: Array, stages: Records) -> None:
    r = U.shape[1]
    n = X.shape[1] - r
    for k in range(steps + 1):
        stage = stages[k]
        for a in range(r):
            slope = weight * (U[k, a] - X[k, n + a])
            stage.L_X[n + a] = -slope
            stage.L_U[a] += slope
            stage.L_XX[n + a, n + a] = weight
            stage.L_UX[a, n + a] = -weight
            stage.L_UU[a, a] += weight
            stage.B[n + a, a] = 1.0
