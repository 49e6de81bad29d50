"""Whether a symmetric matrix curves upward, everywhere or along a constraint."""

from __future__ import annotations

import numpy as np

from cmpsp_ros.mpsp.problem import Array

CURVATURE_MARGIN = 1e-10
"""Least eigenvalue that counts as positive, relative to the largest entry of the diagonal."""


def is_positive_definite(H: Array) -> bool:
    """Whether every eigenvalue of ``H`` exceeds the margin; one Cholesky factorisation.

    Args:
        H: Symmetric, shape ``(q, q)``; not definite where it is not finite.
    """
    if H.size == 0:
        return True
    if not np.isfinite(H).all():
        return False
    margin = CURVATURE_MARGIN * np.abs(np.diagonal(H)).max()
    try:
        np.linalg.cholesky(H - margin * np.eye(len(H)))
    except np.linalg.LinAlgError:
        return False
    return True


def is_positive_definite_along(H: Array, S: Array) -> bool:
    """Whether ``dU' H dU > 0`` for every ``dU`` other than 0 with ``S dU = 0``.

    Condition (iii)(c) of Theorem 2 with the Hessian of a quadratic program in the Lagrangian's
    place, and all that makes the stationary point (35) a minimum.

    Args:
        H: Symmetric, shape ``(q, q)``.
        S: Rows of the constraint, shape ``(m, q)``, dependent or not.
    """
    if not (np.isfinite(H).all() and np.isfinite(S).all()):
        return False
    _, values, rows = np.linalg.svd(S, full_matrices=True)
    rank = int(np.count_nonzero(values > CURVATURE_MARGIN * values.max(initial=0.0)))
    Z = rows[rank:]
    return is_positive_definite(Z @ H @ Z.T)


def nearest_positive_semidefinite(blocks: Array) -> Array:
    """Each symmetric block with its negative eigenvalues set to 0, shape ``(..., d, d)``.

    Blocks are left as they are where any of them is not finite.
    """
    if not np.isfinite(blocks).all():
        return blocks
    values, vectors = np.linalg.eigh(blocks)
    raised = (vectors * np.maximum(values, 0.0)[..., None, :]) @ np.swapaxes(vectors, -1, -2)
    # What is positive semi-definite already keeps its bits.
    return np.where((values[..., :1] < 0.0)[..., None], raised, blocks)
