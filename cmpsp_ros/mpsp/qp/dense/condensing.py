"""From stage-wise derivatives to the quadratic program (45) (54) (57) in the controls alone."""

from dataclasses import dataclass

import numpy as np

from cmpsp_ros.arrays import Array, IntArray
from cmpsp_ros.mpsp.problem import Linearisation


@dataclass(frozen=True)
class CondensedQP:
    """Quadratic program in ``dU``, the stacked control deviations, ``q = (N + 1) r`` of them.

    Minimise ``1/2 dU' H dU + c' dU`` subject to ``S_N dU + output_error = 0``, ``B_C dU <= g``,
    ``|T dU| <= radius`` and ``lower <= dU <= upper``.

    Attributes:
        H: Hessian (45), which is ``A_UU`` of (36), shape ``(q, q)``.
        c: Gradient (45), which is ``b_U`` of (38), shape ``(q,)``.
        S_N: Sensitivity of the terminal output (55), shape ``(m, q)``.
        output_error: ``Y_N - Y_N*``, shape ``(m,)``.
        B_C: Path-constraint rows (58), shape ``(p, q)``.
        g: Right-hand side (59), shape ``(p,)``.
        path_stage: Stage ``k`` of each path row, shape ``(p,)``.
        path_index: Which of the stage's constraints each path row is, shape ``(p,)``.
        T: Trust-region rows, shape ``(t, q)``.
        radius: Their bounds, shape ``(t,)``.
        lower: Least control deviations, shape ``(q,)``.
        upper: Largest control deviations, shape ``(q,)``.
    """

    H: Array
    c: Array
    S_N: Array
    output_error: Array
    B_C: Array
    g: Array
    path_stage: IntArray
    path_index: IntArray
    T: Array
    radius: Array
    lower: Array
    upper: Array

    @property
    def rows(self) -> Array:
        """Terminal, path and trust rows, stacked; shape ``(m + p + t, q)``."""
        return np.concatenate([self.S_N, self.B_C, self.T])


def sensitivities(A: Array, B: Array) -> Array:
    """``dX_k/dU_j`` at ``[j, k]`` by the recursion (23), shape ``(N + 1, N + 1, n, r)``."""
    K, n, r = len(B) + 1, *B.shape[1:]
    return np.ascontiguousarray(_by_controls(A, B).reshape(K, n, K, r).transpose(2, 0, 1, 3))


def _by_controls(A: Array, B: Array) -> Array:
    """States of each stage by all controls, ``(N + 1, n, q)``.

    The products of (23) are associated from the other end, ``B_j^(k+1) = A_k B_j^k``, which gives
    all of a stage from the stage before and needs no ``Phi_j^k``.
    """
    steps, n, r = B.shape
    X: Array = np.zeros((steps + 1, n, (steps + 1) * r))
    for k in range(steps):
        X[k + 1, :, : k * r] = A[k] @ X[k, :, : k * r]
        X[k + 1, :, k * r : (k + 1) * r] = B[k]
    return X


def condense(
    linearisation: Linearisation, lower: Array, upper: Array, trust_radius: Array | None = None
) -> CondensedQP:
    """Eliminate the states: the quadratic program (45) (54) (57) of one iteration.

    Bounds of the deviations have shape ``(N + 1, r)``; the trust region is the largest predicted
    change of each state at every stage, ``(n,)``, infinite where free. Time and memory grow with
    the square of the horizon.
    """
    lin = linearisation
    steps, n, r = lin.B.shape
    K, q, each = steps + 1, (steps + 1) * r, np.arange(steps + 1)

    def rows(by_state: Array, by_control: Array) -> Array:
        """Rows ``by_state dX_k + by_control dU_k`` of each stage, by (19); ``(K, rows, q)``."""
        found: Array = by_state @ X
        found.reshape(K, -1, K, r)[each, :, each] += by_control
        return found

    with np.errstate(all='ignore'):
        X = _by_controls(lin.A, lin.B)
        cross = rows(lin.L_UX, 0.5 * lin.L_UU).reshape(q, q)
        H = X.reshape(K * n, q).T @ (lin.L_XX @ X).reshape(K * n, q) + cross + cross.T
        S_N = lin.h_X @ X[-1]
        S_N[:, q - r :] += lin.h_U
        path = rows(lin.g_X, lin.g_U)
        c = lin.L_U.ravel() + lin.L_X.ravel() @ X.reshape(K * n, q)
    stage, index = np.nonzero(lin.g != -np.inf)
    radius = np.full(n, np.inf) if trust_radius is None else trust_radius
    tight = np.flatnonzero(radius != np.inf)
    return CondensedQP(
        H=0.5 * (H + H.T),
        c=c,
        S_N=S_N,
        output_error=lin.output_error,
        B_C=path[stage, index],
        g=-lin.g[stage, index],
        path_stage=stage,
        path_index=index,
        T=X[1:, tight].reshape(-1, q),
        radius=np.tile(radius[tight], steps),
        lower=lower.reshape(q),
        upper=upper.reshape(q),
    )
