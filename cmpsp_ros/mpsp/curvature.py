"""Loss of curvature: what to do about a Hessian that is not positive definite."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from cmpsp_ros.mpsp.closed_form import has_closed_form
from cmpsp_ros.mpsp.condensing import CondensedQP
from cmpsp_ros.mpsp.definiteness import (
    is_positive_definite,
    is_positive_definite_along,
    nearest_positive_semidefinite,
)
from cmpsp_ros.mpsp.problem import Array

CURVATURE_LEFT = 1e-3
"""Least eigenvalue of a shifted Hessian, relative to the largest in magnitude before.

Any positive number would make the program solvable. But a step is as long as the gradient over
the curvature: this keeps it within a thousand times the natural length, which bounds, trust
region and line search can deal with.
"""


def convexify(qp: CondensedQP) -> tuple[CondensedQP, float]:
    """Shift the Hessian of a program that has no unique minimum, and only of such a program.

    A Cholesky factorisation tells. Where it fails, ``shift I`` is added, with the least shift
    that leaves every eigenvalue at `CURVATURE_LEFT` of the largest or above. A program with a
    closed form needs curvature along the terminal constraint alone and keeps its Hessian if it has
    that much.

    The shift is a proximal term, like ``R`` of (95): it vanishes at a fixed point, so it bends the
    path to a solution but not the solution.

    Args:
        qp: Program with any symmetric Hessian; one that is not finite is left to the back end,
            which refuses it.

    Returns:
        The program to solve, the same object where nothing was needed, and the shift, 0 there.
    """
    if is_positive_definite(qp.H) or not np.isfinite(qp.H).all():
        return qp, 0.0
    if has_closed_form(qp) and is_positive_definite_along(qp.H, qp.S_N):
        return qp, 0.0
    values = np.linalg.eigvalsh(qp.H)
    size = np.abs(values).max() or 1.0
    shift = float(CURVATURE_LEFT * size - values[0])
    return replace(qp, H=qp.H + shift * np.eye(len(qp.H))), shift


def project_stages(L_XX: Array, L_UX: Array, L_UU: Array) -> tuple[Array, Array, Array]:
    """Positive semi-definite part of each stage's Hessian in ``(X_k, U_k)``, (49)-(52).

    Then (45) is positive semi-definite as well. The projection is the nearest matrix of that kind
    in the Frobenius norm.

    Args:
        L_XX: Shape ``(N + 1, n, n)``.
        L_UX: Shape ``(N + 1, r, n)``.
        L_UU: Shape ``(N + 1, r, r)``.

    Returns:
        The three blocks, shaped alike.
    """
    n = L_XX.shape[1]
    joint = np.block([[L_XX, np.swapaxes(L_UX, 1, 2)], [L_UX, L_UU]])
    joint = nearest_positive_semidefinite(joint)
    return joint[:, :n, :n].copy(), joint[:, n:, :n].copy(), joint[:, n:, n:].copy()
