"""Loss of curvature: convexification of a Hessian that is not positive definite."""

import math
from dataclasses import replace

import numpy as np

from cmpsp_ros.arrays import Array
from cmpsp_ros.mpsp.qp.active_set.records import definite_from, is_positive_definite
from cmpsp_ros.mpsp.qp.dense.closed_form import (
    CURVATURE_MARGIN,
    has_closed_form,
    is_positive_definite_along,
)
from cmpsp_ros.mpsp.qp.subproblem import Subproblem

# Least eigenvalue of a shifted Hessian, relative to the largest in magnitude before.
#
# Any positive number would make the program solvable. But a step is as long as the gradient over
# the curvature: this keeps it within a thousand times the natural length, which bounds, trust
# region and line search can deal with.
CURVATURE_LEFT = 1e-3

_RESOLUTION = 1e-15
# Both ends nearer to 0 than this are 0 themselves.
_NOTHING = 1e-12


def convexify(subproblem: Subproblem) -> Subproblem:
    """Shift the Hessian of a program that has no unique minimum, and only of such a program.

    Where a Riccati sweep fails, ``shift I`` is added, with the least shift that leaves every
    eigenvalue at `CURVATURE_LEFT` of the largest or above. A program with a closed form needs
    curvature along the terminal constraint alone and keeps its Hessian if it has that much. One
    that is not finite is left to the back end, which refuses it.

    The shift is a proximal term, like ``R`` of (95): it vanishes at a fixed point, so it bends the
    path to a solution but not the solution. The same object is returned where none was needed.
    """
    diagonal = largest_diagonal(subproblem)
    if is_positive_definite(subproblem, -CURVATURE_MARGIN * diagonal):
        return subproblem
    least, largest = extreme_eigenvalues(subproblem, diagonal)
    size = max(abs(least), abs(largest)) or 1.0
    shift = CURVATURE_LEFT * size - least
    if not np.isfinite(shift):
        return subproblem
    if has_closed_form(subproblem):
        condensed = subproblem.condensed
        if is_positive_definite_along(condensed.H, condensed.S_N):
            return subproblem
    lin = subproblem.linearisation
    shifted = replace(lin, L_UU=lin.L_UU + shift * np.eye(subproblem.size.control))
    return replace(subproblem, linearisation=shifted, shift=subproblem.shift + shift)


def extreme_eigenvalues(
    subproblem: Subproblem, diagonal: float | None = None
) -> tuple[float, float]:
    """Least and largest eigenvalue of the condensed Hessian; both NaN where it is not finite.

    Found by bisection, to rounding relative to the largest entry of the `diagonal`; 100 to 200
    Riccati sweeps.
    """
    diagonal = largest_diagonal(subproblem) if diagonal is None else diagonal
    lin = subproblem.linearisation
    blocks = lin.L_XX, lin.L_UX, lin.L_UU
    size = diagonal or max(float(np.abs(block).max()) for block in blocks) or 1.0
    if not math.isfinite(size):
        return math.nan, math.nan
    least, largest = -_least_shift(subproblem, 1.0, size), _least_shift(subproblem, -1.0, size)
    if max(abs(least), abs(largest)) <= _NOTHING * size:
        return 0.0, 0.0
    return least, largest


def _least_shift(subproblem: Subproblem, sign: float, size: float) -> float:
    """Least shift from ``-size`` on with which ``sign H`` is positive definite."""
    low, high = -size, size
    with definite_from(subproblem, sign) as is_definite:
        while high < np.inf and not is_definite(high):
            low, high = high, 2.0 * high
        resolution = _RESOLUTION * high
        while high - low > resolution:
            middle = 0.5 * (low + high)
            if is_definite(middle):
                high = middle
            else:
                low = middle
    return high


def largest_diagonal(subproblem: Subproblem) -> float:
    """Largest magnitude on the diagonal of the condensed Hessian; time linear in the horizon.

    It is that of ``L_UU + B' P B`` of each stage, with ``P`` the curvature of the cost-to-go.
    """
    lin = subproblem.linearisation
    P, whole = lin.L_XX[-1], lin.L_UU.copy()
    with np.errstate(over='ignore', invalid='ignore'):
        for k in range(len(lin.A) - 1, -1, -1):
            A, B = lin.A[k], lin.B[k]
            whole[k] += B.T.dot(P).dot(B)
            P = lin.L_XX[k] + A.T.dot(P).dot(A)
    return float(np.abs(whole.diagonal(axis1=1, axis2=2)).max())


def project_stages(L_XX: Array, L_UX: Array, L_UU: Array) -> tuple[Array, Array, Array]:
    """Positive semi-definite part of each stage's Hessian in ``(X_k, U_k)``, (49)-(52).

    Then (45) is positive semi-definite as well. The projection is the nearest matrix of that kind
    in the Frobenius norm. Shapes ``(N + 1, n, n)``, ``(N + 1, r, n)`` and ``(N + 1, r, r)``.
    """
    n = L_XX.shape[1]
    joint = np.block([[L_XX, np.swapaxes(L_UX, 1, 2)], [L_UX, L_UU]])
    joint = nearest_positive_semidefinite(joint)
    return joint[:, :n, :n].copy(), joint[:, n:, :n].copy(), joint[:, n:, n:].copy()


def nearest_positive_semidefinite(blocks: Array) -> Array:
    """Each symmetric block with its negative eigenvalues set to 0, shape ``(..., d, d)``.

    Blocks are left as they are where any of them is not finite.
    """
    if not np.isfinite(blocks).all():
        return blocks
    values, vectors = np.linalg.eigh(blocks)
    raised = (vectors * np.maximum(values, 0.0)[..., None, :]) @ np.swapaxes(vectors, -1, -2)
    # A positive semi-definite matrix keeps its bits.
    return np.where((values[..., :1] < 0.0)[..., None], raised, blocks)
