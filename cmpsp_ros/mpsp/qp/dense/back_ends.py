"""Solvers of the condensed program: daqp, and every solver that the qpsolvers package knows."""

import warnings
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from cmpsp_ros.arrays import Array
from cmpsp_ros.mpsp.qp.active_set.records import kkt_residual
from cmpsp_ros.mpsp.qp.dense.condensing import CondensedQP
from cmpsp_ros.mpsp.qp.dense.rows import Rows
from cmpsp_ros.mpsp.qp.subproblem import TOLERANCE, Penalties, QPSolution, QPStatus, Subproblem

_EQUALITY, _SOFT, _INFEASIBLE = 5, 8, -1
_UNBOUNDED = 1e30
# daqp adds slack^2 / (2 rho) to the linear penalty, which is negligible for both. Large
# ones lose the pull between contradicting rows to rounding; the next one is then tried.
_RECIPROCAL_QUADRATIC_WEIGHTS = (1e7, 1e5)
# Solvers of qpsolvers that factor the Hessian want it positive definite, slack variables included.
_SLACK_CURVATURE = 1e-6


def solve_by_daqp(
    subproblem: Subproblem, penalties: Penalties | None, primal_tol: float = 1e-6
) -> QPSolution:
    """Condense and solve with daqp; relaxed rows are its native soft constraints.

    `primal_tol` is its tolerance of constraints.
    """
    rows = Rows.of(subproblem, penalties)
    if penalties is None:
        return _run_daqp(subproblem, rows, 0.0, primal_tol)
    solution = QPSolution.unsolved(subproblem.size, QPStatus.FAILED)
    for rho in _RECIPROCAL_QUADRATIC_WEIGHTS:
        solution = _run_daqp(subproblem, rows, rho, primal_tol)
        if solution.status is not QPStatus.SOLVED:
            continue
        if kkt_residual(subproblem, solution, penalties) <= TOLERANCE:
            break
    return solution


def _run_daqp(subproblem: Subproblem, rows: Rows, rho: float, primal_tol: float) -> QPSolution:
    import daqp  # noqa: PLC0415 (few runs need it)

    # daqp has the bounds first, whose rows are left out.
    qp, m, q = subproblem.condensed, subproblem.size.output, subproblem.lower.size
    matrix, order = qp.rows, np.roll(np.arange(len(rows.upper)), q)
    is_soft = np.isfinite(rows.weight)[order]
    sense = np.zeros(len(order), dtype=np.int32)
    sense[q : q + m] = _EQUALITY
    sense[is_soft] = _SOFT
    model: Any = daqp.Model()
    model.settings = {'primal_tol': primal_tol}
    upper, lower = (
        np.clip(each[order], -_UNBOUNDED, _UNBOUNDED) for each in (rows.upper, rows.lower)
    )
    flag, _ = model.setup(qp.H, qp.c, matrix, upper, lower, sense)
    if flag >= 0 and is_soft.any():
        weights = np.where(is_soft, rows.weight[order], 0.0)
        reciprocal = np.full(len(weights), rho)
        model.soft_weights(rho_l=reciprocal, rho_u=reciprocal, w_l=weights, w_u=weights)
    dU, _, flag, info = model.solve() if flag >= 0 else (qp.c, 0.0, flag, {})
    if flag <= 0:
        status = QPStatus.INFEASIBLE if flag == _INFEASIBLE else QPStatus.FAILED
        return QPSolution.unsolved(subproblem.size, status)
    multipliers = np.empty(len(order))
    multipliers[order] = info['lam']
    # daqp leaves out rows that no control moves: a violated one has its full penalty.
    path = slice(m, m + len(qp.g))
    fixed = ~qp.B_C.any(axis=1) & np.isfinite(rows.weight[path])
    charge = np.where(rows.upper[path] < 0.0, rows.weight[path], 0.0)
    multipliers[path] = np.where(fixed, charge, multipliers[path])
    return rows.solution(subproblem, dU, multipliers, info['iterations'])


def solve_by_qpsolvers(
    solver: str, subproblem: Subproblem, penalties: Penalties | None
) -> QPSolution:
    """Condense, and solve with one solver of the qpsolvers package, by its name.

    Where penalties are given, the relaxed rows have slack variables.
    """
    import qpsolvers  # noqa: PLC0415 (slow to import)
    from scipy import sparse  # noqa: PLC0415 (as above)

    qp, rows = subproblem.condensed, Rows.of(subproblem, penalties)
    q, m, p, t = len(qp.c), len(qp.output_error), len(qp.g), len(qp.radius)
    if penalties is not None:
        qp = _with_slacks(qp, rows.weight[: m + p])
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
    return rows.solution(subproblem, np.array(answer.x, dtype=float)[:q], multipliers)


def _with_slacks(qp: CondensedQP, weight: Array) -> CondensedQP:
    """The L1 relaxation written out, with slacks ``(miss above, miss below, path)``."""
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
