"""One step of the dual active-set method: a violated row is met, or the proof that it cannot be."""

from __future__ import annotations

import math
from typing import Any

from cmpsp_ros.mpsp.jit.compiled import allocation_free, inner
from cmpsp_ros.mpsp.qp.active_set.basis import solve, split
from cmpsp_ros.mpsp.qp.active_set.farkas import bounds_cross, contradicts, name_rows
from cmpsp_ros.mpsp.qp.active_set.fixed_bounds import recover_bound_multipliers, release
from cmpsp_ros.mpsp.qp.active_set.state import (
    AT_MINUS_PENALTY,
    AT_PENALTY,
    IS_ACTIVE,
    IS_IMPLIED,
    IS_OFF,
    TOLERANCE,
    ActiveSet,
    add_constraint,
    iterative_refinement,
    remove_constraint,
    row_in_v,
)
from cmpsp_ros.mpsp.qp.riccati.intrinsics import dot
from cmpsp_ros.mpsp.qp.riccati.program import (
    Program,
    clear_multipliers,
    limit,
    row_value,
    row_value_at_origin,
    set_multiplier,
)
from cmpsp_ros.mpsp.qp.riccati.sweeps import recover_step

DONE, CONTRADICTION, FULL, RELEASED, CROWDED = 0, 1, 2, 3, 4
"""Outcomes of a step: the row is met; it contradicts the others; there is no room or work left;
bounds that are held stood in its way and are held no longer; or (of many steps) so many bounds have
become active that they are better held."""

# Coefficients of a dependence below this, relative to the largest, are rounding.
NEGLIGIBLE = 1e-12
# A row that depends on others is implied by them, not in contradiction, up to this violation,
# relative as `TOLERANCE` is. The check of the answer has the last word.
_ROUNDING = 1e-8
# Multipliers of held bounds below this, relative to the largest, are 0 in a combination of rows.
_NO_DIRECTION = 1e-9


@allocation_free
def active_set_step(p: Program, at: ActiveSet, row: int) -> int:
    """Move along one row's multiplier until the row is met or its multiplier is at an end."""
    head = p.head[0]
    length = row_in_v(p, row, at.row)
    bound, upper = limit(p, row)
    excess = dot(at.row, at.v, length) + row_value_at_origin(p, row) - bound
    is_equality = row < p.terminal.shape[0]
    state, multiplier = at.states[row], 0.0
    sign = 1.0 if excess >= 0.0 else -1.0
    if state == AT_PENALTY:
        multiplier = upper
    elif state == AT_MINUS_PENALTY:
        multiplier = -upper
    elif not is_equality and excess <= TOLERANCE * (1.0 + abs(bound)):
        return DONE
    excess = abs(excess)
    # How far the multiplier may go before it is at its other end.
    slack = multiplier if sign < 0.0 and not is_equality else upper - sign * multiplier
    for i in range(length):
        at.row[i] *= sign
    head.work += 1 + head.active * at.v.shape[0] // 8
    rest = split(at.basis, head.active, at.row, length, at.inside, at.outside, at.dependence)
    while head.work <= head.work_limit:
        head.iterations += 1
        count = head.active
        head.work += 1 + (at.v.shape[0] + count * count) // 16
        if count == at.v.shape[0]:
            # As many rows as there are controls leave no freedom for another.
            rest = 0.0
        solve(at.basis, count, at.inside, at.dependence)
        to_row = excess / rest if rest > 0.0 else math.inf
        to_end, first = _first_to_leave(p, at)
        step = min(to_row, slack, to_end)
        if step == math.inf:
            return _judge(p, at, row, sign, multiplier)
        if rest > 0.0:
            for i in range(at.v.shape[0]):
                at.v[i] -= step * at.outside[i]
            excess -= step * rest
        for j in range(count):
            at.multipliers[j] -= step * at.dependence[j]
        multiplier += sign * step
        slack -= step
        if step == to_row:
            if count == at.rows.shape[0]:
                return FULL
            head.saturated -= int(state > IS_ACTIVE)
            add_constraint(p, at, row, multiplier, upper, sign)
            return DONE
        if step == to_end:
            rest += _release(p, at, first)
        else:
            # Its own multiplier came to an end first.
            ended = AT_MINUS_PENALTY if is_equality else IS_OFF
            at.states[row] = AT_PENALTY if sign > 0.0 else ended
            head.saturated += int(at.states[row] > IS_ACTIVE) - int(state > IS_ACTIVE)
            return DONE
    return FULL


@inner
def _first_to_leave(p: Program, at: ActiveSet) -> Any:
    """Step at which the first active multiplier comes to one of its ends, and which it is."""
    count = p.head[0].active
    largest = 0.0
    for j in range(count):
        largest = max(largest, abs(at.dependence[j]))
    nearest, first = math.inf, -1
    for j in range(count):
        rate = at.dependence[j]
        if abs(rate) <= NEGLIGIBLE * largest:
            continue
        upper = at.upper[j]
        lower = -upper if at.rows[j] < p.terminal.shape[0] else 0.0
        slack = at.multipliers[j] - lower if rate > 0.0 else upper - at.multipliers[j]
        step = max(slack, 0.0) / abs(rate)
        if step < nearest:
            nearest, first = step, j
    return nearest, first


@inner
def _release(p: Program, at: ActiveSet, index: int) -> float:
    """Take a row whose multiplier is at an end out of the active set.

    Returns:
        What the row being met gains outside the span of the others, squared.
    """
    head, row = p.head[0], at.rows[index]
    if at.dependence[index] < 0.0:
        at.states[row] = AT_PENALTY
    else:
        at.states[row] = AT_MINUS_PENALTY if row < p.terminal.shape[0] else IS_OFF
    head.saturated += int(at.states[row] != IS_OFF)
    if head.implied > 0:
        # What the active rows implied they may imply no longer.
        head.implied = 0
        for other in range(at.states.shape[0]):
            if at.states[other] == IS_IMPLIED:
                at.states[other] = IS_OFF
    for j in range(index, head.active - 1):
        at.multipliers[j] = at.multipliers[j + 1]
    return remove_constraint(p, at, index, at.inside, at.outside)


@inner
def _judge(p: Program, at: ActiveSet, row: int, sign: float, multiplier: float) -> int:
    """Tell a row that contradicts the active ones from one that they imply.

    Farkas' proof comes first. Without one, bounds that are held stand in the way where the
    combination asks for a multiplier that they cannot have, and are released. Rounding of the
    active rows would look like a contradiction: it is taken out.
    """
    head = p.head[0]
    _combine(p, at, row, sign)
    largest = recover_bound_multipliers(p, 0.0)
    head.is_proved = int(bounds_cross(p, at, row) or contradicts(p, at, largest))
    if head.is_proved == 1:
        return CONTRADICTION
    if head.fixed > 0 and release(p, _NO_DIRECTION * largest) > 0:
        return RELEASED
    # What was added to its multiplier is theirs, since the row is a combination of them.
    for j in range(head.active):
        at.multipliers[j] += sign * multiplier * at.dependence[j]
    bound, _ = limit(p, row)
    size = 0.0
    for j in range(head.active):
        size += abs(at.dependence[j]) * (1.0 + abs(limit(p, at.rows[j])[0]))
    rounding = max(_ROUNDING * (1.0 + abs(bound)), TOLERANCE * size)
    recover_step(p, at.v)
    iterative_refinement(p, at)
    if sign * (row_value(p, row) - bound) > rounding:
        name_rows(p, at, _NO_DIRECTION * largest)
        return CONTRADICTION
    at.states[row] = IS_IMPLIED
    head.implied += 1
    return DONE


@inner
def _combine(p: Program, at: ActiveSet, row: int, sign: float) -> None:
    """Write the combination of rows that is 0: a row times its sign less its `dependence`."""
    count, largest = p.head[0].active, 0.0
    clear_multipliers(p)
    set_multiplier(p, row, sign)
    for j in range(count):
        largest = max(largest, abs(at.dependence[j]))
    for j in range(count):
        if abs(at.dependence[j]) > NEGLIGIBLE * largest:
            set_multiplier(p, at.rows[j], -at.dependence[j])
