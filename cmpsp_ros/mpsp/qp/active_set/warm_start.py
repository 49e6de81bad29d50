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

from cmpsp_ros.mpsp.jit.compiled import allocation_free, inner
from cmpsp_ros.mpsp.qp.active_set.basis import solve, split
from cmpsp_ros.mpsp.qp.active_set.state import (
    AT_LOWER,
    AT_MINUS_PENALTY,
    AT_PENALTY,
    FIRST,
    IS_OFF,
    TOLERANCE,
    ActiveSet,
    Indices,
    add_constraint,
    apply_multiplier,
    remove_constraint,
    row_in_v,
)
from cmpsp_ros.mpsp.qp.riccati.intrinsics import dot
from cmpsp_ros.mpsp.qp.riccati.program import (
    BOUND,
    Program,
    count_rows,
    limit,
    locate,
    row_value,
    row_value_at_origin,
    rows_per_stage,
)
from cmpsp_ros.mpsp.qp.riccati.sweeps import recover_step

# Fraction of its length, squared, that a row must have outside the span of those before it. What is
# closer to them is left to the method, which meets it along its own multiplier.
_APART: Final = 1e-8
_PASSES: Final = 3
"""How often the rows that were met already are looked at again."""


@allocation_free
def begin(p: Program, at: ActiveSet, warm: Indices) -> None:
    """Begin at the terminal rows and those of the warm start, and recover the step there.

    Args:
        p: The program, factorised.
        at: Filled. A terminal row that depends on those before it is the furthest of its kind.
        warm: Rows to begin with.
    """
    head, r, terminal = p.head[0], p.stages[0].B.shape[1], p.terminal.shape[0]
    head.active = head.saturated = head.implied = head.conflicting = head.is_proved = 0
    at.states[:] = IS_OFF
    at.norms[:] = 0.0
    at.distances[:] = 0.0
    for k in range(head.horizon + 1):
        for a in range(r):
            at.v[k * r + a] = p.stages[k].optimum[a]
    _rest_at_penalty(p, at, warm)
    for row in range(terminal):
        _add_violated(p, at, row)
        if at.states[row] == IS_OFF:
            kind = at.distances.shape[0] - terminal + row
            at.distances[kind] = math.inf
            at.furthest[kind] = row
    for i in range(FIRST, FIRST + warm[0]):
        _add_violated(p, at, warm[i])
    before, is_current = -1, False
    for _ in range(_PASSES):
        # What was met before others joined may be violated after.
        if head.active == before:
            break
        before, is_current = head.active, True
        recover_step(p, at.v)
        for i in range(FIRST, FIRST + warm[0]):
            if _is_violated(p, at, warm[i]):
                _add_violated(p, at, warm[i])
                is_current = False
    while True:
        solve(at.basis, head.active, at.multipliers, at.dependence)
        if not (_drop(p, at) or _saturate(p, at)):
            break
        is_current = False
    for j in range(head.active):
        at.multipliers[j] = at.dependence[j]
    if not is_current:
        recover_step(p, at.v)


@inner
def _rest_at_penalty(p: Program, at: ActiveSet, warm: Indices) -> None:
    """Put rows at their penalty that the warm start has there."""
    for i in range(FIRST, FIRST + warm[0]):
        row, state = -1 - warm[i], AT_PENALTY
        if row >= AT_LOWER:
            row, state = row - AT_LOWER, AT_MINUS_PENALTY
        count = at.states.shape[0] if state == AT_PENALTY else p.terminal.shape[0]
        if not 0 <= row < count or at.states[row] != IS_OFF:
            continue
        bound, upper = limit(p, row)
        # A row that is hard now is met like any other; one that does not apply has no multiplier.
        if math.inf in (bound, upper):
            continue
        apply_multiplier(p, at, row, upper if state == AT_PENALTY else -upper)
        at.states[row] = state
        p.head[0].saturated += 1


@inner
def _add_violated(p: Program, at: ActiveSet, row: int) -> None:
    """Move the point onto a row that is violated; `multipliers` gets its entry of ``y``."""
    head = p.head[0]
    count = head.active
    if not 0 <= row < at.states.shape[0] or at.states[row] != IS_OFF:
        return
    if count == at.rows.shape[0] or head.work > head.work_limit or _is_held(p, row):
        return
    length = row_in_v(p, row, at.row)
    bound, upper = limit(p, row)
    excess = dot(at.row, at.v, length) + row_value_at_origin(p, row) - bound
    if row >= p.terminal.shape[0] and excess <= TOLERANCE * (1.0 + abs(bound)):
        return
    head.work += 1 + count * at.v.shape[0] // 16
    rest = split(at.basis, count, at.row, length, at.inside, at.outside, at.dependence)
    if rest <= _APART * dot(at.row, at.row, length):
        return
    step = excess / rest
    for i in range(at.v.shape[0]):
        at.v[i] -= step * at.outside[i]
    add_constraint(p, at, row, step * math.sqrt(rest), upper, 1.0)
    head.iterations += 1


@inner
def _is_held(p: Program, row: int) -> bool:
    """Whether a row is a bound at which its control is held."""
    if p.head[0].fixed == 0 or row < p.terminal.shape[0]:
        return False
    kind, k, a, sign = locate(p, row)
    return kind == BOUND and p.stages[k].fixed[a] == sign


@inner
def _is_violated(p: Program, at: ActiveSet, row: int) -> bool:
    """Whether a row that is not active is violated by the step."""
    if not 0 <= row < at.states.shape[0] or at.states[row] != IS_OFF:
        return False
    bound, _ = limit(p, row)
    return row_value(p, row) - bound > TOLERANCE * (1.0 + abs(bound))


@inner
def _drop(p: Program, at: ActiveSet) -> bool:
    """Take out the inequalities whose multipliers, in `dependence`, are negative."""
    before = p.head[0].active
    for j in range(before - 1, -1, -1):
        if at.dependence[j] < 0.0 and at.rows[j] >= p.terminal.shape[0]:
            at.states[at.rows[j]] = IS_OFF
            remove_constraint(p, at, j, at.multipliers, at.v)
    return p.head[0].active < before


@inner
def _saturate(p: Program, at: ActiveSet) -> bool:
    """Put the first row at its penalty whose multiplier, in `dependence`, is beyond it."""
    for j in range(p.head[0].active):
        upper = at.upper[j]
        if abs(at.dependence[j]) <= upper:
            continue
        row, state = at.rows[j], AT_PENALTY
        if at.dependence[j] < 0.0:
            upper, state = -upper, AT_MINUS_PENALTY
        at.states[row] = state
        p.head[0].saturated += 1
        remove_constraint(p, at, j, at.multipliers, at.v)
        length = row_in_v(p, row, at.row)
        count = p.head[0].active
        split(at.basis, count, at.row, length, at.inside, at.outside, at.dependence)
        for i in range(at.v.shape[0]):
            at.v[i] -= upper * at.outside[i]
        for i in range(count):
            at.multipliers[i] -= upper * at.inside[i]
        return True
    return False


@allocation_free
def leave_warm_start(p: Program, at: ActiveSet, warm: Indices) -> None:
    """Note the active rows, those at their penalty, and the bounds that are held."""
    head, found = p.head[0], FIRST
    warm[1] = head.begun
    for j in range(head.active):
        warm[found] = at.rows[j]
        found += 1
    if head.saturated > 0:
        for row in range(at.states.shape[0]):
            state = at.states[row]
            if state in (AT_PENALTY, AT_MINUS_PENALTY):
                warm[found] = -1 - row - (AT_LOWER if state == AT_MINUS_PENALTY else 0)
                found += 1
    warm[0] = found - FIRST
    if head.fixed > 0:
        for row in range(p.terminal.shape[0], at.states.shape[0]):
            kind, k, a, sign = locate(p, row)
            if kind == BOUND and p.stages[k].fixed[a] == sign:
                warm[found] = row
                found += 1
        warm[0] = found - FIRST


@allocation_free
def shift_warm_start(p: Program, warm: Indices) -> None:
    """Move a warm start to the present horizon, which begins at a later stage."""
    terminal, last, kept = p.terminal.shape[0], count_rows(p), 0
    over = (p.head[0].begun - warm[1]) * rows_per_stage(p)
    if over == 0:
        return
    for i in range(3, 3 + 2 * warm[2], 2):
        # A row that is over has a number that no row has.
        if warm[i] >= terminal:
            warm[i] = warm[i] - over if warm[i] - over >= terminal else -1
    for i in range(FIRST, FIRST + warm[0]):
        row, saturated = warm[i], warm[i] < 0
        if saturated:
            row = -1 - row
        # Outputs have no stage; those at minus their penalty are `AT_LOWER` and above.
        if terminal <= row < AT_LOWER:
            row -= over
            if not terminal <= row < last:
                continue
        warm[FIRST + kept] = -1 - row if saturated else row
        kept += 1
    warm[0], warm[1] = kept, p.head[0].begun
