"""The closed form (35) of a program without inequalities: one symmetric linear system.

At ``N = 50``, ``n = 3``, ``r = 2`` it takes 0.2 to 0.3 ms, and condensing as much again at most.
A BLAS that starts threads may stall for far longer on a busy machine: where time is short, limit it
to one, as with ``OPENBLAS_NUM_THREADS=1``.
"""

from dataclasses import replace

import numpy as np

from cmpsp_ros.arrays import Array
from cmpsp_ros.mpsp.qp.active_set.records import kkt_residual
from cmpsp_ros.mpsp.qp.subproblem import QPSolution, QPStatus, Subproblem

# Least eigenvalue that counts as positive, relative to the largest entry of the diagonal.
CURVATURE_MARGIN = 1e-10

_TOLERANCE = 1e-8


def has_closed_form(subproblem: Subproblem) -> bool:
    """True for a program of equalities alone: no path rows, trust region or bounds."""
    # Path rows first: most programs have some.
    return not (
        (subproblem.linearisation.g != -np.inf).any()
        or (subproblem.trust_radius != np.inf).any()
        or (subproblem.lower != -np.inf).any()
        or (subproblem.upper != np.inf).any()
    )


def solve_closed_form(subproblem: Subproblem) -> QPSolution:
    """Solve (35), ``[[A_UU, A_Ul], [A_lU, 0]] (dU, lambda) + (b_U, b_l) = 0``.

    For a program that `has_closed_form`; other rows and bounds are ignored. The Hessian need not be
    positive definite as long as it is so along the terminal constraint. Where rows of ``S_N``
    depend on each other and agree, ``lambda`` is the shortest that fits. `QPStatus.INFEASIBLE`
    where they contradict each other, `QPStatus.FAILED` where the cost has no minimum along them or
    the data are not finite.
    """
    qp, failed = subproblem.condensed, QPSolution.unsolved(subproblem.size, QPStatus.FAILED)
    if not (is_positive_definite(qp.H) or is_positive_definite_along(qp.H, qp.S_N)):
        return failed
    m = len(qp.output_error)
    system = np.block([[qp.H, qp.S_N.T], [qp.S_N, np.zeros((m, m))]])
    b = np.concatenate([qp.c, qp.output_error])
    if not (np.isfinite(system).all() and np.isfinite(b).all()):
        return failed
    if not m or np.linalg.matrix_rank(qp.S_N) == m:
        answer = _answer(subproblem, np.linalg.solve(system, -b))
        if _is_right(subproblem, answer):
            return answer
    # Rows of S_N depend on each other, or nearly so.
    answer = _answer(subproblem, np.linalg.lstsq(system, -b, rcond=None)[0])
    if _is_right(subproblem, answer):
        return answer
    return replace(failed, status=QPStatus.INFEASIBLE)


def _answer(subproblem: Subproblem, solution: Array) -> QPSolution:
    """The solution ``(dU, lambda)`` of the system in the shapes of the stages."""
    dU, terminal = np.split(solution, [subproblem.lower.size])
    unsolved = QPSolution.unsolved(subproblem.size, QPStatus.SOLVED)
    return replace(unsolved, dU=dU.reshape(subproblem.lower.shape), terminal=terminal)


def _is_right(subproblem: Subproblem, answer: QPSolution) -> bool:
    return kkt_residual(subproblem, answer, None) <= _TOLERANCE


def is_positive_definite(H: Array) -> bool:
    """True where every eigenvalue of ``H (q, q)`` exceeds the margin; by Cholesky."""
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
    """True where ``dU' H dU > 0`` for every ``dU`` other than 0 with ``S dU = 0``.

    Condition (iii)(c) of Theorem 2 with the Hessian of a quadratic program in the Lagrangian's
    place, and all that makes the stationary point (35) a minimum. Rows of ``S`` may be dependent.
    """
    if not (np.isfinite(H).all() and np.isfinite(S).all()):
        return False
    _, values, rows = np.linalg.svd(S, full_matrices=True)
    rank = int(np.count_nonzero(values > CURVATURE_MARGIN * values.max(initial=0.0)))
    Z = rows[rank:]
    return is_positive_definite(Z @ H @ Z.T)
