"""Meeting one violated row: the step of the dual active-set method."""

from __future__ import annotations

import math
from typing import Any

from cmpsp_ros.mpsp.jit.compiled import allocation_free, inlined
from cmpsp_ros.mpsp.problem import Array
from cmpsp_ros.mpsp.riccati.basis import solve, split
from cmpsp_ros.mpsp.riccati.inner_product import dot
from cmpsp_ros.mpsp.riccati.refinement import sharpen
from cmpsp_ros.mpsp.riccati.rows import limit_of, value_of, white_row
from cmpsp_ros.mpsp.riccati.stage_qp import Penalty, StageQP
from cmpsp_ros.mpsp.riccati.whitening import Whitening, unwhiten
from cmpsp_ros.mpsp.riccati.working_set import (
    ACTIVE,
    AT_MINUS_PENALTY,
    AT_PENALTY,
    CONFLICT,
    IMPLIED,
    IS_ACTIVE,
    IS_IMPLIED,
    IS_OFF,
    ITERATIONS,
    PROVED,
    SATURATED,
    TOLERANCE,
    ActiveSet,
    take_in,
    take_out,
)

DONE, CONTRADICTION, FULL = 0, 1, 2
"""Outcomes of the attempt to meet a row; the last one is that of a method out of room or time."""

# Coefficients of a dependence below this, relative to the largest, are rounding.
_NO_PART = 1e-12
# A row that depends on others is implied by them, not in contradiction, up to this violation,
# relative as `TOLERANCE` is. The check of the answer has the last word.
_ROUNDING = 1e-8
# A contradiction is proved for all points no farther from the one found than so many times 1 plus
# its length.
_FARTHEST = 1e6


@inlined
def meet(
    qp: StageQP,
    penalty: Penalty,
    white: Whitening,
    at: ActiveSet,
    row: int,
    limit: int,
    dU: Array,
    dX: Array,
) -> int:
    """Move along one row's multiplier until the row is met or its multiplier is at an end."""
    length = white_row(qp, white, row, at.row)
    bound, most = limit_of(qp, penalty, row)
    excess = dot(at.row, at.v, length) - bound
    is_equality = row < qp.output_error.shape[0]
    state, multiplier = at.states[row], 0.0
    sign = 1.0 if excess >= 0.0 else -1.0
    if state == AT_PENALTY:
        multiplier = most
    elif state == AT_MINUS_PENALTY:
        multiplier = -most
    elif not is_equality and excess <= TOLERANCE * (1.0 + abs(bound)):
        return DONE
    excess = abs(excess)
    # How far the multiplier may go before it is at its other end.
    room = multiplier if sign < 0.0 and not is_equality else most - sign * multiplier
    for i in range(length):
        at.row[i] *= sign
    rest = split(at.basis, at.counts[ACTIVE], at.row, length, at.inside, at.outside, at.dependence)
    while at.counts[ITERATIONS] < limit:
        at.counts[ITERATIONS] += 1
        count = at.counts[ACTIVE]
        if count == at.v.shape[0]:
            # As many rows as there are controls leave no room for another.
            rest = 0.0
        solve(at.basis, count, at.inside, at.dependence)
        to_row = excess / rest if rest > 0.0 else math.inf
        to_end, first = _first_to_leave(qp, at)
        step = min(to_row, room, to_end)
        if step == math.inf:
            return _judge(qp, penalty, white, at, row, sign, multiplier, dU, dX)
        if rest > 0.0:
            for i in range(at.v.shape[0]):
                at.v[i] -= step * at.outside[i]
            excess -= step * rest
        for j in range(count):
            at.multipliers[j] -= step * at.dependence[j]
        multiplier += sign * step
        room -= step
        if step == to_row:
            if count == at.rows.shape[0]:
                return FULL
            at.counts[SATURATED] -= int(state > IS_ACTIVE)
            take_in(at, row, multiplier, most, sign)
            return DONE
        if step == to_end:
            rest += _release(at, first, at.rows[first] < qp.output_error.shape[0])
        else:
            _rest_at_end(at, row, state, sign, is_equality)
            return DONE
    return FULL


@allocation_free
def _judge(
    qp: StageQP,
    penalty: Penalty,
    white: Whitening,
    at: ActiveSet,
    row: int,
    sign: float,
    multiplier: float,
    dU: Array,
    dX: Array,
) -> int:
    """Tell a row that contradicts the active ones from one that they imply.

    Rounding of the active rows would look like a contradiction: it is taken out first. The proof of
    one is that of Farkas: whatever meets the active rows exceeds this one by as much as the point
    does, but for the part of the row that is no combination of them.
    """
    _name_conflict(at, row)
    unlike = _part_of_its_own(qp, white, at, row, sign)
    # What was added to its multiplier is theirs, since the row is a combination of them.
    for j in range(at.counts[ACTIVE]):
        at.multipliers[j] += sign * multiplier * at.dependence[j]
    bound, _ = limit_of(qp, penalty, row)
    size = _size_of_dependence(qp, penalty, at)
    rounding = max(_ROUNDING * (1.0 + abs(bound)), TOLERANCE * size)
    unwhiten(qp, white, at.v, dU, dX)
    sharpen(qp, penalty, white, at, dU, dX)
    excess = sign * (value_of(qp, row, dU, dX) - bound)
    if excess > rounding:
        far = _FARTHEST * (1.0 + math.sqrt(dot(at.v, at.v, at.v.shape[0])))
        at.counts[PROVED] = int(excess > unlike * far)
        return CONTRADICTION
    at.states[row] = IS_IMPLIED
    at.counts[IMPLIED] += 1
    return DONE


@allocation_free
def _part_of_its_own(qp: StageQP, white: Whitening, at: ActiveSet, row: int, sign: float) -> float:
    """Length of a row times its sign without the combination of the rows in conflict with it."""
    own, named = at.outside, 1
    own[:] = 0.0
    for i in range(white_row(qp, white, row, at.row)):
        own[i] = sign * at.row[i]
    for j in range(at.counts[ACTIVE]):
        if named < at.counts[CONFLICT] and at.conflict[named] == at.rows[j]:
            named += 1
            for i in range(white_row(qp, white, at.rows[j], at.row)):
                own[i] -= at.dependence[j] * at.row[i]
    return math.sqrt(dot(own, own, own.shape[0]))


@allocation_free
def _size_of_dependence(qp: StageQP, penalty: Penalty, at: ActiveSet) -> float:
    """What the excess of a row that depends on the active ones is rounded relative to."""
    total = 0.0
    for j in range(at.counts[ACTIVE]):
        of_row, _ = limit_of(qp, penalty, at.rows[j])
        total += abs(at.dependence[j]) * (1.0 + abs(of_row))
    return total


@inlined
def _first_to_leave(qp: StageQP, at: ActiveSet) -> Any:
    """Step at which the first active multiplier comes to one of its ends, and which it is."""
    count = at.counts[ACTIVE]
    largest = 0.0
    for j in range(count):
        largest = max(largest, abs(at.dependence[j]))
    nearest, first = math.inf, -1
    for j in range(count):
        rate = at.dependence[j]
        if abs(rate) <= _NO_PART * largest:
            continue
        most = at.most[j]
        least = -most if at.rows[j] < qp.output_error.shape[0] else 0.0
        room = at.multipliers[j] - least if rate > 0.0 else most - at.multipliers[j]
        step = max(room, 0.0) / abs(rate)
        if step < nearest:
            nearest, first = step, j
    return nearest, first


@allocation_free
def _release(at: ActiveSet, index: int, row_is_equality: bool) -> float:
    """Take a row whose multiplier is at an end out of the active set.

    Returns:
        What the row being met gains outside the span of the others, squared.
    """
    row = at.rows[index]
    if at.dependence[index] < 0.0:
        at.states[row] = AT_PENALTY
    else:
        at.states[row] = AT_MINUS_PENALTY if row_is_equality else IS_OFF
    at.counts[SATURATED] += int(at.states[row] != IS_OFF)
    if at.counts[IMPLIED] > 0:
        # What the active rows implied they may imply no longer.
        at.counts[IMPLIED] = 0
        for other in range(at.states.shape[0]):
            if at.states[other] == IS_IMPLIED:
                at.states[other] = IS_OFF
    for j in range(index, at.counts[ACTIVE] - 1):
        at.multipliers[j] = at.multipliers[j + 1]
    return take_out(at, index, at.inside, at.outside)


@inlined
def _rest_at_end(
    at: ActiveSet,
    row: int,
    state: int,
    sign: float,
    is_equality: bool,
) -> None:
    """Leave a row whose own multiplier came to an end first."""
    if is_equality:
        at.states[row] = AT_PENALTY if sign > 0.0 else AT_MINUS_PENALTY
    else:
        at.states[row] = AT_PENALTY if sign > 0.0 else IS_OFF
    at.counts[SATURATED] += int(at.states[row] > IS_ACTIVE) - int(state > IS_ACTIVE)


@allocation_free
def _name_conflict(at: ActiveSet, row: int) -> None:
    """The rows whose combination, with multipliers that are not negative, nothing can meet."""
    largest, found = 0.0, 1
    at.conflict[0] = row
    for j in range(at.counts[ACTIVE]):
        largest = max(largest, abs(at.dependence[j]))
    for j in range(at.counts[ACTIVE]):
        if abs(at.dependence[j]) > _NO_PART * largest:
            at.conflict[found] = at.rows[j]
            found += 1
    at.counts[CONFLICT] = found
