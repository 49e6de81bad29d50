"""Riccati factorisation of the condensed Hessian along the stages, without forming it.

The sweep factors the Hessian (45) as a product of block-triangular matrices. In the variables
``v`` of that factorisation,

    dU_k = L_k^-T v_k - K_k dX_k,

the cost of the quadratic program is ``1/2 |v - v*|^2`` plus a constant, and a row ``s' dX_k +
d' dU_k`` is one sweep backward from its stage. Each sweep takes time linear in the horizon.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from cmpsp_ros.mpsp.jit.compiled import allocation_free, inlined
from cmpsp_ros.mpsp.problem import Array
from cmpsp_ros.mpsp.riccati.size import dimension
from cmpsp_ros.mpsp.riccati.stage_qp import StageQP

_LEAST_PIVOT = 1e-14


class Whitening(NamedTuple):
    """The factorisation of one program, and room for its sweeps.

    Attributes:
        optimum: ``v*``, the minimum without any row, shape ``((N + 1) r,)``.
        K: Feedback gains, shape ``(N + 1, r, n)``.
        L_inv: Inverse Cholesky factors ``L_k^-1``, lower triangular, shape ``(N + 1, r, r)``.
        A_cl: Closed loop ``A_k - B_k K_k``, shape ``(N, n, n)``.
        B_cl: Inputs ``B_k L_k^-T``, shape ``(N, n, r)``.
        covariance: Of ``dX_k`` where ``v`` has covariance 1, shape ``(N + 1, n, n)``: the squared
            length of a row ``s' dX_k`` in ``v`` is ``s' covariance s``.
        P: Cost to go, shape ``(n, n)``.
        p: Its gradient, shape ``(n,)``.
        PA: Scratch, shape ``(n, n)``.
        PB: Scratch, shape ``(n, r)``.
        G: Scratch, shape ``(r, n)``.
        L: Scratch, shape ``(r, r)``.
        s: Scratch, shape ``(n,)``.
        t: Scratch, shape ``(n,)``.
        d: Scratch, shape ``(r,)``.
    """

    optimum: Array
    K: Array
    L_inv: Array
    A_cl: Array
    B_cl: Array
    covariance: Array
    P: Array
    p: Array
    PA: Array
    PB: Array
    G: Array
    L: Array
    s: Array
    t: Array
    d: Array


def whitening(N: int, n: int, r: int) -> Whitening:
    """Room for the factorisation of programs of these sizes."""
    return Whitening(
        optimum=np.zeros((N + 1) * r),
        K=np.zeros((N + 1, r, n)),
        L_inv=np.zeros((N + 1, r, r)),
        A_cl=np.zeros((N, n, n)),
        B_cl=np.zeros((N, n, r)),
        covariance=np.zeros((N + 1, n, n)),
        P=np.zeros((n, n)),
        p=np.zeros(n),
        PA=np.zeros((n, n)),
        PB=np.zeros((n, r)),
        G=np.zeros((r, n)),
        L=np.zeros((r, r)),
        s=np.zeros(n),
        t=np.zeros(n),
        d=np.zeros(r),
    )


@allocation_free
def factorise(qp: StageQP, white: Whitening) -> bool:
    """Sweep backward over all stages.

    Returns:
        Whether the condensed Hessian is positive definite; else the factorisation is of no use.
    """
    n, r = dimension(qp.state), dimension(qp.control)
    N = qp.A.shape[0]
    if not _eliminate(qp, white, N, False):
        return False
    _cost_to_go(qp, white, N, False)
    for k in range(N - 1, -1, -1):
        A, B = qp.A[k], qp.B[k]
        for i in range(n):
            for j in range(n):
                total = 0.0
                for q in range(n):
                    total += white.P[i, q] * A[q, j]
                white.PA[i, j] = total
            for a in range(r):
                total = 0.0
                for q in range(n):
                    total += white.P[i, q] * B[q, a]
                white.PB[i, a] = total
        if not _eliminate(qp, white, k, True):
            return False
        K, L_inv, A_cl, B_cl = white.K[k], white.L_inv[k], white.A_cl[k], white.B_cl[k]
        for i in range(n):
            for j in range(n):
                total = A[i, j]
                for a in range(r):
                    total -= B[i, a] * K[a, j]
                A_cl[i, j] = total
            for a in range(r):
                total = 0.0
                for b in range(a + 1):
                    total += B[i, b] * L_inv[a, b]
                B_cl[i, a] = total
        if k:
            _cost_to_go(qp, white, k, True)
    return True


@inlined
def _eliminate(qp: StageQP, white: Whitening, k: int, coupled: bool) -> bool:
    """Minimise over the controls of a stage: `K`, `L_inv` and ``v*_k``, and `G` as ``L^-1 G``."""
    n, r = dimension(qp.state), dimension(qp.control)
    L, G, h = white.L, white.G, white.d
    for a in range(r):
        total = qp.L_U[k, a]
        if coupled:
            for i in range(n):
                total += qp.B[k, i, a] * white.p[i]
        h[a] = total
        for j in range(n):
            total = qp.L_UX[k, a, j]
            if coupled:
                for i in range(n):
                    total += qp.B[k, i, a] * white.PA[i, j]
            G[a, j] = total
        for b in range(a + 1):
            total = qp.L_UU[k, a, b]
            if coupled:
                for i in range(n):
                    total += qp.B[k, i, a] * white.PB[i, b]
            L[a, b] = total
    L_inv = white.L_inv[k]
    for a in range(r):
        whole = L[a, a]
        for b in range(a):
            for q in range(b):
                L[a, b] -= L[a, q] * L[b, q]
            L[a, b] *= L_inv[b, b]
            L[a, a] -= L[a, b] * L[a, b]
        if not L[a, a] > _LEAST_PIVOT * whole:
            return False
        L_inv[a, a] = 1.0 / math.sqrt(L[a, a])
    for b in range(r):
        for a in range(b + 1, r):
            total = 0.0
            for q in range(b, a):
                total -= L[a, q] * L_inv[q, b]
            L_inv[a, b] = total * L_inv[a, a]
    # From the last row on, each row needs only those above it: in place.
    for a in range(r - 1, -1, -1):
        total = 0.0
        for b in range(a + 1):
            total += L_inv[a, b] * h[b]
        h[a] = total
        white.optimum[k * r + a] = -total
        for j in range(n):
            total = 0.0
            for b in range(a + 1):
                total += L_inv[a, b] * G[b, j]
            G[a, j] = total
    for a in range(r):
        for j in range(n):
            total = 0.0
            for b in range(a, r):
                total += L_inv[b, a] * G[b, j]
            white.K[k, a, j] = total
    return True


@inlined
def _cost_to_go(qp: StageQP, white: Whitening, k: int, coupled: bool) -> None:
    """``P = L_XX + A' P A - Y' Y`` and its gradient, with ``Y`` in `G` and ``L^-1 h`` in `d`."""
    n, r = dimension(qp.state), dimension(qp.control)
    P, p, Y, h, before = white.P, white.p, white.G, white.d, white.s
    for i in range(n):
        total = qp.L_X[k, i]
        if coupled:
            for q in range(n):
                total += qp.A[k, q, i] * p[q]
        for a in range(r):
            total -= Y[a, i] * h[a]
        before[i] = total
        for j in range(i + 1):
            total = qp.L_XX[k, i, j]
            if coupled:
                for q in range(n):
                    total += qp.A[k, q, i] * white.PA[q, j]
            for a in range(r):
                total -= Y[a, i] * Y[a, j]
            P[i, j] = total
            P[j, i] = total
    for i in range(n):
        p[i] = before[i]


@allocation_free
def spread(qp: StageQP, white: Whitening) -> None:
    """Fill in `covariance`, by which `row_length` goes: forward over all stages.

    The next one is ``A_cl covariance A_cl' + B_cl B_cl'``.
    """
    n, r = dimension(qp.state), dimension(qp.control)
    AS = white.PA
    for k in range(qp.A.shape[0]):
        A_cl, B_cl, now, then = (
            white.A_cl[k],
            white.B_cl[k],
            white.covariance[k],
            white.covariance[k + 1],
        )
        for i in range(n):
            for j in range(n):
                total = 0.0
                for q in range(n):
                    total += A_cl[i, q] * now[q, j]
                AS[i, j] = total
        for i in range(n):
            for j in range(i + 1):
                total = 0.0
                for q in range(n):
                    total += AS[i, q] * A_cl[j, q]
                for a in range(r):
                    total += B_cl[i, a] * B_cl[j, a]
                then[i, j] = total
                then[j, i] = total


@allocation_free
def row_length(qp: StageQP, white: Whitening, k: int) -> float:
    """Length in ``v`` of the row that `whiten_row` would make, after `spread`; `s` is lost."""
    n, r = dimension(qp.state), dimension(qp.control)
    s, d = white.s, white.d
    squared = 0.0
    for a in range(r):
        total = 0.0
        for b in range(a + 1):
            total += white.L_inv[k, a, b] * d[b]
        squared += total * total
        for j in range(n):
            s[j] -= white.K[k, a, j] * d[a]
    for i in range(n):
        total = 0.0
        for j in range(n):
            total += white.covariance[k, i, j] * s[j]
        squared += s[i] * total
    return math.sqrt(max(squared, 0.0))


@allocation_free
def unwhiten(qp: StageQP, white: Whitening, v: Array, dU: Array, dX: Array) -> None:
    """Control and state deviations of ``v``.

    Args:
        qp: The program.
        white: Its factorisation.
        v: Shape ``((N + 1) r,)``.
        dU: Filled, shape ``(N + 1, r)``.
        dX: Filled, shape ``(N + 1, n)``.
    """
    n, r = dimension(qp.state), dimension(qp.control)
    N = qp.A.shape[0]
    for i in range(n):
        dX[0, i] = 0.0
    for k in range(N + 1):
        K, L_inv, at = white.K[k], white.L_inv[k], k * r
        for a in range(r):
            total = 0.0
            for b in range(a, r):
                total += L_inv[b, a] * v[at + b]
            for j in range(n):
                total -= K[a, j] * dX[k, j]
            dU[k, a] = total
        if k == N:
            break
        A_cl, B_cl = white.A_cl[k], white.B_cl[k]
        for i in range(n):
            total = 0.0
            for j in range(n):
                total += A_cl[i, j] * dX[k, j]
            for a in range(r):
                total += B_cl[i, a] * v[at + a]
            dX[k + 1, i] = total


@inlined
def whiten_row(qp: StageQP, white: Whitening, k: int, row: Array) -> int:
    """A row ``s' dX_k + d' dU_k`` in ``v``, with ``s`` and ``d`` taken from the factorisation's.

    Args:
        qp: The program.
        white: Its factorisation; its scratch `s` and `d` hold the row and are overwritten.
        k: Stage of the row.
        row: Filled up to the count returned, shape ``((N + 1) r,)``.

    Returns:
        How many leading entries may be other than 0.
    """
    n, r = dimension(qp.state), dimension(qp.control)
    s, t, d = white.s, white.t, white.d
    for a in range(r):
        total = 0.0
        for b in range(a + 1):
            total += white.L_inv[k, a, b] * d[b]
        row[k * r + a] = total
        for j in range(n):
            s[j] -= white.K[k, a, j] * d[a]
    for j in range(k - 1, -1, -1):
        A_cl, B_cl = white.A_cl[j], white.B_cl[j]
        for a in range(r):
            total = 0.0
            for i in range(n):
                total += B_cl[i, a] * s[i]
            row[j * r + a] = total
        for i in range(n):
            total = 0.0
            for q in range(n):
                total += A_cl[q, i] * s[q]
            t[i] = total
        s, t = t, s
    return (k + 1) * r
