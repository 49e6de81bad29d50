"""The closed form (35) of a program without inequalities: one symmetric linear system.

At ``N = 50``, ``n = 3``, ``r = 2`` it takes 0.2 to 0.3 ms, and condensing as much again at most.
A BLAS that starts threads may stall for far longer on a busy machine: where time is short, tell it
to use one, as with ``OPENBLAS_NUM_THREADS=1``.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from cmpsp_ros.mpsp.problem import Array
from cmpsp_ros.mpsp.qp.definiteness import is_positive_definite, is_positive_definite_along
from cmpsp_ros.mpsp.qp.solution import QPSolution, QPStatus, kkt_residual
from cmpsp_ros.mpsp.qp.subproblem import Subproblem

_TOLERANCE = 1e-8


def has_closed_form(subproblem: Subproblem) -> bool:
    """Whether the program has equalities alone: no path rows, trust region or bounds."""
    # Most programs have path rows, which is told the soonest.
    return not (
        (subproblem.linearisation.g != -np.inf).any()
        or (subproblem.trust_radius != np.inf).any()
        or (subproblem.lower != -np.inf).any()
        or (subproblem.upper != np.inf).any()
    )


def solve_closed_form(subproblem: Subproblem) -> QPSolution:
    """Solve (35), ``[[A_UU, A_Ul], [A_lU, 0]] (dU, lambda) + (b_U, b_l) = 0``.

    The Hessian need not be positive definite as long as it is so along the terminal constraint.
    Where rows of ``S_N`` depend on each other and agree, ``lambda`` is the shortest of those that
    fit.

    Args:
        subproblem: A program that `has_closed_form`; its other rows and bounds are not looked at.

    Returns:
        The solution; `QPStatus.INFEASIBLE` where the terminal rows contradict each other, and
        `QPStatus.FAILED` where the cost has no minimum along them or the data are not finite.
    """
    qp, unsolved = subproblem.condensed, QPSolution.unsolved(subproblem.size, QPStatus.FAILED)
    if not (is_positive_definite(qp.H) or is_positive_definite_along(qp.H, qp.S_N)):
        return unsolved
    q, m = len(qp.c), len(qp.output_error)
    system = np.zeros((q + m, q + m))
    system[:q, :q] = qp.H
    system[:q, q:] = qp.S_N.T
    system[q:, :q] = qp.S_N
    b = np.concatenate([qp.c, qp.output_error])
    if not (np.isfinite(system).all() and np.isfinite(b).all()):
        return unsolved
    answer = unsolved
    if not m or np.linalg.matrix_rank(qp.S_N) == m:
        answer = _answer(subproblem, np.linalg.solve(system, -b))
    if answer.status is QPStatus.FAILED:
        # Rows of S_N depend on each other, or nearly so.
        answer = _answer(subproblem, np.linalg.lstsq(system, -b, rcond=None)[0])
    if answer.status is QPStatus.FAILED:
        return replace(answer, status=QPStatus.INFEASIBLE)
    return answer


def _answer(subproblem: Subproblem, solution: Array) -> QPSolution:
    """The solution ``(dU, lambda)`` of the system, or FAILED where it is not one."""
    unsolved = QPSolution.unsolved(subproblem.size, QPStatus.FAILED)
    stacked, terminal = np.split(solution, [unsolved.dU.size])
    dU = stacked.reshape(unsolved.dU.shape)
    answer = replace(unsolved, status=QPStatus.SOLVED, dU=dU, terminal=terminal)
    return answer if kkt_residual(subproblem, answer, None) <= _TOLERANCE else unsolved
