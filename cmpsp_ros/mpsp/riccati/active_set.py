"""A dual active-set method (Goldfarb and Idnani, 1983) with bounded multipliers.

In the variables of the `whitening` the program is: find the point nearest to ``v*`` that meets
all rows. The method begins at ``v*`` and adds one violated row after the other, keeping

    v = v* - sum_j lambda_j a_j,    0 <= lambda_j <= penalty_j,

so that the cost rises until nothing is violated. A multiplier that comes back to 0 leaves the
active set. One that reaches its penalty stays there while its row stays violated: this is the
exact L1 relaxation, without slack variables. With an infinite penalty the row is hard.

Goldfarb, D. and Idnani, A.: A numerically stable dual method for solving strictly convex
quadratic programs. Mathematical Programming 27 (1983), 1-33.
"""

from __future__ import annotations

import math

from cmpsp_ros.mpsp.jit.compiled import allocation_free, inlined
from cmpsp_ros.mpsp.problem import Array
from cmpsp_ros.mpsp.riccati.meeting import CONTRADICTION, DONE, FULL, meet
from cmpsp_ros.mpsp.riccati.outcome import INFEASIBLE, ITERATION_LIMIT, SOLVED
from cmpsp_ros.mpsp.riccati.refinement import retrace, sharpen
from cmpsp_ros.mpsp.riccati.rows import limit_of, put_multiplier, value_of, white_length
from cmpsp_ros.mpsp.riccati.size import dimension
from cmpsp_ros.mpsp.riccati.stage_qp import Multipliers, Penalty, StageQP
from cmpsp_ros.mpsp.riccati.warm_start import begin
from cmpsp_ros.mpsp.riccati.whitening import Whitening, spread, unwhiten
from cmpsp_ros.mpsp.riccati.working_set import (
    ACTIVE,
    AT_MINUS_PENALTY,
    AT_PENALTY,
    IS_ACTIVE,
    IS_IMPLIED,
    IS_OFF,
    ITERATIONS,
    SATURATED,
    SPREAD,
    TOLERANCE,
    ActiveSet,
    Hint,
)

# After so many steps the point is found again from the multipliers: rounding has added up.
_MANY = 64


@inlined
def find_active_set(
    qp: StageQP,
    penalty: Penalty,
    white: Whitening,
    at: ActiveSet,
    hint: Hint,
    dU: Array,
    dX: Array,
    multipliers: Multipliers,
    limit: int,
) -> int:
    """Solve a factorised program.

    Args:
        qp: The program.
        penalty: Largest multipliers, infinite where a row is hard.
        white: Its factorisation.
        at: Room; holds how it ended.
        hint: Rows to begin with. They change the way to the solution, not the solution. Those of
            this solution are left in it.
        dU: Filled with the control deviations, shape ``(N + 1, r)``.
        dX: Filled with the state deviations, shape ``(N + 1, n)``.
        multipliers: Filled.
        limit: Iterations at most.

    Returns:
        `SOLVED`, `INFEASIBLE` (see ``at.conflict``) or `ITERATION_LIMIT`; the last as well where
        more rows would be active than there is room for.
    """
    begin(qp, penalty, white, at, hint, limit)
    outcome, looked_at = DONE, -1
    while outcome == DONE:
        row = _furthest(at)
        if row < 0:
            # What has been looked for and brought no iteration is violated by rounding alone.
            if at.counts[ITERATIONS] == looked_at:
                break
            looked_at = at.counts[ITERATIONS]
            unwhiten(qp, white, at.v, dU, dX)
            if not _find_violated(qp, white, at, dU, dX):
                break
            row = _furthest(at)
        outcome = meet(qp, penalty, white, at, row, limit, dU, dX)
    if outcome == DONE:
        if at.counts[ITERATIONS] > _MANY:
            retrace(qp, penalty, white, at)
            unwhiten(qp, white, at.v, dU, dX)
        sharpen(qp, penalty, white, at, dU, dX)
    _leave_hint(at, hint)
    if outcome == CONTRADICTION:
        return INFEASIBLE
    if outcome == FULL:
        return ITERATION_LIMIT
    _fill(qp, penalty, at, multipliers)
    return SOLVED


@inlined
def _find_violated(qp: StageQP, white: Whitening, at: ActiveSet, dU: Array, dX: Array) -> bool:
    """Find the row of each kind that is furthest from being met; returns whether there is any.

    For a row at its penalty the same is asked of its being violated. The rows that differ only in
    their stage are one kind: mostly, the worst of each is needed, and one look at all of them
    costs as much as meeting a few.
    """
    n, r = dimension(qp.state), dimension(qp.control)
    terminal, path = qp.output_error.shape[0], qp.g.shape[1]
    states, saturated, found = at.states, at.counts[SATURATED] > 0, False
    at.distances[:] = 0.0
    if saturated:
        for row in range(terminal):
            excess = value_of(qp, row, dU, dX) + qp.output_error[row]
            if states[row] == AT_PENALTY:
                excess = -excess
            if states[row] >= AT_PENALTY and excess > TOLERANCE:
                kind = path + r + n + row
                found = _note(qp, white, at, kind, row, excess, qp.output_error[row]) or found
    row = terminal
    for k in range(qp.g.shape[0]):
        for j in range(path):
            excess = qp.g[k, j]
            for i in range(n):
                excess += qp.g_X[k, j, i] * dX[k, i]
            for a in range(r):
                excess += qp.g_U[k, j, a] * dU[k, a]
            if saturated and states[row] == AT_PENALTY:
                excess = -excess
            if excess > TOLERANCE and states[row] != IS_ACTIVE:
                found = _note(qp, white, at, j, row, excess, qp.g[k, j]) or found
            row += 1
        for a in range(r):
            above, below = dU[k, a] - qp.upper[k, a], qp.lower[k, a] - dU[k, a]
            if above > TOLERANCE and states[row] == IS_OFF:
                found = _note(qp, white, at, path + a, row, above, qp.upper[k, a]) or found
            if below > TOLERANCE and states[row + 1] == IS_OFF:
                found = _note(qp, white, at, path + a, row + 1, below, qp.lower[k, a]) or found
            row += 2
        for i in range(n):
            excess = abs(dX[k, i]) - qp.trust_radius[i]
            if excess > TOLERANCE:
                side = row if dX[k, i] > 0.0 else row + 1
                if states[side] == IS_OFF:
                    kind = path + r + i
                    found = _note(qp, white, at, kind, side, excess, qp.trust_radius[i]) or found
            row += 2
    return found


@allocation_free
def _note(
    qp: StageQP, white: Whitening, at: ActiveSet, kind: int, row: int, excess: float, bound: float
) -> bool:
    """Keep a row, if it is violated and further away than any other of its kind."""
    if excess <= TOLERANCE * (1.0 + abs(bound)):
        return False
    far = _distance(qp, white, at, row, excess)
    if far > at.distances[kind]:
        at.distances[kind] = far
        at.furthest[kind] = row
    return far > 0.0


@inlined
def _furthest(at: ActiveSet) -> int:
    """Take out the furthest of the rows that were kept; -1 where none is left."""
    best = 0
    for kind in range(1, at.distances.shape[0]):
        if at.distances[kind] > at.distances[best]:
            best = kind
    if at.distances[best] == 0.0:
        return -1
    at.distances[best] = 0.0
    return at.furthest[best]


@allocation_free
def _distance(qp: StageQP, white: Whitening, at: ActiveSet, row: int, excess: float) -> float:
    """How far away in ``v`` a row begins to be met; 0 for one that is implied by others."""
    if at.states[row] == IS_IMPLIED:
        return 0.0
    if at.lengths[row] == 0.0:
        if at.counts[SPREAD] == 0:
            spread(qp, white)
            at.counts[SPREAD] = 1
        at.lengths[row] = white_length(qp, white, row)
    return excess / at.lengths[row] if at.lengths[row] > 0.0 else math.inf


@inlined
def _fill(qp: StageQP, penalty: Penalty, at: ActiveSet, multipliers: Multipliers) -> None:
    """Write the multipliers of all rows where they belong."""
    multipliers.terminal[:] = 0.0
    multipliers.path[:] = 0.0
    multipliers.trust[:] = 0.0
    multipliers.bounds[:] = 0.0
    for j in range(at.counts[ACTIVE]):
        row, most = at.rows[j], at.most[j]
        least = -most if row < qp.output_error.shape[0] else 0.0
        put_multiplier(qp, row, min(max(at.multipliers[j], least), most), multipliers)
    if at.counts[SATURATED] > 0:
        for row in range(at.states.shape[0]):
            if at.states[row] == AT_PENALTY:
                put_multiplier(qp, row, limit_of(qp, penalty, row)[1], multipliers)
            elif at.states[row] == AT_MINUS_PENALTY:
                put_multiplier(qp, row, -limit_of(qp, penalty, row)[1], multipliers)


@inlined
def _leave_hint(at: ActiveSet, hint: Hint) -> None:
    found = 0
    for j in range(at.counts[ACTIVE]):
        hint.rows[found] = at.rows[j]
        found += 1
    if at.counts[SATURATED] > 0:
        for row in range(at.states.shape[0]):
            if at.states[row] == AT_PENALTY:
                hint.rows[found] = -1 - row
                found += 1
    hint.length[0] = found
