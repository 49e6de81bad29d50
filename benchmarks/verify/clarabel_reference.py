"""Answers by the interior-point solver Clarabel, unchecked, and the least violation of the rows.

The matrices are those of the back end `clarabel`: to verify that one, daqp is the reference.
"""

from __future__ import annotations

import numpy as np

from benchmarks.verify.case import Program
from cmpsp_ros.mpsp.qp import QPSolution, QPStatus
from cmpsp_ros.mpsp.qp.dense.clarabel_backend import cone_program, row_multipliers, row_weights, run
from cmpsp_ros.mpsp.qp.dense.sparse_rows import cost_of, multipliers_of, rows_of

_ENDED_AT_A_POINT = ('Solved', 'AlmostSolved', 'InsufficientProgress')


def solve(program: Program) -> QPSolution:
    """Solve, with slack variables for relaxed rows.

    The point is what Clarabel came to, also where it fell short of its tolerances: how good it is
    must be measured.
    """
    qp = program.subproblem.stages
    rows = rows_of(qp)
    cones = cone_program(qp, rows, row_weights(rows, program.penalties))
    answer = run(cones, *cost_of(qp))
    status = str(answer.status)
    multipliers, dU = np.zeros(len(rows.lower)), np.zeros_like(qp.lower)
    if status in _ENDED_AT_A_POINT:
        dU = np.array(answer.x[: dU.size]).reshape(dU.shape)
        multipliers = row_multipliers(cones, np.array(answer.z))
    return QPSolution(
        _verdict(status), dU, *multipliers_of(qp, rows, multipliers), answer.iterations
    )


def least_violation(program: Program) -> float:
    """Least sum of violations of the rows that are hard, whatever that costs.

    Zero to rounding where the program has a solution; ``inf`` where Clarabel cannot tell.
    """
    qp = program.subproblem.stages
    rows = rows_of(qp)
    hard = row_weights(rows, program.penalties) == np.inf
    cones = cone_program(qp, rows, hard.astype(float))
    size = cones.A.shape[1] - len(cones.price)
    answer = run(cones, [], np.zeros(size))
    if str(answer.status) not in _ENDED_AT_A_POINT:
        return np.inf
    return float(cones.price @ answer.x[size:])


def _verdict(status: str) -> QPStatus:
    if status in _ENDED_AT_A_POINT:
        return QPStatus.SOLVED
    infeasible = status in {'PrimalInfeasible', 'AlmostPrimalInfeasible'}
    return QPStatus.INFEASIBLE if infeasible else QPStatus.FAILED
