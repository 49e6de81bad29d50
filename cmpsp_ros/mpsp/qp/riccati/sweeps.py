"""Sweeps over a factorised program: rows, their lengths, and steps, in its variables ``v``.

See `factorisation`; each takes time linear in the horizon.
"""

import math

from cmpsp_ros.arrays import Array
from cmpsp_ros.mpsp.jit.compiled import allocation_free
from cmpsp_ros.mpsp.jit.intrinsics import room_for
from cmpsp_ros.mpsp.qp.riccati.factorisation import fixed_control
from cmpsp_ros.mpsp.qp.riccati.program import Program

# Cost of a stage relative to one of `recover_step`.
_COVARIANCE = 2


@allocation_free
def propagate_covariance(p: Program) -> None:
    """Covariance of ``dX_k`` where ``v`` has covariance 1, forward over all stages.

    The squared length of a row ``X' dX_k`` in ``v`` is ``X' covariance X``; the next covariance is
    ``A_cl covariance A_cl' + B_cl B_cl'``.
    """
    n, r = p.stages[0].B.shape
    head, product = p.head[0], room_for(p.stages[0].A)
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
    N, has_fixed = head.horizon, head.fixed > 0
    head.work += N + 1
    # States at this stage and the next.
    X, following = room_for(p.stages[0].L_X), room_for(p.stages[0].L_X)
    for i in range(n):
        X[i] = 0.0
    for k in range(N + 1):
        stage, at = p.stages[k], k * r
        for i in range(n):
            stage.dX[i] = X[i]
        for a in range(r):
            total = stage.L_inv[a, a] * v[at + a]
            for b in range(a + 1, r):
                total += stage.L_inv[b, a] * v[at + b]
            for j in range(n):
                total -= stage.K[a, j] * X[j]
            stage.dU[a] = total
        if has_fixed:
            for a in range(r):
                if stage.fixed[a] != 0.0:
                    stage.dU[a] = fixed_control(stage, a)
        if k < N:
            # Terms without the states come first.
            for i in range(n):
                following[i] = stage.drift[i] if has_fixed else 0.0
                for a in range(r):
                    following[i] += stage.B_cl[i, a] * v[at + a]
                for j in range(n):
                    following[i] += stage.A_cl[i, j] * X[j]
            for i in range(n):
                X[i] = following[i]


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
    """The row in the head's `X` and `U`, of stage `k`, in ``v``.

    Returns how many leading entries of `row` may be other than 0; it is filled up to there.
    """
    stage, given, U = p.stages[k], p.head[0].X, p.head[0].U
    n, r = stage.B.shape
    p.head[0].work += k + 1
    X, before = room_for(stage.L_X), room_for(stage.L_X)
    for i in range(n):
        X[i] = given[i]
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
            total = stage.B_cl[0, a] * X[0]
            for i in range(1, n):
                total += stage.B_cl[i, a] * X[i]
            row[j * r + a] = total
        for i in range(n):
            before[i] = stage.A_cl[0, i] * X[0]
            for q in range(1, n):
                before[i] += stage.A_cl[q, i] * X[q]
        for i in range(n):
            X[i] = before[i]
    return (k + 1) * r
