"""The dual active-set solver daqp, through its own interface."""

from __future__ import annotations

import daqp
import numpy as np

from cmpsp_ros.mpsp.qp.dense.condensing import CondensedQP
from cmpsp_ros.mpsp.qp.dense.dense import DensePenalties, DenseSolution, gather, scatter
from cmpsp_ros.mpsp.qp.solution import (
    TOLERANCE,
    Penalties,
    QPSolution,
    QPStatus,
    kkt_residual,
)
from cmpsp_ros.mpsp.qp.subproblem import Subproblem

_EQUALITY = 5
_SOFT = 8
_INFEASIBLE = -1
_UNBOUNDED = 1e30
# daqp adds slack^2 / (2 rho) to the linear penalty, which is negligible for any of these. Large
# ones lose the pull between contradicting rows to rounding; the next one is then tried.
_RECIPROCAL_QUADRATIC_WEIGHTS = (1e7, 1e5)


def solve(subproblem: Subproblem, penalties: Penalties | None) -> QPSolution:
    """Condense and solve with daqp; relaxed rows are its native soft constraints."""
    qp = subproblem.condensed
    weights = gather(qp, penalties)
    if weights is None:
        return scatter(subproblem, _solve(qp, None, 0.0))
    solution = QPSolution.unsolved(subproblem.size, QPStatus.FAILED)
    for rho in _RECIPROCAL_QUADRATIC_WEIGHTS:
        dense = _charge_for_fixed_rows(qp, _solve(qp, weights, rho), weights)
        solution = scatter(subproblem, dense)
        if solution.status is not QPStatus.SOLVED:
            continue
        if kkt_residual(subproblem, solution, penalties) <= TOLERANCE:
            break
    return solution


def _solve(qp: CondensedQP, penalties: DensePenalties | None, rho: float) -> DenseSolution:
    m, p, t, q = len(qp.output_error), len(qp.g), len(qp.radius), len(qp.c)
    rows = np.concatenate([qp.S_N, qp.B_C, qp.T])
    upper = np.concatenate([qp.upper, -qp.output_error, qp.g, qp.radius])
    lower = np.concatenate([qp.lower, -qp.output_error, np.full(p, -_UNBOUNDED), -qp.radius])
    sense = np.zeros(q + m + p + t, dtype=np.int32)
    sense[q : q + m] = _EQUALITY
    if penalties is not None:
        sense[q : q + m + p] = _SOFT
    model = daqp.Model()
    flag, _ = model.setup(
        qp.H,
        qp.c,
        rows,
        np.clip(upper, -_UNBOUNDED, _UNBOUNDED),
        np.clip(lower, -_UNBOUNDED, _UNBOUNDED),
        sense,
    )
    if flag < 0:
        return DenseSolution.unsolved(qp, _failure(flag))
    if penalties is not None:
        weights = np.concatenate([np.zeros(q), penalties.terminal, penalties.path, np.zeros(t)])
        reciprocal = np.full(len(weights), rho)
        model.soft_weights(rho_l=reciprocal, rho_u=reciprocal, w_l=weights, w_u=weights)
    dU, _, flag, info = model.solve()
    if flag <= 0:
        return DenseSolution.unsolved(qp, _failure(flag))
    bounds, terminal, path, trust = np.split(info['lam'], [q, q + m, q + m + p])
    return DenseSolution(QPStatus.SOLVED, dU, terminal, path, trust, bounds, info['iterations'])


def _charge_for_fixed_rows(
    qp: CondensedQP, solution: DenseSolution, penalties: DensePenalties
) -> DenseSolution:
    """Give a violated row that no control moves its full penalty; daqp leaves such rows out."""
    fixed = ~qp.B_C.any(axis=1)
    if solution.status is not QPStatus.SOLVED or not fixed.any():
        return solution
    charge = np.where(qp.g < 0.0, penalties.path, 0.0)
    return solution._replace(path=np.where(fixed, charge, solution.path))


def _failure(flag: int) -> QPStatus:
    return QPStatus.INFEASIBLE if flag == _INFEASIBLE else QPStatus.FAILED
