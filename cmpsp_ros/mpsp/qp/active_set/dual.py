"""A dual active-set method (Goldfarb and Idnani, 1983) with bounded multipliers.

In the variables of the `factorisation` the program is: find the point nearest to ``v*`` that meets
all rows. The method begins at ``v*`` and adds one violated row after the other, keeping

    v = v* - sum_j lambda_j a_j,    0 <= lambda_j <= penalty_j,

so that the cost rises until nothing is violated. A multiplier that comes back to 0 leaves the
active set. One that reaches its penalty stays there while its row stays violated: this is the
exact L1 relaxation, without slack variables. With an infinite penalty the row is hard.

Goldfarb, D. and Idnani, A.: A numerically stable dual method for solving strictly convex
quadratic programs. Mathematical Programming 27 (1983), 1-33.
"""

import math
from enum import IntEnum
from typing import Any

from cmpsp_ros.mpsp.jit.compiled import allocation_free, inner
from cmpsp_ros.mpsp.jit.intrinsics import dot
from cmpsp_ros.mpsp.qp.active_set.basis import solve, split
from cmpsp_ros.mpsp.qp.active_set.farkas import bounds_cross, contradicts, name_rows
from cmpsp_ros.mpsp.qp.active_set.fixed_bounds import MANY, recover_bound_multipliers, release
from cmpsp_ros.mpsp.qp.active_set.state import (
    TOLERANCE,
    ActiveSet,
    RowState,
    add_constraint,
    iterative_refinement,
    remove_constraint,
    row_in_v,
)
from cmpsp_ros.mpsp.qp.riccati.program import (
    Program,
    clear_multipliers,
    is_bound,
    limit,
    load_row,
    product,
    row_value,
    row_value_at_origin,
    set_multiplier,
)
from cmpsp_ros.mpsp.qp.riccati.sweeps import recover_step, row_norm


class StepOutcome(IntEnum):
    """End of an active-set step, or of many of them."""

    DONE = 0  # the row is met
    CONTRADICTION = 1  # it contradicts the others
    FULL = 2  # there is no room or work left
    RELEASED = 3  # bounds that are held stood in its way and are held no longer
    CROWDED = 4  # so many bounds have become active that they are better held


# Coefficients of a dependence below this, relative to the largest, are rounding.
NEGLIGIBLE = 1e-12
# A row that depends on others is implied by them, not in contradiction, up to this violation,
# relative as `TOLERANCE` is. The check of the answer has the last word.
_ROUNDING = 1e-8
# Multipliers of held bounds below this, relative to the largest, are 0 in a combination of rows.
_NO_DIRECTION = 1e-9


@allocation_free
def active_set_step(p: Program, at: ActiveSet, row: int) -> StepOutcome:
    """Move along one row's multiplier until the row is met or its multiplier is at an end."""
    head = p.head[0]
    length = row_in_v(p, row, at.row)
    bound, upper = limit(p, row)
    excess = dot(at.row, at.v, length) + row_value_at_origin(p, row) - bound
    is_equality = row < p.terminal.shape[0]
    state, multiplier = at.states[row], 0.0
    sign = 1.0 if excess >= 0.0 else -1.0
    if state == RowState.AT_PENALTY:
        multiplier = upper
    elif state == RowState.AT_MINUS_PENALTY:
        multiplier = -upper
    elif not is_equality and excess <= TOLERANCE * (1.0 + abs(bound)):
        return StepOutcome.DONE
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
                return StepOutcome.FULL
            head.saturated -= int(state > RowState.ACTIVE)
            add_constraint(p, at, row, multiplier, upper, sign)
            return StepOutcome.DONE
        if step == to_end:
            rest += _release(p, at, first)
        else:
            # Its own multiplier came to an end first.
            ended = RowState.AT_MINUS_PENALTY if is_equality else RowState.OFF
            at.states[row] = RowState.AT_PENALTY if sign > 0.0 else ended
            head.saturated += int(at.states[row] > RowState.ACTIVE) - int(state > RowState.ACTIVE)
            return StepOutcome.DONE
    return StepOutcome.FULL


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

    Returns the squared gain, outside the span of the others, of the row being added.
    """
    head, row = p.head[0], at.rows[index]
    if at.dependence[index] < 0.0:
        at.states[row] = RowState.AT_PENALTY
    else:
        at.states[row] = RowState.AT_MINUS_PENALTY if row < p.terminal.shape[0] else RowState.OFF
    head.saturated += int(at.states[row] != RowState.OFF)
    if head.implied > 0:
        # Rows that the active ones implied may be implied no longer.
        head.implied = 0
        for other in range(at.states.shape[0]):
            if at.states[other] == RowState.IMPLIED:
                at.states[other] = RowState.OFF
    for j in range(index, head.active - 1):
        at.multipliers[j] = at.multipliers[j + 1]
    return remove_constraint(p, at, index, at.inside, at.outside)


@inner
def _judge(p: Program, at: ActiveSet, row: int, sign: float, multiplier: float) -> StepOutcome:
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
        return StepOutcome.CONTRADICTION
    if head.fixed > 0 and release(p, _NO_DIRECTION * largest) > 0:
        return StepOutcome.RELEASED
    # Its increase goes to their multipliers, since the row is a combination of them.
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
        return StepOutcome.CONTRADICTION
    at.states[row] = RowState.IMPLIED
    head.implied += 1
    return StepOutcome.DONE


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


@allocation_free
def add_violated_rows(p: Program, at: ActiveSet, may_crowd: bool) -> StepOutcome:
    """Meet one violated row after the other, from where the method has begun.

    With `may_crowd` it stops where many bounds have become active.
    """
    head, bounds = p.head[0], 0
    outcome, looked_at, recovered_at = StepOutcome.DONE, -1, head.iterations
    while outcome == StepOutcome.DONE:
        row = _furthest(at)
        if row < 0:
            # A row found again without an iteration is violated by rounding alone.
            if head.iterations == looked_at:
                break
            if head.iterations != recovered_at:
                recover_step(p, at.v)
            looked_at = recovered_at = head.iterations
            if not _find_violated(p, at):
                break
            row = _furthest(at)
        outcome = active_set_step(p, at, row)
        if outcome == StepOutcome.DONE and may_crowd and is_bound(p, row):
            bounds += 1
            if bounds > MANY and 2 * _bounds_in_basis(p, at) > head.active:
                return StepOutcome.CROWDED
    if outcome == StepOutcome.DONE:
        iterative_refinement(p, at)
    return outcome


@inner
def _bounds_in_basis(p: Program, at: ActiveSet) -> int:
    count = 0
    for j in range(p.head[0].active):
        count += int(is_bound(p, at.rows[j]))
    return count


@inner
def _find_violated(p: Program, at: ActiveSet) -> bool:
    """Find the row of each kind that is furthest from being met; returns whether there is any.

    For a row at its penalty the same is asked of its being violated. The rows that differ only in
    their stage are one kind: mostly, the worst of each is needed, and one look at all of them
    costs as much as meeting a few.
    """
    head = p.head[0]
    n, r = p.stages[0].B.shape
    terminal, path = p.terminal.shape[0], p.path.shape[1]
    states, saturated, found = at.states, head.saturated > 0, False
    at.distances[:] = 0.0
    head.work += head.horizon + 1
    if saturated:
        for row in range(terminal):
            excess = product(p.terminal[row], p.stages[head.horizon]) + p.terminal[row].value
            if states[row] == RowState.AT_PENALTY:
                excess = -excess
            if states[row] >= RowState.AT_PENALTY and excess > TOLERANCE:
                kind = path + r + n + row
                found = _note(p, at, kind, row, excess, p.terminal[row].value) or found
    row = terminal
    for k in range(head.horizon + 1):
        stage = p.stages[k]
        for j in range(path):
            constraint = p.path[k, j]
            excess = constraint.value + product(constraint, stage)
            if saturated and states[row] == RowState.AT_PENALTY:
                excess = -excess
            if excess > TOLERANCE and states[row] != RowState.ACTIVE:
                found = _note(p, at, j, row, excess, constraint.value) or found
            row += 1
        for a in range(r):
            above, below = stage.dU[a] - stage.upper[a], stage.lower[a] - stage.dU[a]
            if above > TOLERANCE and states[row] == RowState.OFF:
                found = _note(p, at, path + a, row, above, stage.upper[a]) or found
            if below > TOLERANCE and states[row + 1] == RowState.OFF:
                found = _note(p, at, path + a, row + 1, below, stage.lower[a]) or found
            row += 2
        for i in range(n):
            excess = abs(stage.dX[i]) - head.trust_radius[i]
            if excess > TOLERANCE:
                side = row if stage.dX[i] > 0.0 else row + 1
                if states[side] == RowState.OFF:
                    kind = path + r + i
                    found = _note(p, at, kind, side, excess, head.trust_radius[i]) or found
            row += 2
    return found


@inner
def _note(p: Program, at: ActiveSet, kind: int, row: int, excess: float, bound: float) -> bool:
    """Keep a row, if it is violated and further away than any other of its kind."""
    if excess <= TOLERANCE * (1.0 + abs(bound)) or at.states[row] == RowState.IMPLIED:
        return False
    if at.norms[row] == 0.0:
        at.norms[row] = row_norm(p, load_row(p, row))
    # A row that nothing moves comes first: it contradicts itself.
    far = excess / at.norms[row] if at.norms[row] > 0.0 else math.inf
    if far > at.distances[kind]:
        at.distances[kind] = far
        at.furthest[kind] = row
    return True


@inner
def _furthest(at: ActiveSet) -> Any:
    """Take out the furthest of the rows that were kept; -1 where none is left."""
    best = 0
    for kind in range(1, at.distances.shape[0]):
        if at.distances[kind] > at.distances[best]:
            best = kind
    if at.distances[best] == 0.0:
        return -1
    at.distances[best] = 0.0
    return at.furthest[best]
