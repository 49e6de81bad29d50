"""What can be said of an answer without any other: its cost, and what it can be off by."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse.linalg import splu

from benchmarks.verify.case import Program
from cmpsp_ros.mpsp.qp import QPSolution, QPStatus
from cmpsp_ros.mpsp.qp.dense.sparse_rows import (
    Entries,
    assembled,
    cost_of,
    dynamics_of,
    rows_of,
    values_of,
)
from cmpsp_ros.mpsp.qp.solution import kkt_residual
from cmpsp_ros.mpsp.qp.stage_qp import StageQP

Array = NDArray[np.float64]


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
    qp, dX = program.subproblem.stages, program.subproblem.propagate(dU)
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

    No feasible point costs less than the bound, whatever the multipliers are. It is the least
    Lagrangian along the dynamics, found by one sparse factorisation. A gap that is negative shows
    a point that is not feasible.
    """
    qp = program.subproblem.stages
    rows, price = rows_of(qp), program.penalties
    cap = np.full(len(rows.lower), np.inf)
    if price is not None:
        relaxed = np.concatenate([price.terminal, price.path[rows.path]])
        cap[: len(relaxed)] = relaxed
    # Beyond these a multiplier proves nothing: there is no such limit, or it is for sale.
    least = np.where(np.isfinite(rows.lower), -cap, 0.0)
    most = np.where(np.isfinite(rows.upper), cap, 0.0)
    multipliers = np.clip(values_of(rows, solution), least, most)
    limit = np.where(multipliers > 0.0, rows.upper, rows.lower)
    active = multipliers != 0.0
    bound = -float(multipliers[active] @ limit[active])
    _, gradient = cost_of(qp)
    np.add.at(gradient, rows.G.column, rows.G.value * multipliers[rows.G.row])
    bound += 0.5 * float(gradient @ _least(qp, gradient))
    at = cost(program, solution.dU)
    return (at.value - bound) / at.size


def _least(qp: StageQP, gradient: Array) -> Array:
    """Where a program's cost, with this gradient at 0, is least along the dynamics."""
    size, rows = len(gradient), qp.L_X[1:].size
    hessian, _ = cost_of(qp)
    below = [each._replace(row=each.row + size) for each in dynamics_of(qp)]
    beside = [Entries(each.column, each.row, each.value) for each in below]
    mirrored = [Entries(each.column, each.row, each.value) for each in map(_strict, hessian)]
    entries = [*hessian, *mirrored, *below, *beside]
    matrix: Any = assembled(entries, (size + rows, size + rows))
    right = np.concatenate([-gradient, np.zeros(rows)])
    factor = splu(matrix)
    z = factor.solve(right)
    z += factor.solve(right - matrix @ z)
    result: Array = z[:size]
    return result


def _strict(upper: Entries) -> Entries:
    """An upper triangle without its diagonal."""
    return upper._replace(value=np.where(upper.row == upper.column, 0.0, upper.value))
