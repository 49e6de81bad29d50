"""The dual active-set solver daqp, through its own interface."""

from __future__ import annotations

import daqp
import numpy as np

from cmpsp_ros.arrays import Array
from cmpsp_ros.mpsp.qp.active_set.fill import kkt_residual
from cmpsp_ros.mpsp.qp.dense.dense import DenseRows, dense_rows, dense_solution
from cmpsp_ros.mpsp.qp.solution import TOLERANCE, Penalties, QPSolution, QPStatus
from cmpsp_ros.mpsp.qp.subproblem import Subproblem

_EQUALITY = 5
_SOFT = 8
_INFEASIBLE = -1
_UNBOUNDED = 1e30
# daqp adds slack^2 / (2 rho) to the linear penalty, which is negligible for both. Large
# ones lose the pull between contradicting rows to rounding; the next one is then tried.
_RECIPROCAL_QUADRATIC_WEIGHTS = (1e7, 1e5)


def solve(
    subproblem: Subproblem, penalties: Penalties | None, primal_tol: float = 1e-6
) -> QPSolution:
    """Condense and solve with daqp; relaxed rows are its native soft constraints.

    Args:
        subproblem: The program.
        penalties: Weights of the exact L1 relaxation; None keeps all rows hard.
        primal_tol: daqp's tolerance of constraints.
    """
    rows = dense_rows(subproblem.condensed, penalties)
    if penalties is None:
        return _solve(subproblem, rows, 0.0, primal_tol)
    solution = QPSolution.unsolved(subproblem.size, QPStatus.FAILED)
    for rho in _RECIPROCAL_QUADRATIC_WEIGHTS:
        solution = _solve(subproblem, rows, rho, primal_tol)
        if solution.status is not QPStatus.SOLVED:
            continue
        if kkt_residual(subproblem, solution, penalties) <= TOLERANCE:
            break
    return solution


def _solve(subproblem: Subproblem, rows: DenseRows, rho: float, primal_tol: float) -> QPSolution:
    qp, m, q = subproblem.condensed, subproblem.size.output, subproblem.lower.size
    is_soft = np.isfinite(rows.weight)
    sense = np.zeros(q + len(rows.upper), dtype=np.int32)
    sense[q : q + m] = _EQUALITY
    sense[q:][is_soft] = _SOFT
    model = daqp.Model()
    model.settings = {'primal_tol': primal_tol}
    upper, lower = _limits(qp.upper, rows.upper), _limits(qp.lower, rows.lower)
    flag, _ = model.setup(qp.H, qp.c, rows.matrix, upper, lower, sense)
    if flag >= 0 and is_soft.any():
        weights = np.concatenate([np.zeros(q), np.where(is_soft, rows.weight, 0.0)])
        reciprocal = np.full(len(weights), rho)
        model.soft_weights(rho_l=reciprocal, rho_u=reciprocal, w_l=weights, w_u=weights)
    dU, _, flag, info = model.solve() if flag >= 0 else (qp.c, 0.0, flag, {})
    if flag <= 0:
        status = QPStatus.INFEASIBLE if flag == _INFEASIBLE else QPStatus.FAILED
        return QPSolution.unsolved(subproblem.size, status)
    bounds, multipliers = np.split(info['lam'], [q])
    # daqp leaves out rows that no control moves: a violated one has its full penalty.
    fixed = ~rows.matrix.any(axis=1) & is_soft
    fixed[:m] = False
    charge = np.where(rows.upper < 0.0, rows.weight, 0.0)
    multipliers = np.where(fixed, charge, multipliers)
    multipliers = np.concatenate([multipliers, bounds])
    return dense_solution(subproblem, dU, multipliers, info['iterations'])


def _limits(bounds: Array, rows: Array) -> Array:
    limits: Array = np.clip(np.concatenate([bounds, rows]), -_UNBOUNDED, _UNBOUNDED)
    return limits
