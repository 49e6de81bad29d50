"""Proof by its multipliers that no point meets the hard rows of a program (Farkas)."""

from __future__ import annotations

import math
from typing import Any

from cmpsp_ros.mpsp.jit.compiled import allocation_free
from cmpsp_ros.mpsp.problem import Array
from cmpsp_ros.mpsp.riccati.barrier import EQUAL, OFF, Barrier
from cmpsp_ros.mpsp.riccati.newton import add_force
from cmpsp_ros.mpsp.riccati.rows import BOUND, limit_of, load_row, number_of, place_of
from cmpsp_ros.mpsp.riccati.size import dimension
from cmpsp_ros.mpsp.riccati.stage_qp import Penalty, StageQP
from cmpsp_ros.mpsp.riccati.whitening import Whitening
from cmpsp_ros.mpsp.riccati.working_set import Indices

FARTHEST = 1e6
"""Controls without a bound stay within so many times 1 plus the largest one of the iterate."""

# Sums of parts are wrong by less than this, relative to the sum of their sizes.
_ROUNDING = 1e-10


@allocation_free
def proves_infeasible(
    qp: StageQP,
    model: StageQP,
    penalty: Penalty,
    white: Whitening,
    b: Barrier,
    dU: Array,
    conflict: Indices,
) -> int:
    """Whether the multipliers of an iterate combine hard rows to one that nothing meets.

    Where there is no solution they grow without end, and the last step shows the direction more
    clearly than their sum does. The fewer rows do, the better: those with small multipliers are
    left out where they can be.

    Args:
        qp: The program.
        model: The same with a cost of its own, which is lost.
        penalty: Largest multipliers, infinite where a row is hard.
        white: Scratch.
        b: Rows of the iterate.
        dU: Its control deviations, shape ``(N + 1, r)``.
        conflict: Filled with the rows that contradict each other, shape ``(rows,)``.

    Returns:
        How many these are; 0 where the multipliers prove nothing.
    """
    farthest = 1.0
    for k in range(dU.shape[0]):
        for a in range(dU.shape[1]):
            farthest = max(farthest, 1.0 + abs(dU[k, a]))
    farthest *= FARTHEST
    for attempt in range(2):
        multipliers = b.multiplier_step
        if attempt == 1:
            # Not needed any more: the step has been taken.
            multipliers = b.miss
            for row in range(b.kind.shape[0]):
                multipliers[row] = b.multiplier[row] - b.offset[row]
        largest = 0.0
        for row in range(b.kind.shape[0]):
            pull = _pull(qp, penalty, b, multipliers, row)
            largest = max(largest, abs(pull) * b.length[row])
        for least in (1e-3, 1e-6, 1e-9, 0.0):
            found = _combine(
                qp, model, penalty, white, b, multipliers, least * largest, farthest, conflict
            )
            if found > 0:
                return found
    return 0


@allocation_free
def _combine(
    qp: StageQP,
    model: StageQP,
    penalty: Penalty,
    white: Whitening,
    b: Barrier,
    multipliers: Array,
    least: float,
    farthest: float,
    conflict: Indices,
) -> int:
    """Add up the rows with multipliers above the least one; returns how many contradict.

    All points that meet them meet the sum, ``constant + slope' dU <= 0``. Bounds have whatever
    multipliers the slope asks for: the sum's least value is taken within the bounds.
    """
    n, r = dimension(qp.state), dimension(qp.control)
    N, p, before = qp.A.shape[0], white.p, white.t
    model.L_X[:] = 0.0
    model.L_U[:] = 0.0
    total, size, found = 0.0, 0.0, 0
    for row in range(b.kind.shape[0]):
        multiplier = _pull(qp, penalty, b, multipliers, row)
        if abs(multiplier) * b.length[row] > least:
            bound, _ = limit_of(qp, penalty, row)
            total -= multiplier * bound
            size += abs(multiplier) * (abs(bound) + abs(b.value[row]))
            conflict[found] = row
            found += 1
            add_force(model, white, load_row(qp, white, row), multiplier)
    for i in range(n):
        p[i] = 0.0
    for k in range(N, -1, -1):
        for a in range(r):
            slope = model.L_U[k, a]
            if k < N:
                for i in range(n):
                    slope += qp.B[k, i, a] * p[i]
            row = number_of(qp, BOUND, k, a)
            bound, length = qp.upper[k, a], max(b.length[row], b.length[row + 1])
            if slope > 0.0:
                row, bound = row + 1, -qp.lower[k, a]
            part = -abs(slope) * farthest
            # Its multiplier would be the slope.
            if bound < math.inf and abs(slope) * length > least:
                part = -abs(slope) * bound
                conflict[found] = row
                found += 1
            total += part
            size += abs(part)
        for i in range(n):
            before[i] = model.L_X[k, i]
            if k < N:
                for j in range(n):
                    before[i] += qp.A[k, j, i] * p[j]
        for i in range(n):
            p[i] = before[i]
    return found if total > _ROUNDING * size else 0


@allocation_free
def _pull(qp: StageQP, penalty: Penalty, b: Barrier, multipliers: Array, row: int) -> Any:
    """Multiplier of a hard row that is no bound, of a sign that it may have, else 0."""
    if b.kind[row] == OFF or limit_of(qp, penalty, row)[1] < math.inf:
        return 0.0
    if row >= qp.output_error.shape[0] and place_of(qp, row).kind == BOUND:
        return 0.0
    if b.kind[row] == EQUAL or row < qp.output_error.shape[0]:
        return multipliers[row]
    return max(multipliers[row], 0.0)
