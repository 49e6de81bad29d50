"""Answers by the interior-point solver Clarabel, unchecked, and the least violation of the rows.

The matrices are those of the back end `clarabel`: to verify that one, daqp is the reference.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from benchmarks.verify.case import Program
from cmpsp_ros.mpsp.qp import QPSolution, QPStatus
from cmpsp_ros.mpsp.qp.dense import cone_program, run, sparse_qp

_ENDED_AT_A_POINT = ('Solved', 'AlmostSolved', 'InsufficientProgress')


def solve(program: Program) -> QPSolution:
    """Solve, with slack variables for relaxed rows.

    The point is what Clarabel came to, also where it fell short of its tolerances: how good it is
    must be measured.
    """
    qp = program.subproblem
    matrices = sparse_qp(qp, program.penalties)
    cones = cone_program(matrices, matrices.rows.weight)
    answer = run(cones, matrices.P, matrices.q)
    status = str(answer.status)
    if status not in _ENDED_AT_A_POINT:
        infeasible = status in {'PrimalInfeasible', 'AlmostPrimalInfeasible'}
        failure = QPStatus.INFEASIBLE if infeasible else QPStatus.FAILED
        return replace(QPSolution.unsolved(qp.size, failure), iterations=answer.iterations)
    dU = np.array(answer.x[: qp.lower.size]).reshape(qp.lower.shape)
    multipliers = cones.row_multipliers(np.array(answer.z), len(matrices.rows.upper))
    return matrices.rows.solution(qp, dU, multipliers, answer.iterations)


def least_violation(program: Program) -> float:
    """Least sum of violations of the rows that are hard, at any cost.

    Zero to rounding where the program has a solution; ``inf`` where Clarabel fails.
    """
    matrices = sparse_qp(program.subproblem, program.penalties)
    cones = cone_program(matrices, np.isinf(matrices.rows.weight).astype(float))
    answer = run(cones)
    if str(answer.status) not in _ENDED_AT_A_POINT:
        return np.inf
    return float(cones.price @ answer.x[len(answer.x) - len(cones.price) :])
