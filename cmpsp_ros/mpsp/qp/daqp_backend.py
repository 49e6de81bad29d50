"""The dual active-set solver daqp, through its own interface."""

from __future__ import annotations

import daqp
import numpy as np

from cmpsp_ros.mpsp.condensing import CondensedQP
from cmpsp_ros.mpsp.qp.solution import Penalties, QPSolution, QPStatus

_EQUALITY = 5
_SOFT = 8
_INFEASIBLE = -1
_UNBOUNDED = 1e30
# daqp adds slack^2 / (2 rho) to the linear penalty. The L1 relaxation is exact for any rho that
# makes this negligible, but from about 1e15 on daqp loses the pull between contradicting rows.
_RECIPROCAL_QUADRATIC_WEIGHT = 1e9


def solve(qp: CondensedQP, penalties: Penalties | None) -> QPSolution:
    """Solve a condensed program with daqp; relaxed rows are its native soft constraints."""
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
        rho = np.full(len(weights), _RECIPROCAL_QUADRATIC_WEIGHT)
        model.soft_weights(rho_l=rho, rho_u=rho, w_l=weights, w_u=weights)
    dU, _, flag, info = model.solve()
    if flag <= 0:
        return QPSolution.unsolved(qp, _failure(flag))
    bounds, terminal, path, trust = np.split(info['lam'], [q, q + m, q + m + p])
    return QPSolution(QPStatus.SOLVED, dU, terminal, path, trust, bounds, info['iterations'])


def _failure(flag: int) -> QPStatus:
    return QPStatus.INFEASIBLE if flag == _INFEASIBLE else QPStatus.FAILED
