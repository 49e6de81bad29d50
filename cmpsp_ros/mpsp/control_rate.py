"""A cost on the change of the control from one stage to the next, for any problem."""

from __future__ import annotations

import numpy as np

from cmpsp_ros.mpsp.errors import ProblemError
from cmpsp_ros.mpsp.problem import (
    Array,
    Dimensions,
    Evaluation,
    Hessian,
    Linearisation,
    OptimalControlProblem,
)


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
