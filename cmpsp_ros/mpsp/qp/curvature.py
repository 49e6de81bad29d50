"""Loss of curvature: what to do about a Hessian that is not positive definite."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from cmpsp_ros.mpsp.problem import Array
from cmpsp_ros.mpsp.qp.definiteness import (
    CURVATURE_MARGIN,
    is_positive_definite_along,
    nearest_positive_semidefinite,
)
from cmpsp_ros.mpsp.qp.dense.closed_form import has_closed_form
from cmpsp_ros.mpsp.qp.riccati.fill import is_positive_definite
from cmpsp_ros.mpsp.qp.spectrum import (
    extreme_eigenvalues,
    largest_diagonal,
)
from cmpsp_ros.mpsp.qp.subproblem import Subproblem

CURVATURE_LEFT = 1e-3
"""Least eigenvalue of a shifted Hessian, relative to the largest in magnitude before.

Any positive number would make the program solvable. But a step is as long as the gradient over
the curvature: this keeps it within a thousand times the natural length, which bounds, trust
region and line search can deal with.
"""


def convexify(subproblem: Subproblem) -> Subproblem:
    """Shift the Hessian of a program that has no unique minimum, and only of such a program.

    A Riccati sweep tells. Where it fails, ``shift I`` is added, with the least shift that leaves
    every eigenvalue at `CURVATURE_LEFT` of the largest or above. A program with a closed form needs
    curvature along the terminal constraint alone and keeps its Hessian if it has that much.

    The shift is a proximal term, like ``R`` of (95): it vanishes at a fixed point, so it bends the
    path to a solution but not the solution.

    Args:
        subproblem: Program with any symmetric Hessian; one that is not finite is left to the back
            end, which refuses it.

    Returns:
        The program to solve with its `Subproblem.shift`; the same object where none was needed.
    """
    stages = subproblem.stages
    margin = CURVATURE_MARGIN * largest_diagonal(stages)
    if is_positive_definite(stages, -margin):
        return subproblem
    least, largest = extreme_eigenvalues(stages)
    size = max(abs(least), abs(largest)) or 1.0
    shift = CURVATURE_LEFT * size - least
    if not np.isfinite(shift) or _has_curvature_enough(subproblem):
        return subproblem
    return replace(subproblem, shift=subproblem.shift + shift)


def _has_curvature_enough(subproblem: Subproblem) -> bool:
    if not has_closed_form(subproblem):
        return False
    return is_positive_definite_along(subproblem.condensed.H, subproblem.condensed.S_N)


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
