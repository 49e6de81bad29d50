"""Start of the active-set method at the rows that were active before, all of them at once.

The point is the one nearest to ``v*`` that meets those rows as equations: with the triangular
factors of the `basis` ``R'y`` is the violation of the rows at ``v*``, and ``R lambda = y``.
A row whose multiplier has come out negative is not active here and leaves again; one whose
multiplier is beyond its penalty rests there. The method can go on from the remaining
point: every multiplier lies between its ends, and every active row is met.
"""

import math
from typing import Final

from cmpsp_ros.mpsp.jit.compiled import allocation_free, inner
from cmpsp_ros.mpsp.jit.intrinsics import dot
from cmpsp_ros.mpsp.qp.active_set.basis import solve, split
from cmpsp_ros.mpsp.qp.active_set.state import (
    TOLERANCE,
    ActiveSet,
    RowState,
    WarmStart,
    add_constraint,
    apply_multiplier,
    remove_constraint,
    row_in_v,
)
from cmpsp_ros.mpsp.qp.riccati.program import (
    Program,
    RowKind,
    count_rows,
    limit,
    locate,
    row_value,
    row_value_at_origin,
    rows_per_stage,
)
from cmpsp_ros.mpsp.qp.riccati.sweeps import recover_step

# Fraction of its length, squared, that a row must have outside the span of those before it. Closer
# ones are left to the method, which adds each along its own multiplier.
_APART: Final = 1e-8
_PASSES: Final = 3  # number of passes over rows that were met already


@allocation_free
def begin(p: Program, at: ActiveSet, warm: WarmStart) -> None:
    """Begin at the terminal rows and those of the warm start, and recover the step there.

    A terminal row that depends on those before it is the furthest of its kind.
    """
    head, r, terminal = p.head[0], p.stages[0].B.shape[1], p.terminal.shape[0]
    head.active = head.saturated = head.implied = head.conflicting = head.is_proved = 0
    at.states[:] = RowState.OFF
    at.norms[:] = 0.0
    at.distances[:] = 0.0
    for k in range(head.horizon + 1):
        for a in range(r):
            at.v[k * r + a] = p.stages[k].optimum[a]
    _rest_at_penalty(p, at, warm)
    for row in range(terminal):
        _add_violated(p, at, row)
        if at.states[row] == RowState.OFF:
            kind = at.distances.shape[0] - terminal + row
            at.distances[kind] = math.inf
            at.furthest[kind] = row
    for i in range(warm.head[0].rows):
        if warm.rows[i].state == RowState.ACTIVE:
            _add_violated(p, at, warm.rows[i].row)
    before, is_current = -1, False
    for _ in range(_PASSES):
        # Rows met before others joined may be violated after.
        if head.active == before:
            break
        before, is_current = head.active, True
        recover_step(p, at.v)
        for i in range(warm.head[0].rows):
            row = warm.rows[i].row
            if warm.rows[i].state == RowState.ACTIVE and _is_violated(p, at, row):
                _add_violated(p, at, row)
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
def _rest_at_penalty(p: Program, at: ActiveSet, warm: WarmStart) -> None:
    """Put rows at their penalty that the warm start has there."""
    for i in range(warm.head[0].rows):
        row, state = warm.rows[i].row, warm.rows[i].state
        count = at.states.shape[0] if state == RowState.AT_PENALTY else p.terminal.shape[0]
        if state == RowState.ACTIVE or not 0 <= row < count or at.states[row] != RowState.OFF:
            continue
        bound, upper = limit(p, row)
        # A row that is hard now, or does not apply, rests at no penalty.
        if math.inf in (bound, upper):
            continue
        apply_multiplier(p, at, row, upper if state == RowState.AT_PENALTY else -upper)
        at.states[row] = state
        p.head[0].saturated += 1


@inner
def _add_violated(p: Program, at: ActiveSet, row: int) -> None:
    """Move the point onto a row that is violated; `multipliers` gets its entry of ``y``."""
    head = p.head[0]
    count = head.active
    if not 0 <= row < at.states.shape[0] or at.states[row] != RowState.OFF:
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
    """True for a bound at which its control is held."""
    if p.head[0].fixed == 0 or row < p.terminal.shape[0]:
        return False
    kind, k, a, sign = locate(p, row)
    return kind == RowKind.BOUND and p.stages[k].fixed[a] == sign


@inner
def _is_violated(p: Program, at: ActiveSet, row: int) -> bool:
    """True for a row that is not active and violated by the step."""
    if not 0 <= row < at.states.shape[0] or at.states[row] != RowState.OFF:
        return False
    bound, _ = limit(p, row)
    return row_value(p, row) - bound > TOLERANCE * (1.0 + abs(bound))


@inner
def _drop(p: Program, at: ActiveSet) -> bool:
    """Take out the inequalities whose multipliers, in `dependence`, are negative."""
    before = p.head[0].active
    for j in range(before - 1, -1, -1):
        if at.dependence[j] < 0.0 and at.rows[j] >= p.terminal.shape[0]:
            at.states[at.rows[j]] = RowState.OFF
            remove_constraint(p, at, j, at.multipliers, at.v)
    return p.head[0].active < before


@inner
def _saturate(p: Program, at: ActiveSet) -> bool:
    """Put the first row at its penalty whose multiplier, in `dependence`, is beyond it."""
    for j in range(p.head[0].active):
        upper = at.upper[j]
        if abs(at.dependence[j]) <= upper:
            continue
        row, state = at.rows[j], RowState.AT_PENALTY
        if at.dependence[j] < 0.0:
            upper, state = -upper, RowState.AT_MINUS_PENALTY
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
def leave_warm_start(p: Program, at: ActiveSet, warm: WarmStart) -> None:
    """Note the active rows, those at their penalty, and the bounds that are held."""
    head, kept = p.head[0], warm.head[0]
    kept.rows, kept.begun = 0, head.begun
    for j in range(head.active):
        _keep(warm, at.rows[j], RowState.ACTIVE)
    if head.saturated > 0:
        for row in range(at.states.shape[0]):
            state = at.states[row]
            if state in (RowState.AT_PENALTY, RowState.AT_MINUS_PENALTY):
                _keep(warm, row, state)
    if head.fixed > 0:
        for row in range(p.terminal.shape[0], at.states.shape[0]):
            kind, k, a, sign = locate(p, row)
            if kind == RowKind.BOUND and p.stages[k].fixed[a] == sign:
                _keep(warm, row, RowState.ACTIVE)


@inner
def _keep(warm: WarmStart, row: int, state: int) -> None:
    place = warm.rows[warm.head[0].rows]
    place.row, place.state = row, state
    warm.head[0].rows += 1


@allocation_free
def shift_warm_start(p: Program, warm: WarmStart) -> None:
    """Move a warm start to the present horizon, which begins at a later stage."""
    head = warm.head[0]
    over = (p.head[0].begun - head.begun) * rows_per_stage(p)
    if over == 0:
        return
    for i in range(head.proof):
        warm.proof[i].row = _shifted(p, warm.proof[i].row, over)
    found, head.rows, head.begun = head.rows, 0, p.head[0].begun
    for i in range(found):
        row = _shifted(p, warm.rows[i].row, over)
        if row < count_rows(p):
            _keep(warm, row, warm.rows[i].state)


@inner
def _shifted(p: Program, row: int, over: int) -> int:
    """Number of a row on the present horizon; one that no row has where it is over."""
    terminal = p.terminal.shape[0]
    if row < terminal:
        return row
    return row - over if row - over >= terminal else count_rows(p)
