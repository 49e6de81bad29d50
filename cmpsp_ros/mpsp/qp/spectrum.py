"""Curvature of the condensed Hessian (45), told along the stages without forming it."""

from __future__ import annotations

import math

import numpy as np

from cmpsp_ros.mpsp.jit.compiled import compiled
from cmpsp_ros.mpsp.problem import Array
from cmpsp_ros.mpsp.qp.riccati.fill import is_positive_definite
from cmpsp_ros.mpsp.qp.stage_qp import StageQP

_RESOLUTION = 1e-15
# Both ends nearer to 0 than this are 0 themselves.
_NOTHING = 1e-12


def largest_diagonal(stages: StageQP) -> float:
    """Largest magnitude on the diagonal of the condensed Hessian; time linear in the horizon."""
    return _largest_diagonal(stages.A, stages.B, stages.L_XX, stages.L_UU)


def extreme_eigenvalues(stages: StageQP) -> tuple[float, float]:
    """Least and largest eigenvalue of the condensed Hessian.

    Found by bisection, to rounding relative to the largest entry of the diagonal; 100 to 200
    sweeps of `is_positive_definite`.

    Args:
        stages: The program.

    Returns:
        Both 0 where the Hessian is; not finite where it is not.
    """
    blocks = (stages.L_XX, stages.L_UX, stages.L_UU)
    size = largest_diagonal(stages) or max(float(np.abs(block).max()) for block in blocks) or 1.0
    if not math.isfinite(size):
        return math.nan, math.nan
    least, largest = -_least_shift(stages, 1.0, size), _least_shift(stages, -1.0, size)
    if max(abs(least), abs(largest)) <= _NOTHING * size:
        return 0.0, 0.0
    return least, largest


def _least_shift(stages: StageQP, sign: float, size: float) -> float:
    """Least shift from ``-size`` on with which ``sign H`` is positive definite."""
    low, high = -size, size
    while high < np.inf and not is_positive_definite(stages, high, sign):
        low, high = high, 2.0 * high
    resolution = _RESOLUTION * high
    while high - low > resolution:
        middle = 0.5 * (low + high)
        if is_positive_definite(stages, middle, sign):
            high = middle
        else:
            low = middle
    return high


@compiled
def _largest_diagonal(A: Array, B: Array, L_XX: Array, L_UU: Array) -> float:
    """``L_UU + B' P B`` of each stage, with ``P`` the curvature of what follows untouched."""
    steps, n, r = B.shape
    P = L_XX[steps].copy()
    PA = np.empty((n, n))
    largest = 0.0
    for a in range(r):
        largest = max(largest, abs(L_UU[steps, a, a]))
    for k in range(steps - 1, -1, -1):
        for a in range(r):
            total = L_UU[k, a, a]
            for i in range(n):
                for j in range(n):
                    total += B[k, i, a] * P[i, j] * B[k, j, a]
            largest = max(largest, abs(total))
        for i in range(n):
            for j in range(n):
                total = 0.0
                for q in range(n):
                    total += P[i, q] * A[k, q, j]
                PA[i, j] = total
        for i in range(n):
            for j in range(n):
                total = L_XX[k, i, j]
                for q in range(n):
                    total += A[k, q, i] * PA[q, j]
                P[i, j] = total
    return largest
