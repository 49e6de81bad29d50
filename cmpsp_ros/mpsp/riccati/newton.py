"""The Newton step of the interior point: an unconstrained program along the stages.

Each row adds its weight times its square to the cost (see `barrier`). What remains is one
factorisation, as for any program without rows, and one sweep forward.
"""

from __future__ import annotations

from typing import Any

from cmpsp_ros.mpsp.jit.compiled import allocation_free
from cmpsp_ros.mpsp.problem import Array
from cmpsp_ros.mpsp.riccati.barrier import OFF, Barrier, follow
from cmpsp_ros.mpsp.riccati.rows import load_row, value_of
from cmpsp_ros.mpsp.riccati.size import dimension
from cmpsp_ros.mpsp.riccati.stage_qp import StageQP
from cmpsp_ros.mpsp.riccati.whitening import Whitening, factorise, unwhiten


@allocation_free
def take_curvature(qp: StageQP, model: StageQP, white: Whitening, b: Barrier) -> bool:
    """Write the second derivatives of the cost with weighted rows, and factorise them.

    Args:
        qp: The program.
        model: The same with a cost of its own, of which the lower triangles are filled.
        white: Filled with its factorisation.
        b: The rows, with their weights.

    Returns:
        Whether the cost with its rows is positive definite, to rounding.
    """
    n, r = dimension(qp.state), dimension(qp.control)
    for k in range(qp.g.shape[0]):
        for i in range(n):
            for j in range(i + 1):
                model.L_XX[k, i, j] = qp.L_XX[k, i, j]
        for a in range(r):
            for j in range(n):
                model.L_UX[k, a, j] = qp.L_UX[k, a, j]
            for c in range(a + 1):
                model.L_UU[k, a, c] = qp.L_UU[k, a, c]
    s, d = white.s, white.d
    for row in range(b.kind.shape[0]):
        if b.kind[row] == OFF:
            continue
        k = load_row(qp, white, row)
        for i in range(n):
            if s[i] != 0.0:
                for j in range(i + 1):
                    model.L_XX[k, i, j] += b.weight[row] * s[i] * s[j]
        for a in range(r):
            if d[a] != 0.0:
                for j in range(n):
                    model.L_UX[k, a, j] += b.weight[row] * d[a] * s[j]
                for c in range(a + 1):
                    model.L_UU[k, a, c] += b.weight[row] * d[a] * d[c]
    return factorise(model, white)


@allocation_free
def take_slope(
    qp: StageQP, model: StageQP, white: Whitening, b: Barrier, dU: Array, dX: Array
) -> None:
    """Write the gradient at a point, of the cost with the rows' multipliers after the step."""
    n, r = dimension(qp.state), dimension(qp.control)
    for k in range(dU.shape[0]):
        for a in range(r):
            total = qp.L_U[k, a]
            for c in range(r):
                total += qp.L_UU[k, a, c] * dU[k, c]
            for i in range(n):
                total += qp.L_UX[k, a, i] * dX[k, i]
            model.L_U[k, a] = total
        for i in range(n):
            total = qp.L_X[k, i]
            for j in range(n):
                total += qp.L_XX[k, i, j] * dX[k, j]
            for a in range(r):
                total += qp.L_UX[k, a, i] * dU[k, a]
            model.L_X[k, i] = total
    for row in range(b.kind.shape[0]):
        if b.kind[row] != OFF:
            force = b.multiplier[row] - b.offset[row] + b.weight[row] * b.miss[row]
            add_force(model, white, load_row(qp, white, row), force)


@allocation_free
def add_force(model: StageQP, white: Whitening, k: int, force: float) -> None:
    """Add a multiple of the row that `load_row` has loaded to the gradient at its stage."""
    for i in range(dimension(model.state)):
        model.L_X[k, i] += force * white.s[i]
    for a in range(dimension(model.control)):
        model.L_U[k, a] += force * white.d[a]


@allocation_free
def take_step(
    qp: StageQP, model: StageQP, white: Whitening, b: Barrier, step_U: Array, step_X: Array
) -> Any:
    """The step to the model's minimum; returns what `follow` does."""
    _find_optimum(model, white)
    unwhiten(model, white, white.optimum, step_U, step_X)
    for row in range(b.kind.shape[0]):
        if b.kind[row] != OFF:
            b.value_step[row] = value_of(qp, row, step_U, step_X)
    return follow(b)


@allocation_free
def _find_optimum(model: StageQP, white: Whitening) -> None:
    """Minimum of a program that is factorised already, with another gradient."""
    n, r = dimension(model.state), dimension(model.control)
    N, p, before, h = model.A.shape[0], white.p, white.s, white.d
    for i in range(n):
        p[i] = 0.0
    for k in range(N, -1, -1):
        for a in range(r):
            h[a] = model.L_U[k, a]
            if k < N:
                for i in range(n):
                    h[a] += model.B[k, i, a] * p[i]
        for a in range(r):
            total = 0.0
            for c in range(a + 1):
                total += white.L_inv[k, a, c] * h[c]
            white.optimum[k * r + a] = -total
        for i in range(n):
            total = model.L_X[k, i]
            if k < N:
                for j in range(n):
                    total += model.A[k, j, i] * p[j]
            for a in range(r):
                total -= white.K[k, a, i] * h[a]
            before[i] = total
        for i in range(n):
            p[i] = before[i]
