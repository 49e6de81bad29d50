"""Answers by the dense active-set solver daqp, told to be more exact than by itself."""

from __future__ import annotations

import daqp
import numpy as np

from cmpsp_ros.mpsp.qp import QPSolution, QPStatus
from cmpsp_ros.mpsp.qp.dense.dense import DenseSolution, scatter
from cmpsp_ros.mpsp.qp.subproblem import Subproblem

_TOLERANCE = 1e-9
_EQUALITY = 5
_INFEASIBLE = -1
_UNBOUNDED = 1e30


def solve(subproblem: Subproblem) -> QPSolution:
    """Solve a program with hard rows, its states eliminated."""
    qp = subproblem.condensed
    m, p, q = len(qp.output_error), len(qp.g), len(qp.c)
    rows = np.concatenate([qp.S_N, qp.B_C, qp.T])
    upper = np.concatenate([qp.upper, -qp.output_error, qp.g, qp.radius])
    lower = np.concatenate([qp.lower, -qp.output_error, np.full(p, -_UNBOUNDED), -qp.radius])
    sense = np.zeros(len(upper), dtype=np.int32)
    sense[q : q + m] = _EQUALITY
    dU, _, flag, info = daqp.solve(
        qp.H,
        qp.c,
        rows,
        np.clip(upper, -_UNBOUNDED, _UNBOUNDED),
        np.clip(lower, -_UNBOUNDED, _UNBOUNDED),
        sense,
        primal_tol=_TOLERANCE,
    )
    bounds, terminal, path, trust = np.split(info['lam'], [q, q + m, q + m + p])
    failure = QPStatus.INFEASIBLE if flag == _INFEASIBLE else QPStatus.FAILED
    status = QPStatus.SOLVED if flag > 0 else failure
    dense = DenseSolution(status, dU, terminal, path, trust, bounds, info['iterations'])
    return scatter(subproblem, dense)
