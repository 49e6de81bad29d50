"""From stage-wise derivatives to the quadratic program (45) (54) (57) in the controls alone."""

from dataclasses import dataclass

import numpy as np

from cmpsp_ros.arrays import Array, IntArray
from cmpsp_ros.mpsp.jit.compiled import allocation_free
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
    """``dX_k/dU_j`` at ``[j, k]`` by the recursion (23), shape ``(N + 1, N + 1, n, r)``.

    The products of (23) are associated from the other end, ``B_j^(k+1) = A_k B_j^k``, which gives
    every ``k`` of one ``j`` in one sweep and needs no ``Phi_j^k``.
    """
    steps, n, r = B.shape
    result = np.zeros((steps + 1, steps + 1, n, r))
    _sensitivities(result, A, B)
    return result


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
    q = (steps + 1) * r
    blocks = sensitivities(lin.A, lin.B)

    H = np.empty((q, q))
    XX, UX, UU = (np.ascontiguousarray(each) for each in (lin.L_XX, lin.L_UX, lin.L_UU))
    _hessian(H, blocks, lin.A, lin.B, XX, UX, UU, np.empty((2, n, r)))

    c = np.empty(q)
    _gradient(c, lin.A, lin.B, lin.L_X, lin.L_U, np.empty((2, n)))

    S_N = np.empty((len(lin.output_error), q))
    last = np.full(len(S_N), steps)
    _rows(S_N, blocks, last, np.ascontiguousarray(lin.h_X), np.ascontiguousarray(lin.h_U))

    stage, index = np.nonzero(lin.g != -np.inf)
    B_C = np.empty((len(stage), q))
    _rows(B_C, blocks, stage, lin.g_X[stage, index], lin.g_U[stage, index])

    tight = [] if trust_radius is None else list(np.flatnonzero(trust_radius != np.inf))
    trust_stage = np.repeat(np.arange(1, steps + 1), len(tight))
    T = np.empty((len(trust_stage), q))
    unit = np.tile(np.eye(n)[tight].reshape(-1, n), (steps, 1))
    _rows(T, blocks, trust_stage, unit, np.zeros((len(T), r)))
    radius = np.empty(0) if trust_radius is None else np.tile(trust_radius[tight], steps)

    return CondensedQP(
        H=H,
        c=c,
        S_N=S_N,
        output_error=lin.output_error,
        B_C=B_C,
        g=-lin.g[stage, index],
        path_stage=stage,
        path_index=index,
        T=T,
        radius=radius,
        lower=lower.reshape(q),
        upper=upper.reshape(q),
    )


@allocation_free
def _sensitivities(result: Array, A: Array, B: Array) -> None:
    steps, n, r = B.shape
    for j in range(steps):
        for a in range(n):
            for b in range(r):
                result[j, j + 1, a, b] = B[j, a, b]
        for k in range(j + 1, steps):
            for a in range(n):
                for b in range(r):
                    total = 0.0
                    for i in range(n):
                        total += A[k, a, i] * result[j, k, i, b]
                    result[j, k + 1, a, b] = total


@allocation_free
def _hessian(
    H: Array,
    blocks: Array,
    A: Array,
    B: Array,
    L_XX: Array,
    L_UX: Array,
    L_UU: Array,
    responses: Array,
) -> None:
    """Column by column: the costate's response to one control, swept backward, as in (39).

    `responses` is memory, shape ``(2, n, r)``.
    """
    steps, n, r = B.shape
    for l in range(steps + 1):  # noqa: E741
        response, previous = responses[0], responses[1]
        for a in range(n):
            for b in range(r):
                response[a, b] = 0.0
        for k in range(steps, l - 1, -1):
            # Here `response` is dp_(k+1)/dU_l, with p the costate of the gradient below.
            for a in range(r):
                for b in range(r):
                    total = L_UU[l, a, b] if k == l else 0.0
                    for i in range(n):
                        total += L_UX[k, a, i] * blocks[l, k, i, b]
                        if k < steps:
                            total += B[k, i, a] * response[i, b]
                    H[k * r + a, l * r + b] = total
                    H[l * r + b, k * r + a] = total
            response, previous = previous, response
            for a in range(n):
                for b in range(r):
                    total = 0.0
                    for i in range(n):
                        total += L_XX[k, a, i] * blocks[l, k, i, b]
                        if k < steps:
                            total += A[k, i, a] * previous[i, b]
                    response[a, b] = total


@allocation_free
def _gradient(c: Array, A: Array, B: Array, L_X: Array, L_U: Array, costates: Array) -> None:
    """Sweep backward; `costates` is memory, shape ``(2, n)``."""
    steps, n, r = B.shape
    costate, previous = costates[0], costates[1]
    for a in range(n):
        costate[a] = L_X[steps, a]
    for a in range(r):
        c[steps * r + a] = L_U[steps, a]
    for k in range(steps - 1, -1, -1):
        for a in range(r):
            total = L_U[k, a]
            for i in range(n):
                total += B[k, i, a] * costate[i]
            c[k * r + a] = total
        costate, previous = previous, costate
        for a in range(n):
            total = L_X[k, a]
            for i in range(n):
                total += A[k, i, a] * previous[i]
            costate[a] = total


@allocation_free
def _rows(rows: Array, blocks: Array, stage: IntArray, by_state: Array, by_control: Array) -> None:
    """Rows ``by_state dX_k + by_control dU_k`` written in the controls alone, by (19)."""
    stages, _, n, r = blocks.shape
    for p in range(rows.shape[0]):
        k = stage[p]
        for j in range(stages):
            for b in range(r):
                total = by_control[p, b] if j == k else 0.0
                if j < k:
                    for i in range(n):
                        total += by_state[p, i] * blocks[j, k, i, b]
                rows[p, j * r + b] = total
