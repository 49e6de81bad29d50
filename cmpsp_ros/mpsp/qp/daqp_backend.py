"""The dual active-set solver daqp, through its own interface."""

from __future__ import annotations

from dataclasses import replace

import daqp
import numpy as np

from cmpsp_ros.mpsp.condensing import CondensedQP
from cmpsp_ros.mpsp.qp.solution import (
    TOLERANCE,
    Penalties,
    QPSolution,
    QPStatus,
    kkt_residual,
)

_EQUALITY = 5
_SOFT = 8
_INFEASIBLE = -1
_UNBOUNDED = 1e30
# daqp adds slack^2 / (2 rho) to the linear penalty, which is negligible for any of these. Large
# ones lose the pull between contradicting rows to rounding; the next one is then tried.
_RECIPROCAL_QUADRATIC_WEIGHTS = (1e7, 1e5)


def solve(qp: CondensedQP, penalties: Penalties | None) -> QPSolution:
    """Solve a condensed program with daqp; relaxed rows are its native soft constraints."""
    if penalties is None:
        return _solve(qp, None, 0.0)
    solution = QPSolution.unsolved(qp, QPStatus.FAILED)
    for rho in _RECIPROCAL_QUADRATIC_WEIGHTS:
        solution = _charge_for_fixed_rows(qp, _solve(qp, penalties, rho), penalties)
        if solution.status is not QPStatus.SOLVED:
            continue
        if kkt_residual(qp, solution, penalties) <= TOLERANCE:
            break
    return solution


def _solve(qp: CondensedQP, penalties: Penalties | None, rho: float) -> QPSolution:
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
        return QPSolution.unsolved(qp, _failure(flag))
    if penalties is not None:
        weights = np.concatenate([np.zeros(q), penalties.terminal, penalties.path, np.zeros(t)])
        reciprocal = np.full(len(weights), rho)
        model.soft_weights(rho_l=reciprocal, rho_u=reciprocal, w_l=weights, w_u=weights)
    dU, _, flag, info = model.solve()
    if flag <= 0:
        return QPSolution.unsolved(qp, _failure(flag))
    bounds, terminal, path, trust = np.split(info['lam'], [q, q + m, q + m + p])
    return QPSolution(QPStatus.SOLVED, dU, terminal, path, trust, bounds, info['iterations'])


def _charge_for_fixed_rows(
    qp: CondensedQP, solution: QPSolution, penalties: Penalties
) -> QPSolution:
    """Give a violated row that no control moves its full penalty; daqp leaves such rows out."""
    fixed = ~qp.B_C.any(axis=1)
    if solution.status is not QPStatus.SOLVED or not fixed.any():
        return solution
    charge = np.where(qp.g < 0.0, penalties.path, 0.0)
    return replace(solution, path=np.where(fixed, charge, solution.path))


def _failure(flag: int) -> QPStatus:
    return QPStatus.INFEASIBLE if flag == _INFEASIBLE else QPStatus.FAILED
