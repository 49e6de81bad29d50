"""Every solver that the qpsolvers package knows, by its name there."""

from __future__ import annotations

import warnings
from dataclasses import replace

import numpy as np
import qpsolvers
from numpy.typing import ArrayLike
from scipy import sparse

from cmpsp_ros.arrays import Array
from cmpsp_ros.mpsp.qp.dense.condensing import CondensedQP
from cmpsp_ros.mpsp.qp.dense.dense import dense_rows, dense_solution
from cmpsp_ros.mpsp.qp.solution import Penalties, QPSolution, QPStatus
from cmpsp_ros.mpsp.qp.subproblem import Subproblem

# Solvers that factor the Hessian want it positive definite, slack variables included.
_SLACK_CURVATURE = 1e-6


def solve(solver: str, subproblem: Subproblem, penalties: Penalties | None) -> QPSolution:
    """Condense, and solve with one solver of the qpsolvers package, by its name.

    Where penalties are given, the relaxed rows have slack variables.
    """
    qp = subproblem.condensed
    q, m, p, t = len(qp.c), len(qp.output_error), len(qp.g), len(qp.radius)
    if penalties is not None:
        qp = _with_slacks(qp, dense_rows(qp, penalties).weight[: m + p])
    problem = qpsolvers.Problem(
        qp.H,
        qp.c,
        np.concatenate([qp.B_C, qp.T, -qp.T]),
        np.concatenate([qp.g, qp.radius, qp.radius]),
        qp.S_N if m else None,
        -qp.output_error if m else None,
        qp.lower,
        qp.upper,
    )
    if solver in qpsolvers.sparse_solvers:
        for name in ('P', 'G', 'A'):
            matrix = getattr(problem, name)
            setattr(problem, name, None if matrix is None else sparse.csc_matrix(matrix))
    with warnings.catch_warnings():
        # Some solvers warn of every program without a solution; that is an answer here.
        warnings.simplefilter('ignore')
        answer = qpsolvers.solve_problem(problem, solver=solver)
    if not answer.found or answer.x is None:
        says = str(answer.extras.get('status', '')).lower()
        infeasible = 'infeasible' in says and 'dual' not in says
        status = QPStatus.INFEASIBLE if infeasible else QPStatus.FAILED
        return QPSolution.unsolved(subproblem.size, status)
    path, above, below = np.split(_or_zeros(answer.z, p + 2 * t), [p, p + t])
    bounds = _or_zeros(answer.z_box, len(qp.c))[:q]
    multipliers = np.concatenate([_or_zeros(answer.y, m), path, above - below, bounds])
    return dense_solution(subproblem, np.array(answer.x, dtype=float)[:q], multipliers)


def _with_slacks(qp: CondensedQP, weight: Array) -> CondensedQP:
    """The L1 relaxation written out, with slacks ``(miss above, miss below, path)``.

    Args:
        qp: The program.
        weight: Penalties of terminal and path rows, shape ``(m + p,)``.
    """
    m, p, q = len(qp.output_error), len(qp.g), len(qp.c)
    slacks = 2 * m + p
    H = np.zeros((q + slacks, q + slacks))
    H[:q, :q] = qp.H
    H[range(q, q + slacks), range(q, q + slacks)] = _SLACK_CURVATURE
    return replace(
        qp,
        H=H,
        c=np.concatenate([qp.c, weight[:m], weight]),
        S_N=np.hstack([qp.S_N, -np.eye(m), np.eye(m), np.zeros((m, p))]),
        B_C=np.hstack([qp.B_C, np.zeros((p, 2 * m)), -np.eye(p)]),
        T=np.hstack([qp.T, np.zeros((len(qp.T), slacks))]),
        lower=np.concatenate([qp.lower, np.zeros(slacks)]),
        upper=np.concatenate([qp.upper, np.full(slacks, np.inf)]),
    )


def _or_zeros(multipliers: ArrayLike | None, length: int) -> Array:
    found = np.zeros(0) if multipliers is None else np.array(multipliers, dtype=float)
    return found if found.shape == (length,) else np.zeros(length)
