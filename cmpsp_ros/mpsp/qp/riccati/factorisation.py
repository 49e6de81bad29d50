"""Riccati factorisation of the condensed Hessian along the stages, without forming it.

The sweep factors the Hessian (45) as a product of block-triangular matrices. In the variables ``v``
of that factorisation,

    dU_k = L_k^-T v_k - K_k dX_k,

the cost of the quadratic program is ``1/2 |v - v*|^2`` plus a constant, and a row ``X' dX_k + U'
dU_k`` is one sweep backward from its stage. Each sweep takes time linear in the horizon. A control
that is held at a bound takes no part: its entry of ``v`` moves nothing.
"""

import math
from typing import Any

from cmpsp_ros.arrays import Array
from cmpsp_ros.mpsp.jit.compiled import allocation_free, inner
from cmpsp_ros.mpsp.jit.intrinsics import room_for
from cmpsp_ros.mpsp.qp.riccati.program import Program

_SMALLEST_PIVOT = 1e-14
# Cost of a stage relative to one of `sweeps.recover_step`.
_FACTORISE = 4


@allocation_free
def factorise(p: Program) -> bool:
    """Sweep backward over all stages; false where the condensed Hessian is not positive definite.

    The Hessian of a stage is split as ``C D C'`` with ones on the diagonal of ``C``: the next stage
    need not wait for roots.
    """
    head, first = p.head[0], p.stages[0]
    n, r = first.B.shape
    N, has_fixed = head.horizon, head.fixed > 0
    head.work += _FACTORISE * (N + 1)
    head.is_factorised = head.has_covariance = 0
    # Hessian and gradient of the cost to go, and their products with the dynamics.
    P, PA, PB = room_for(first.A), room_for(first.A), room_for(first.B)
    costate, gradient = room_for(first.L_X), room_for(first.L_X)
    # Of the controls: Hessian, coupling with the states, gradient, and 1 / D.
    S, G = room_for(first.L_UU), room_for(first.L_UX)
    h, inverse = room_for(first.L_U), room_for(first.L_U)
    for k in range(N, -1, -1):
        stage = p.stages[k]
        A, B, K, L_inv = stage.A, stage.B, stage.K, stage.L_inv
        for a in range(r):
            h[a] = stage.L_U[a]
            for j in range(n):
                G[a, j] = stage.L_UX[a, j]
            for b in range(a + 1):
                S[a, b] = stage.L_UU[a, b]
        if k < N:
            for i in range(n):
                for j in range(n):
                    PA[i, j] = P[i, 0] * A[0, j]
                    for q in range(1, n):
                        PA[i, j] += P[i, q] * A[q, j]
                for a in range(r):
                    PB[i, a] = P[i, 0] * B[0, a]
                    for q in range(1, n):
                        PB[i, a] += P[i, q] * B[q, a]
            if has_fixed:
                _add_drift(stage, P, costate)
            for a in range(r):
                for i in range(n):
                    h[a] += B[i, a] * costate[i]
                    for j in range(n):
                        G[a, j] += B[i, a] * PA[i, j]
                    for b in range(a + 1):
                        S[a, b] += B[i, a] * PB[i, b]
        if has_fixed:
            _take_out_fixed(stage, S, G, h)
        for a in range(r):
            whole = S[a, a]
            for b in range(a):
                for q in range(b):
                    S[a, b] -= S[a, q] * S[b, q]
            for b in range(a):
                scaled = S[a, b] * inverse[b]
                S[a, a] -= S[a, b] * scaled
                S[a, b] = scaled
            if not S[a, a] > _SMALLEST_PIVOT * whole:
                return False
            inverse[a] = 1.0 / S[a, a]
            for b in range(a):
                h[a] -= S[a, b] * h[b]
                for j in range(n):
                    G[a, j] -= S[a, b] * G[b, j]
        if k > 0:
            for i in range(n):
                gradient[i] = stage.L_X[i]
                for j in range(i + 1):
                    P[i, j] = stage.L_XX[i, j]
            if k < N:
                for i in range(n):
                    for q in range(n):
                        gradient[i] += A[q, i] * costate[q]
                        for j in range(i + 1):
                            P[i, j] += A[q, i] * PA[q, j]
            for i in range(n):
                if has_fixed:
                    for a in range(r):
                        gradient[i] += stage.L_UX[a, i] * fixed_control(stage, a)
                for a in range(r):
                    scaled = G[a, i] * inverse[a]
                    gradient[i] -= scaled * h[a]
                    for j in range(i + 1):
                        P[i, j] -= scaled * G[a, j]
                for j in range(i):
                    P[j, i] = P[i, j]
            for i in range(n):
                costate[i] = gradient[i]
        for a in range(r - 1, -1, -1):
            root = math.sqrt(inverse[a])
            stage.optimum[a] = -root * h[a]
            for j in range(n):
                total = inverse[a] * G[a, j]
                for b in range(a + 1, r):
                    total -= S[b, a] * K[b, j]
                K[a, j] = total
        for a in range(r):
            root = math.sqrt(inverse[a])
            for b in range(a):
                total = -S[a, b]
                for q in range(b + 1, a):
                    total -= S[a, q] * L_inv[q, b]
                L_inv[a, b] = total
            L_inv[a, a] = 1.0
        for a in range(r):
            root = 0.0 if stage.fixed[a] != 0.0 else math.sqrt(inverse[a])
            for b in range(a + 1):
                L_inv[a, b] *= root
        if k < N:
            _close_loop(stage)
    head.is_factorised = 1
    return True


@inner
def _close_loop(stage: Any) -> None:
    """``A_cl = A - B K`` and ``B_cl = B L^-T``."""
    n, r = stage.B.shape
    B, K, L_inv, A_cl, B_cl = stage.B, stage.K, stage.L_inv, stage.A_cl, stage.B_cl
    for i in range(n):
        for j in range(n):
            total = stage.A[i, j]
            for a in range(r):
                total -= B[i, a] * K[a, j]
            A_cl[i, j] = total
        for a in range(r):
            total = 0.0
            for b in range(a + 1):
                total += B[i, b] * L_inv[a, b]
            B_cl[i, a] = total


@allocation_free
def fixed_control(stage: Any, a: int) -> float:
    """Deviation of a control that is held at a bound, else 0."""
    if stage.fixed[a] == 0.0:
        return 0.0
    return stage.upper[a] if stage.fixed[a] > 0.0 else stage.lower[a]


@inner
def _add_drift(stage: Any, P: Array, costate: Array) -> None:
    """Effect of the fixed controls on the next state and on the gradient of the cost to go."""
    n, r = stage.B.shape
    for i in range(n):
        total = 0.0
        for a in range(r):
            total += stage.B[i, a] * fixed_control(stage, a)
        stage.drift[i] = total
    for i in range(n):
        for j in range(n):
            costate[i] += P[i, j] * stage.drift[j]


@inner
def _take_out_fixed(stage: Any, S: Array, G: Array, h: Array) -> None:
    """Decouple the fixed controls from all else, with a pivot of 1."""
    n, r = stage.B.shape
    for a in range(r):
        for b in range(r):
            h[a] += stage.L_UU[a, b] * fixed_control(stage, b)
    for a in range(r):
        if stage.fixed[a] != 0.0:
            h[a] = 0.0
            for j in range(n):
                G[a, j] = 0.0
            for b in range(a):
                S[a, b] = 0.0
            for b in range(a + 1, r):
                S[b, a] = 0.0
            S[a, a] = 1.0
