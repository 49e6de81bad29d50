"""Controls that are held at a bound, and so taken out of the factorisation.

A bound in the basis costs as much as all rows in it together, so that many active bounds cost the
square of their number. One that is held costs nothing: a sweep is as long as ever. But whether it
may be held shows only afterwards, in its multiplier, which an adjoint sweep recovers. So a guess of
which bounds are active is improved by whole sweeps: violated bounds are held, those with a
multiplier of the wrong sign are not (a primal-dual active-set, or semismooth Newton, method;
Hintermueller, Ito and Kunisch, SIAM Journal on Optimization 13 (2002), 865-888). The rest is left
to the method that adds row by row; bounds are only ever released there, so that it ends.
"""

import math
from typing import Final

from cmpsp_ros.mpsp.jit.compiled import allocation_free, inner
from cmpsp_ros.mpsp.jit.intrinsics import room_for
from cmpsp_ros.mpsp.qp.active_set.state import ActiveSet, WarmStart, saturated_multiplier
from cmpsp_ros.mpsp.qp.active_set.warm_start import leave_warm_start
from cmpsp_ros.mpsp.qp.riccati.program import (
    Program,
    RowKind,
    add_cost_gradient,
    add_row_gradient,
    clear_multipliers,
    count_rows,
    locate,
    product,
    set_multiplier,
)

# Active bounds from which on holding them is cheaper than to have them in the basis.
MANY: Final = 12

# A multiplier of the wrong sign by less than this, relative to 1 plus the largest gradient, is 0.
_ROUNDING = 1e-11


@allocation_free
def fix_from(p: Program, warm: WarmStart) -> None:
    """Hold the bounds of a warm start, if they are many."""
    terminal, rows, found = p.terminal.shape[0], count_rows(p), 0
    free_all(p)
    for attempt in range(2):
        for i in range(warm.head[0].rows):
            row = warm.rows[i].row
            if not terminal <= row < rows:
                continue
            kind, k, a, sign = locate(p, row)
            if kind == RowKind.BOUND:
                if attempt == 0:
                    found += 1
                elif abs(p.stages[k].upper[a] if sign > 0.0 else p.stages[k].lower[a]) < math.inf:
                    _hold(p, k, a, sign)
        if found < MANY or 2 * found < warm.head[0].rows:
            return


@allocation_free
def free_all(p: Program) -> None:
    """Hold no control at a bound."""
    head = p.head[0]
    if head.fixed == 0:
        return
    head.fixed = head.is_factorised = 0
    for k in range(p.stages.shape[0]):
        stage = p.stages[k]
        for a in range(stage.fixed.shape[0]):
            stage.fixed[a] = 0.0


@inner
def _hold(p: Program, k: int, a: int, sign: float) -> None:
    head, stage = p.head[0], p.stages[k]
    if stage.fixed[a] == 0.0:
        stage.fixed[a] = sign
        head.fixed += 1
        head.is_factorised = 0


@inner
def _let_go(p: Program, k: int, a: int) -> None:
    p.stages[k].fixed[a] = 0.0
    p.head[0].fixed -= 1
    p.head[0].is_factorised = 0


@allocation_free
def write_multipliers(p: Program, at: ActiveSet) -> None:
    """Write the multipliers of all rows where they belong, those of held bounds too."""
    clear_multipliers(p)
    for j in range(p.head[0].active):
        row, upper = at.rows[j], at.upper[j]
        lower = -upper if row < p.terminal.shape[0] else 0.0
        set_multiplier(p, row, min(max(at.multipliers[j], lower), upper))
    if p.head[0].saturated > 0:
        for row in range(at.states.shape[0]):
            multiplier = saturated_multiplier(p, at, row)
            if multiplier != 0.0:
                set_multiplier(p, row, multiplier)


@allocation_free
def recover_bound_multipliers(p: Program, cost: float) -> float:
    """Compute the multipliers of the held bounds from the gradient of all other terms.

    With `cost` = 0 the cost is left out, and all bounds get one. Returns the largest part of a
    gradient.
    """
    head, first, largest = p.head[0], p.stages[0], 0.0
    n, r = first.B.shape
    X, U, following = room_for(first.L_X), room_for(first.L_U), room_for(first.L_X)
    head.work += head.horizon + 1
    for k in range(head.horizon, -1, -1):
        stage = p.stages[k]
        for i in range(n):
            X[i] = stage.trust[i]
        for a in range(r):
            U[a] = 0.0
        if cost != 0.0:
            add_cost_gradient(stage, X, U)
        for j in range(p.path.shape[1]):
            if p.path[k, j].multiplier != 0.0:
                add_row_gradient(p.path[k, j], X, U)
        if k == head.horizon:
            for j in range(p.terminal.shape[0]):
                add_row_gradient(p.terminal[j], X, U)
        else:
            for i in range(n):
                for a in range(r):
                    U[a] += stage.B[i, a] * following[i]
                for j in range(n):
                    X[i] += stage.A[j, i] * following[j]
        for a in range(r):
            if stage.fixed[a] != 0.0 or cost == 0.0:
                stage.bounds[a] = -U[a]
                largest = max(largest, abs(U[a]))
        for i in range(n):
            following[i] = X[i]
    return largest


@allocation_free
def release_wrong(p: Program, at: ActiveSet) -> int:
    """Let go of the held bounds whose multipliers have the wrong sign; returns how many.

    Leaves the multipliers of all rows where they belong.
    """
    write_multipliers(p, at)
    if p.head[0].fixed == 0:
        return 0
    return release(p, _ROUNDING * (1.0 + recover_bound_multipliers(p, 1.0)))


@allocation_free
def release(p: Program, tolerance: float) -> int:
    """Let go of the held bounds with negative multipliers; less than the tolerance counts as 0."""
    released = 0
    for k in range(p.head[0].horizon + 1):
        stage = p.stages[k]
        for a in range(stage.fixed.shape[0]):
            if stage.fixed[a] != 0.0 and stage.fixed[a] * stage.bounds[a] < 0.0:
                if stage.fixed[a] * stage.bounds[a] < -tolerance:
                    _let_go(p, k, a)
                    released += 1
                stage.bounds[a] = 0.0
    return released


@allocation_free
def hold_violated(p: Program) -> int:
    """Hold the controls that the step has beyond a bound, if they are many; returns how many.

    Where more path rows are violated the basis will be large in any case, and would be rebuilt
    with each guess.
    """
    found = _hold_beyond(p, False)
    if found < MANY or found + p.head[0].fixed < _violated_path_rows(p):
        return 0
    return _hold_beyond(p, True)


@inner
def _hold_beyond(p: Program, holds: bool) -> int:
    """Count, or hold, the controls beyond a bound."""
    found = 0
    for k in range(p.head[0].horizon + 1):
        stage = p.stages[k]
        for a in range(stage.fixed.shape[0]):
            above = stage.dU[a] > stage.upper[a]
            if stage.fixed[a] == 0.0 and (above or stage.dU[a] < stage.lower[a]):
                found += 1
                if holds:
                    _hold(p, k, a, 1.0 if above else -1.0)
    return found


@inner
def _violated_path_rows(p: Program) -> int:
    found = 0
    for k in range(p.head[0].horizon + 1):
        for j in range(p.path.shape[1]):
            row = p.path[k, j]
            found += int(row.value + product(row, p.stages[k]) > 0.0)
    return found


@allocation_free
def restart_from(p: Program, at: ActiveSet, warm: WarmStart, absorbs: bool) -> None:
    """Leave a warm start of the rows alone, after bounds have been held or let go.

    With `absorbs` active bounds are held from now on.
    """
    fixed = p.head[0].fixed
    p.head[0].fixed = 0
    leave_warm_start(p, at, warm)
    p.head[0].fixed = fixed
    if not absorbs:
        return
    for j in range(p.head[0].active):
        row = at.rows[j]
        if row >= p.terminal.shape[0]:
            kind, k, a, sign = locate(p, row)
            if kind == RowKind.BOUND and at.multipliers[j] > 0.0:
                _hold(p, k, a, sign)
