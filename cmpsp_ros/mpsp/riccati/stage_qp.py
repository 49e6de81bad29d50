"""The quadratic program of one iteration as arrays over the stages, for compiled code."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from cmpsp_ros.mpsp.jit.compiled import allocation_free
from cmpsp_ros.mpsp.problem import Array
from cmpsp_ros.mpsp.riccati.size import Size, dimension, fixed


class StageQP(NamedTuple):
    """Quadratic program in ``dU`` with the linearised states ``dX`` kept; ``dX_0 = 0``.

    Minimise the sum over the stages of ``L_X' dX + L_U' dU + 1/2 dX' L_XX dX + dU' L_UX dX +
    1/2 dU' L_UU dU`` along ``dX_(k+1) = A dX_k + B dU_k``, subject to ``h_X dX_N + h_U dU_N +
    output_error = 0``, ``g + g_X dX + g_U dU <= 0``, ``|dX_k| <= trust_radius`` for ``k >= 1``,
    and ``lower <= dU <= upper``. It is the program (45) (54) (57) before the states are
    eliminated. All arrays are C-contiguous.

    Attributes:
        state: ``n`` as a `Size`.
        control: ``r`` as a `Size`.
        A: Shape ``(N, n, n)``.
        B: Shape ``(N, n, r)``.
        L_X: Shape ``(N + 1, n)``.
        L_U: Shape ``(N + 1, r)``.
        L_XX: Shape ``(N + 1, n, n)``.
        L_UX: Shape ``(N + 1, r, n)``.
        L_UU: Shape ``(N + 1, r, r)``.
        output_error: Shape ``(m,)``.
        h_X: Shape ``(m, n)``.
        h_U: Shape ``(m, r)``.
        g: Shape ``(N + 1, l)``, ``-inf`` where a constraint does not apply.
        g_X: Shape ``(N + 1, l, n)``.
        g_U: Shape ``(N + 1, l, r)``.
        lower: Least control deviations, ``-inf`` where free, shape ``(N + 1, r)``.
        upper: Largest control deviations, ``inf`` where free, shape ``(N + 1, r)``.
        trust_radius: Largest state deviations, ``inf`` where free, shape ``(n,)``.
    """

    state: Size
    control: Size
    A: Array
    B: Array
    L_X: Array
    L_U: Array
    L_XX: Array
    L_UX: Array
    L_UU: Array
    output_error: Array
    h_X: Array
    h_U: Array
    g: Array
    g_X: Array
    g_U: Array
    lower: Array
    upper: Array
    trust_radius: Array


class Penalty(NamedTuple):
    """Largest multipliers: the exact L1 relaxation of the rows that have a finite one.

    Attributes:
        terminal: One for each terminal output, ``inf`` where hard, shape ``(m,)``.
        path: One for each path constraint, ``inf`` where hard, shape ``(N + 1, l)``.
    """

    terminal: Array
    path: Array


class Multipliers(NamedTuple):
    """Multipliers of all rows, 0 where a row is not active.

    Attributes:
        terminal: ``lambda``, of either sign, shape ``(m,)``.
        path: ``rho``, not negative, shape ``(N + 1, l)``.
        trust: Of the trust region, positive at ``+trust_radius``, shape ``(N + 1, n)``.
        bounds: ``beta``, positive at the upper bound, shape ``(N + 1, r)``.
    """

    terminal: Array
    path: Array
    trust: Array
    bounds: Array


def empty_qp(N: int, n: int, r: int, m: int, l: int) -> StageQP:  # noqa: E741 (the paper's l)
    """A program of these sizes with all numbers 0 and no limits, to be filled."""
    K = N + 1
    return StageQP(
        state=fixed(n),
        control=fixed(r),
        A=np.zeros((N, n, n)),
        B=np.zeros((N, n, r)),
        L_X=np.zeros((K, n)),
        L_U=np.zeros((K, r)),
        L_XX=np.zeros((K, n, n)),
        L_UX=np.zeros((K, r, n)),
        L_UU=np.zeros((K, r, r)),
        output_error=np.zeros(m),
        h_X=np.zeros((m, n)),
        h_U=np.zeros((m, r)),
        g=np.zeros((K, l)),
        g_X=np.zeros((K, l, n)),
        g_U=np.zeros((K, l, r)),
        lower=np.full((K, r), -np.inf),
        upper=np.full((K, r), np.inf),
        trust_radius=np.full(n, np.inf),
    )


def empty_multipliers(N: int, n: int, r: int, m: int, l: int) -> Multipliers:  # noqa: E741
    """Multipliers of these sizes, all 0."""
    return Multipliers(
        np.zeros(m), np.zeros((N + 1, l)), np.zeros((N + 1, n)), np.zeros((N + 1, r))
    )


@allocation_free
def propagate(qp: StageQP, dU: Array, dX: Array) -> None:
    """Linearised states of given control deviations, ``dX_(k+1) = A dX_k + B dU_k`` (7).

    Args:
        qp: The program.
        dU: Control deviations, shape ``(N + 1, r)``.
        dX: Filled with the state deviations, shape ``(N + 1, n)``.
    """
    n, r = dimension(qp.state), dimension(qp.control)
    for i in range(n):
        dX[0, i] = 0.0
    for k in range(qp.A.shape[0]):
        for i in range(n):
            total = 0.0
            for j in range(n):
                total += qp.A[k, i, j] * dX[k, j]
            for j in range(r):
                total += qp.B[k, i, j] * dU[k, j]
            dX[k + 1, i] = total
