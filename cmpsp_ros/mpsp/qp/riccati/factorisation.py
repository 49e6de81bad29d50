"""Riccati factorisation of the condensed Hessian along the stages, without forming it.

The sweep factors the Hessian (45) as a product of block-triangular matrices. In the variables ``v``
of that factorisation,

    dU_k = L_k^-T v_k - K_k dX_k,

the cost of the quadratic program is ``1/2 |v - v*|^2`` plus a constant, and a row ``X' dX_k + U'
dU_k`` is one sweep backward from its stage. Each sweep takes time linear in the horizon. A control
that is held at a bound takes no part: its entry of ``v`` moves nothing.
"""

from __future__ import annotations

import math
from typing import Any

from cmpsp_ros.mpsp.jit.compiled import allocation_free, inner
from cmpsp_ros.mpsp.problem import Array
from cmpsp_ros.mpsp.qp.riccati.program import Program

_SMALLEST_PIVOT = 1e-14
# What a stage of each sweep costs beside one of `recover_step`.
_FACTORISE, _COVARIANCE = 4, 2


@allocation_free
def factorise(p: Program) -> bool:
    """Sweep backward over all stages.

    Returns:
        Whether the condensed Hessian is positive definite; else the factorisation is of no use.
    """
    head, N = p.head[0], p.head[0].horizon
    n, r = p.stages[0].B.shape
    head.work += _FACTORISE * (N + 1)
    head.is_factorised = 0
    head.has_covariance = 0
    if not _eliminate(p.stages[N], head, False):
        return False
    _update_cost_to_go(p.stages[N], head, False)
    for k in range(N - 1, -1, -1):
        stage = p.stages[k]
        A, B = stage.A, stage.B
        for i in range(n):
            for j in range(n):
                total = 0.0
                for q in range(n):
                    total += head.P[i, q] * A[q, j]
                head.PA[i, j] = total
            for a in range(r):
                total = 0.0
                for q in range(n):
                    total += head.P[i, q] * B[q, a]
                head.PB[i, a] = total
        if head.fixed > 0:
            _add_drift(stage, head)
        if not _eliminate(stage, head, True):
            return False
        K, L_inv, A_cl, B_cl = stage.K, stage.L_inv, stage.A_cl, stage.B_cl
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
            _update_cost_to_go(stage, head, True)
    head.is_factorised = 1
    return True


@allocation_free
def fixed_control(stage: Any, a: int) -> float:
    """Deviation of a control that is held at a bound, else 0."""
    if stage.fixed[a] == 0.0:
        return 0.0
    return stage.upper[a] if stage.fixed[a] > 0.0 else stage.lower[a]


@inner
def _add_drift(stage: Any, head: Any) -> None:
    """What the fixed controls do to the next state, and its part in the cost to go's gradient."""
    n, r = stage.B.shape
    for i in range(n):
        total = 0.0
        for a in range(r):
            total += stage.B[i, a] * fixed_control(stage, a)
        stage.drift[i] = total
    for i in range(n):
        for j in range(n):
            head.p[i] += head.P[i, j] * stage.drift[j]


@inner
def _eliminate(stage: Any, head: Any, coupled: bool) -> bool:
    """Minimise over the controls of a stage: `K`, `L_inv` and ``v*_k``, and `G` as ``L^-1 G``."""
    n, r = stage.B.shape
    L, G, h, fixed = head.L, head.G, head.U, head.fixed > 0
    for a in range(r):
        total = stage.L_U[a]
        if coupled:
            for i in range(n):
                total += stage.B[i, a] * head.p[i]
        if fixed:
            for b in range(r):
                total += stage.L_UU[a, b] * fixed_control(stage, b)
        h[a] = total
        for j in range(n):
            total = stage.L_UX[a, j]
            if coupled:
                for i in range(n):
                    total += stage.B[i, a] * head.PA[i, j]
            G[a, j] = total
        for b in range(a + 1):
            total = stage.L_UU[a, b]
            if coupled:
                for i in range(n):
                    total += stage.B[i, a] * head.PB[i, b]
            L[a, b] = total
    if fixed:
        _take_out_fixed(stage, head)
    L_inv = stage.L_inv
    for a in range(r):
        whole = L[a, a]
        for b in range(a):
            for q in range(b):
                L[a, b] -= L[a, q] * L[b, q]
            L[a, b] *= L_inv[b, b]
            L[a, a] -= L[a, b] * L[a, b]
        if not L[a, a] > _SMALLEST_PIVOT * whole:
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
        stage.optimum[a] = -total
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
            stage.K[a, j] = total
    if fixed:
        for a in range(r):
            if stage.fixed[a] != 0.0:
                L_inv[a, a] = 0.0
    return True


@inner
def _take_out_fixed(stage: Any, head: Any) -> None:
    """Decouple the fixed controls from all else, with a pivot of 1."""
    n, r = stage.B.shape
    for a in range(r):
        if stage.fixed[a] != 0.0:
            head.U[a] = 0.0
            for j in range(n):
                head.G[a, j] = 0.0
            for b in range(a):
                head.L[a, b] = 0.0
            for b in range(a + 1, r):
                head.L[b, a] = 0.0
            head.L[a, a] = 1.0


@inner
def _update_cost_to_go(stage: Any, head: Any, coupled: bool) -> None:
    """``P = L_XX + A' P A - Y' Y`` and its gradient, with ``Y`` in `G` and ``L^-1 h`` in `U`."""
    n, r = stage.B.shape
    P, p, Y, h, gradient = head.P, head.p, head.G, head.U, head.X
    for i in range(n):
        total = stage.L_X[i]
        if coupled:
            for q in range(n):
                total += stage.A[q, i] * p[q]
        if head.fixed > 0:
            for a in range(r):
                total += stage.L_UX[a, i] * fixed_control(stage, a)
        for a in range(r):
            total -= Y[a, i] * h[a]
        gradient[i] = total
        for j in range(i + 1):
            total = stage.L_XX[i, j]
            if coupled:
                for q in range(n):
                    total += stage.A[q, i] * head.PA[q, j]
            for a in range(r):
                total -= Y[a, i] * Y[a, j]
            P[i, j] = total
            P[j, i] = total
    for i in range(n):
        p[i] = gradient[i]


@allocation_free
def propagate_covariance(p: Program) -> None:
    """Covariance of ``dX_k`` where ``v`` has covariance 1, forward over all stages.

    The squared length of a row ``X' dX_k`` in ``v`` is ``X' covariance X``; the next covariance is
    ``A_cl covariance A_cl' + B_cl B_cl'``.
    """
    n, r = p.stages[0].B.shape
    head, product = p.head[0], p.head[0].PA
    head.work += _COVARIANCE * (head.horizon + 1)
    head.has_covariance = 1
    for k in range(head.horizon):
        stage, following = p.stages[k], p.stages[k + 1]
        for i in range(n):
            for j in range(n):
                total = 0.0
                for q in range(n):
                    total += stage.A_cl[i, q] * stage.covariance[q, j]
                product[i, j] = total
        for i in range(n):
            for j in range(i + 1):
                total = 0.0
                for q in range(n):
                    total += product[i, q] * stage.A_cl[j, q]
                for a in range(r):
                    total += stage.B_cl[i, a] * stage.B_cl[j, a]
                following.covariance[i, j] = total
                following.covariance[j, i] = total


@allocation_free
def row_norm(p: Program, k: int) -> float:
    """Length in ``v`` of the row in the head's `X` and `U`, which are lost."""
    if p.head[0].has_covariance == 0:
        propagate_covariance(p)
    stage, X, U = p.stages[k], p.head[0].X, p.head[0].U
    n, r = stage.B.shape
    squared = 0.0
    for a in range(r):
        total = 0.0
        for b in range(a + 1):
            total += stage.L_inv[a, b] * U[b]
        squared += total * total
        for j in range(n):
            X[j] -= stage.K[a, j] * U[a]
    for i in range(n):
        total = 0.0
        for j in range(n):
            total += stage.covariance[i, j] * X[j]
        squared += X[i] * total
    return math.sqrt(max(squared, 0.0))


@allocation_free
def recover_step(p: Program, v: Array) -> None:
    """The step ``dU``, ``dX`` of a point ``v``, shape ``((N + 1) r,)``."""
    head = p.head[0]
    n, r = p.stages[0].B.shape
    N, drifts = head.horizon, head.fixed > 0
    head.work += N + 1
    for i in range(n):
        p.stages[0].dX[i] = 0.0
    for k in range(N + 1):
        stage, at = p.stages[k], k * r
        for a in range(r):
            total = 0.0
            for b in range(a, r):
                total += stage.L_inv[b, a] * v[at + b]
            for j in range(n):
                total -= stage.K[a, j] * stage.dX[j]
            stage.dU[a] = total
        if drifts:
            for a in range(r):
                if stage.fixed[a] != 0.0:
                    stage.dU[a] = fixed_control(stage, a)
        if k == N:
            break
        following = p.stages[k + 1]
        for i in range(n):
            total = stage.drift[i] if drifts else 0.0
            for j in range(n):
                total += stage.A_cl[i, j] * stage.dX[j]
            for a in range(r):
                total += stage.B_cl[i, a] * v[at + a]
            following.dX[i] = total


@allocation_free
def keep_origin(p: Program, v: Array) -> None:
    """Keep the step at ``v = 0`` where controls are held at a bound; `v` is scratch."""
    if p.head[0].fixed == 0:
        return
    for i in range(v.shape[0]):
        v[i] = 0.0
    recover_step(p, v)
    for k in range(p.head[0].horizon + 1):
        stage = p.stages[k]
        for a in range(stage.dU.shape[0]):
            stage.origin_U[a] = stage.dU[a]
        for i in range(stage.dX.shape[0]):
            stage.origin_X[i] = stage.dX[i]


@allocation_free
def transform_row(p: Program, k: int, row: Array) -> int:
    """The row in the head's `X` and `U`, which are lost, in ``v``.

    Args:
        p: The program, factorised.
        k: Stage of the row.
        row: Filled up to the count returned, shape ``((N + 1) r,)``.

    Returns:
        How many leading entries may be other than 0.
    """
    stage, X, X_next, U = p.stages[k], p.head[0].X, p.head[0].X_next, p.head[0].U
    n, r = stage.B.shape
    p.head[0].work += k + 1
    for a in range(r):
        total = 0.0
        for b in range(a + 1):
            total += stage.L_inv[a, b] * U[b]
        row[k * r + a] = total
        for j in range(n):
            X[j] -= stage.K[a, j] * U[a]
    for j in range(k - 1, -1, -1):
        stage = p.stages[j]
        for a in range(r):
            total = 0.0
            for i in range(n):
                total += stage.B_cl[i, a] * X[i]
            row[j * r + a] = total
        for i in range(n):
            total = 0.0
            for q in range(n):
                total += stage.A_cl[q, i] * X[q]
            X_next[i] = total
        X, X_next = X_next, X
    return (k + 1) * r
