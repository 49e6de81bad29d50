"""Where the active-set method begins: at the rows that were active before, all of them at once.

The point is the one nearest to ``v*`` that meets those rows as equations: with the triangular
factors of the `basis` ``R'y`` is what the rows are violated by at ``v*``, and ``R lambda = y``.
A row whose multiplier has come out negative is not active here and leaves again; one whose
multiplier is beyond its penalty rests there. What is left is a point from which the method can go
on: every multiplier lies between its ends, and every active row is met.
"""

from __future__ import annotations

import math
from typing import Final

from cmpsp_ros.mpsp.jit.compiled import allocation_free, inlined
from cmpsp_ros.mpsp.riccati.basis import solve, split
from cmpsp_ros.mpsp.riccati.inner_product import dot
from cmpsp_ros.mpsp.riccati.refinement import pull
from cmpsp_ros.mpsp.riccati.rows import limit_of, white_row
from cmpsp_ros.mpsp.riccati.stage_qp import Penalty, StageQP
from cmpsp_ros.mpsp.riccati.whitening import Whitening
from cmpsp_ros.mpsp.riccati.working_set import (
    ACTIVE,
    AT_MINUS_PENALTY,
    AT_PENALTY,
    IS_OFF,
    ITERATIONS,
    SATURATED,
    TOLERANCE,
    ActiveSet,
    Hint,
    take_in,
    take_out,
)

# Part of its length, squared, that a row must have outside the span of those before it. What is
# closer to them is left to the method, which meets it along its own multiplier.
_APART: Final = 1e-8


@inlined
def begin(
    qp: StageQP, penalty: Penalty, white: Whitening, at: ActiveSet, hint: Hint, limit: int
) -> None:
    """Begin at the terminal rows and those of the hint.

    Args:
        qp: The program.
        penalty: Largest multipliers, infinite where a row is hard.
        white: Its factorisation.
        at: Filled. A terminal row that depends on those before it is the furthest of its kind.
        hint: Rows to begin with.
        limit: How many rows to take in at most.
    """
    at.counts[:] = 0
    at.states[:] = IS_OFF
    at.lengths[:] = 0.0
    at.distances[:] = 0.0
    for i in range(at.v.shape[0]):
        at.v[i] = white.optimum[i]
    _rest(qp, penalty, white, at, hint)
    terminal = qp.output_error.shape[0]
    for row in range(terminal):
        _meet(qp, penalty, white, at, row, limit)
        if at.states[row] == IS_OFF:
            kind = at.distances.shape[0] - terminal + row
            at.distances[kind] = math.inf
            at.furthest[kind] = row
    for i in range(hint.length[0]):
        _meet(qp, penalty, white, at, hint.rows[i], limit)
    while True:
        solve(at.basis, at.counts[ACTIVE], at.multipliers, at.dependence)
        if not (_drop(qp, at) or _saturate(qp, white, at)):
            break
    for j in range(at.counts[ACTIVE]):
        at.multipliers[j] = at.dependence[j]


@inlined
def _rest(qp: StageQP, penalty: Penalty, white: Whitening, at: ActiveSet, hint: Hint) -> None:
    """Put rows at their penalty that the hint has there."""
    for i in range(hint.length[0]):
        row = -1 - hint.rows[i]
        if not 0 <= row < at.states.shape[0] or at.states[row] != IS_OFF:
            continue
        bound, most = limit_of(qp, penalty, row)
        # A row that is hard now is met like any other; one that does not apply has no multiplier.
        if math.inf in (bound, most):
            continue
        pull(qp, white, at, row, most)
        at.states[row] = AT_PENALTY
        at.counts[SATURATED] += 1


@allocation_free
def _meet(
    qp: StageQP, penalty: Penalty, white: Whitening, at: ActiveSet, row: int, limit: int
) -> None:
    """Move the point onto a row that is violated; `multipliers` gets its entry of ``y``."""
    count = at.counts[ACTIVE]
    if not 0 <= row < at.states.shape[0] or at.states[row] != IS_OFF:
        return
    if count == min(limit, at.rows.shape[0]):
        return
    length = white_row(qp, white, row, at.row)
    bound, most = limit_of(qp, penalty, row)
    excess = dot(at.row, at.v, length) - bound
    if row >= qp.output_error.shape[0] and excess <= TOLERANCE * (1.0 + abs(bound)):
        return
    rest = split(at.basis, count, at.row, length, at.inside, at.outside, at.dependence)
    if rest <= _APART * dot(at.row, at.row, length):
        return
    step = excess / rest
    for i in range(at.v.shape[0]):
        at.v[i] -= step * at.outside[i]
    take_in(at, row, step * math.sqrt(rest), most, 1.0)
    at.counts[ITERATIONS] += 1


@inlined
def _drop(qp: StageQP, at: ActiveSet) -> bool:
    """Take out the inequalities whose multipliers, in `dependence`, are negative."""
    before = at.counts[ACTIVE]
    for j in range(before - 1, -1, -1):
        if at.dependence[j] < 0.0 and at.rows[j] >= qp.output_error.shape[0]:
            at.states[at.rows[j]] = IS_OFF
            take_out(at, j, at.multipliers, at.v)
    return at.counts[ACTIVE] < before


@inlined
def _saturate(qp: StageQP, white: Whitening, at: ActiveSet) -> bool:
    """Put the first row at its penalty whose multiplier, in `dependence`, is beyond it."""
    for j in range(at.counts[ACTIVE]):
        most = at.most[j]
        if abs(at.dependence[j]) <= most:
            continue
        row, state = at.rows[j], AT_PENALTY
        if at.dependence[j] < 0.0:
            most, state = -most, AT_MINUS_PENALTY
        at.states[row] = state
        at.counts[SATURATED] += 1
        take_out(at, j, at.multipliers, at.v)
        length = white_row(qp, white, row, at.row)
        count = at.counts[ACTIVE]
        split(at.basis, count, at.row, length, at.inside, at.outside, at.dependence)
        for i in range(at.v.shape[0]):
            at.v[i] -= most * at.outside[i]
        for i in range(count):
            at.multipliers[i] -= most * at.inside[i]
        return True
    return False
