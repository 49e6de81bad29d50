"""What can be said of an answer without any other: its cost, and what it can be off by."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import splu

from benchmarks.verify.case import Program
from cmpsp_ros.arrays import Array
from cmpsp_ros.mpsp.qp import QPSolution, QPStatus, kkt_residual
from cmpsp_ros.mpsp.qp.dense import SparseQP, sparse_qp

_BITS_CHANGED = 5


class Cost(NamedTuple):
    """Objective of a program at a point.

    Attributes:
        value: With the penalties of rows that are violated.
        size: 1 plus the sum of the magnitudes of its terms: what rounding is relative to.
    """

    value: float
    size: float


class Accuracy(NamedTuple):
    """How good an answer is, measured without any other; both ``inf`` where it is no point.

    Attributes:
        residual: Largest violation of the optimality conditions, relative to the data.
        gap: Its `duality_gap`.
    """

    residual: float
    gap: float


def accuracy(program: Program, solution: QPSolution) -> Accuracy:
    """Measure an answer."""
    if solution.status is not QPStatus.SOLVED:
        return Accuracy(math.inf, math.inf)
    residual = kkt_residual(program.subproblem, solution, program.penalties)
    if not math.isfinite(residual):
        return Accuracy(math.inf, math.inf)
    return Accuracy(residual, duality_gap(program, solution))


def last_bit(program: Program, solution: QPSolution) -> float:
    """How much the residual of an answer changes with the last bit of its controls.

    Where unstable dynamics carry rounding along, no answer in doubles has a smaller residual but
    by luck.
    """
    rng = np.random.default_rng(0)
    residual = accuracy(program, solution).residual
    changes = []
    for _ in range(_BITS_CHANGED):
        towards = rng.choice([-np.inf, np.inf], size=solution.dU.shape)
        moved = replace(solution, dU=np.nextafter(solution.dU, towards))
        changes.append(abs(accuracy(program, moved).residual - residual))
    return max(changes)


def cost(program: Program, dU: Array) -> Cost:
    """Objective of a program at control deviations ``dU (N + 1, r)``."""
    qp, dX = program.subproblem.linearisation, program.subproblem.propagate(dU)
    terms = [
        float(np.vdot(qp.L_X, dX)),
        float(np.vdot(qp.L_U, dU)),
        0.5 * float(np.einsum('ki,kij,kj->', dX, qp.L_XX, dX)),
        float(np.einsum('ka,kai,ki->', dU, qp.L_UX, dX)),
        0.5 * float(np.einsum('ka,kab,kb->', dU, qp.L_UU, dU)),
    ]
    if program.penalties is not None:
        miss, path = program.subproblem.terminal(dU, dX), program.subproblem.path(dU, dX)
        terms.append(float(program.penalties.terminal @ np.abs(miss)))
        terms.append(float(np.vdot(program.penalties.path, np.maximum(path, 0.0))))
    return Cost(sum(terms), 1.0 + sum(map(abs, terms)))


def duality_gap(program: Program, solution: QPSolution) -> float:
    """Cost above the bound that an answer's own multipliers prove, relative to its terms.

    No feasible point costs less than the bound, with any multipliers. It is the least
    Lagrangian along the dynamics, found by one sparse factorisation. A gap that is negative shows
    a point that is not feasible.
    """
    qp = sparse_qp(program.subproblem, program.penalties)
    # Beyond the weight a multiplier proves nothing, and without a limit none does.
    smallest = np.where(np.isfinite(qp.rows.lower), -qp.rows.weight, 0.0)
    largest = np.where(np.isfinite(qp.rows.upper), qp.rows.weight, 0.0)
    multipliers = np.clip(qp.rows.multipliers(solution), smallest, largest)
    limit = np.where(multipliers > 0.0, qp.rows.upper, qp.rows.lower)
    active = multipliers != 0.0
    gradient = qp.q + qp.G.T @ multipliers
    bound = 0.5 * float(gradient @ _least(qp, gradient))
    bound -= float(multipliers[active] @ limit[active])
    at = cost(program, solution.dU)
    return (at.value - bound) / at.size


def _least(qp: SparseQP, gradient: Array) -> Array:
    """Where a program's cost, with this gradient at 0, is least along the dynamics."""
    hessian = qp.P + sparse.triu(qp.P, 1).T
    matrix = sparse.block_array([[hessian, qp.D.T], [qp.D, None]], format='csc')
    right = np.concatenate([-gradient, np.zeros(qp.D.shape[0])])
    factor = splu(matrix)
    z = factor.solve(right)
    z += factor.solve(right - matrix @ z)
    result: Array = z[: len(gradient)]
    return result
