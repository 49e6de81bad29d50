"""What problems have in common that are given stage by stage and differentiated by ``(x, u)``."""

from __future__ import annotations

from abc import abstractmethod

import numpy as np

from cmpsp_ros.arrays import Array
from cmpsp_ros.mpsp.problem import (
    Dimensions,
    Hessian,
    Linearisation,
    OptimalControlProblem,
    check_hessian,
)
from cmpsp_ros.mpsp.qp.curvature import project_stages


class StageProblem(OptimalControlProblem):
    """A problem whose derivatives come by ``Z_k = (X_k, U_k)``; the first ones are checked."""

    def __init__(
        self, size: Dimensions, start: Array, target: Array, bounds: tuple[Array, Array]
    ) -> None:
        """Take the sizes, the initial state ``(n,)``, the target ``(m,)`` and the bounds.

        Raises:
            ProblemError: They do not fit each other.
        """
        self.size, self.target = size, target
        self.control_lower, self.control_upper = bounds
        self.check()
        self._start, self._checked = start, False

    def linearise(self, X: Array, U: Array, hessian: Hessian = 'gauss_newton') -> Linearisation:
        """Derivatives along a trajectory.

        Raises:
            ProblemError: There is no such Hessian, or a derivative is not finite the first time.
        """
        check_hessian(hessian)
        N, n, at = self.size.horizon, self.size.state, self.evaluate(X, U)
        F_Z, L_Z, L_ZZ, h_Z, g_Z = self._derivatives(X, U, hessian)
        g_Z[at.g == -np.inf] = 0.0
        blocks = self._blocks(L_ZZ)
        if hessian == 'projected':
            blocks = project_stages(*blocks)
        arrays = (
            F_Z[:N, :, :n], F_Z[:N, :, n:],
            L_Z[:, :n], L_Z[:, n:], *blocks,
            at.output_error, h_Z[:, :n], h_Z[:, n:],
            at.g, g_Z[:, :, :n], g_Z[:, :, n:],
        )  # fmt: skip
        result = Linearisation(*map(np.ascontiguousarray, arrays))
        if not self._checked:
            result.check(self.size)
            self._checked = True
        return result

    def constraint_curvature(
        self, X: Array, U: Array, costates: Array, terminal: Array, path: Array
    ) -> tuple[Array, Array, Array]:
        """As of `OptimalControlProblem`."""
        return self._blocks(self._curvature(X, U, costates, terminal, path))

    def _blocks(self, second: Array) -> tuple[Array, Array, Array]:
        n = self.size.state
        return second[:, :n, :n], second[:, n:, :n], second[:, n:, n:]

    @abstractmethod
    def _derivatives(self, X: Array, U: Array, hessian: Hessian) -> tuple[Array, ...]:
        """Jacobians and Hessians by ``Z_k``, with ``d = n + r``.

        Returns:
            ``F_Z (N or more, n, d)``, ``L_Z (N + 1, d)``, ``L_ZZ (N + 1, d, d)``, ``h_Z (m, d)``
            and ``g_Z (N + 1, l, d)``.
        """

    @abstractmethod
    def _curvature(
        self, X: Array, U: Array, costates: Array, terminal: Array, path: Array
    ) -> Array:
        """Weighted second derivatives by ``Z_k``, shape ``(N + 1, d, d)``."""
