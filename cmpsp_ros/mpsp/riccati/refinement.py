"""Taking rounding out of a solution of the active-set method."""

from __future__ import annotations

from cmpsp_ros.mpsp.jit.compiled import allocation_free
from cmpsp_ros.mpsp.problem import Array
from cmpsp_ros.mpsp.riccati.basis import solve, solve_transposed
from cmpsp_ros.mpsp.riccati.rows import limit_of, value_of, white_row
from cmpsp_ros.mpsp.riccati.stage_qp import Penalty, StageQP
from cmpsp_ros.mpsp.riccati.whitening import Whitening, unwhiten
from cmpsp_ros.mpsp.riccati.working_set import (
    ACTIVE,
    AT_MINUS_PENALTY,
    AT_PENALTY,
    SATURATED,
    ActiveSet,
)

# Rows off by more than this, relative to 1 plus their right-hand side, are sharpened.
_BLUNT = 1e-12


@allocation_free
def sharpen(
    qp: StageQP, penalty: Penalty, white: Whitening, at: ActiveSet, dU: Array, dX: Array
) -> None:
    """Take rounding out of the active rows: one step of iterative refinement."""
    count, blunt = at.counts[ACTIVE], False
    for j in range(count):
        bound, _ = limit_of(qp, penalty, at.rows[j])
        at.inside[j] = value_of(qp, at.rows[j], dU, dX) - bound
        blunt = blunt or abs(at.inside[j]) > _BLUNT * (1.0 + abs(bound))
    if not blunt:
        return
    solve_transposed(at.basis, count, at.inside, at.dependence)
    for j in range(count):
        at.inside[j] = at.dependence[j]
        Q = at.basis.Q[j]
        for i in range(at.v.shape[0]):
            at.v[i] -= at.inside[j] * Q[i]
    solve(at.basis, count, at.inside, at.dependence)
    for j in range(count):
        at.multipliers[j] += at.dependence[j]
    unwhiten(qp, white, at.v, dU, dX)


@allocation_free
def retrace(qp: StageQP, penalty: Penalty, white: Whitening, at: ActiveSet) -> None:
    """``v`` from the multipliers, without the rounding of the way to it."""
    for i in range(at.v.shape[0]):
        at.v[i] = white.optimum[i]
    for j in range(at.counts[ACTIVE]):
        pull(qp, white, at, at.rows[j], at.multipliers[j])
    if at.counts[SATURATED] > 0:
        for row in range(at.states.shape[0]):
            if at.states[row] == AT_PENALTY:
                pull(qp, white, at, row, limit_of(qp, penalty, row)[1])
            elif at.states[row] == AT_MINUS_PENALTY:
                pull(qp, white, at, row, -limit_of(qp, penalty, row)[1])


@allocation_free
def pull(qp: StageQP, white: Whitening, at: ActiveSet, row: int, multiplier: float) -> None:
    """Move the point by a multiplier of one row; `ActiveSet.row` holds the row afterwards."""
    for i in range(white_row(qp, white, row, at.row)):
        at.v[i] -= multiplier * at.row[i]
