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
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cmpsp_ros.mpsp.compiled import allocation_free
from cmpsp_ros.mpsp.problem import Array
from cmpsp_ros.mpsp.riccati.basis import (
    Basis,
    append,
    basis,
    dot,
    remove,
    solve,
    solve_transposed,
    split,
)
from cmpsp_ros.mpsp.riccati.outcome import INFEASIBLE, ITERATION_LIMIT, SOLVED
from cmpsp_ros.mpsp.riccati.rows import (
    BOUND,
    PATH,
    limit_of,
    place_of,
    value_of,
    white_length,
    white_row,
)
from cmpsp_ros.mpsp.riccati.size import dimension
from cmpsp_ros.mpsp.riccati.stage_qp import Multipliers, Penalty, StageQP
from cmpsp_ros.mpsp.riccati.whitening import Whitening, spread, unwhiten

Indices = NDArray[np.int64]

TOLERANCE = 1e-11
"""Violation up to which a row counts as met, relative to 1 plus its right-hand side."""

# States of a row.
_OFF, _ACTIVE, _AT_PENALTY, _AT_MINUS_PENALTY, _IMPLIED = 0, 1, 2, 3, 4
# Coefficients of a dependence below this, relative to the largest, are rounding.
_NO_PART = 1e-12
# A row that depends on others is implied by them, not in contradiction, up to this violation,
# relative as `TOLERANCE` is. The check of the answer has the last word.
_ROUNDING = 1e-8
# Rows off by more than this, relative to 1 plus their right-hand side, are sharpened at the end.
_BLUNT = 1e-12
# After so many steps the point is found again from the multipliers: rounding has added up.
_MANY = 64
# Outcomes of the attempt to meet one row.
_DONE, _CONTRADICTION, _FULL = 0, 1, 2

ITERATIONS, ACTIVE, SATURATED, IMPLIED, CONFLICT, SPREAD = 0, 1, 2, 3, 4, 5
"""Places in `ActiveSet.counts`."""


class Hint(NamedTuple):
    """Where a program's solution ended, for the next one like it.

    Attributes:
        length: How many rows are in it, shape ``(1,)``.
        rows: Numbers of the rows that were active, in the order in which they became so, and
            ``-1 - number`` of those that were at their (upper) penalty; shape ``(rows,)``.
    """

    length: Indices
    rows: Indices


class ActiveSet(NamedTuple):
    """State of the method and room for its vectors.

    Attributes:
        counts: Iterations done, rows active, rows at their penalty, rows implied by the active
            ones, rows in `conflict`, and whether lengths of rows were needed; shape ``(6,)``.
        v: The point, shape ``(q,)``.
        basis: Of the active rows.
        rows: Numbers of the active rows, shape ``(M,)``.
        multipliers: Theirs, shape ``(M,)``.
        states: State of every row, shape ``(rows,)``.
        lengths: Length of every row in ``v``, 0 where it was not asked for yet; shape ``(rows,)``.
        distances: How far away in ``v`` the furthest violated row of each kind begins to be met,
            shape ``(kinds,)``.
        furthest: Which it is, shape ``(kinds,)``.
        conflict: Rows that contradict each other, where infeasible; shape ``(M + 1,)``.
        row: Scratch, shape ``(q,)``.
        inside: Scratch, shape ``(M,)``.
        outside: Scratch, shape ``(q,)``.
        dependence: Scratch, shape ``(M,)``.
    """

    counts: Indices
    v: Array
    basis: Basis
    rows: Indices
    multipliers: Array
    states: Indices
    lengths: Array
    distances: Array
    furthest: Indices
    conflict: Indices
    row: Array
    inside: Array
    outside: Array
    dependence: Array


def no_hint(N: int, n: int, r: int, m: int, l: int) -> Hint:  # noqa: E741
    """Room for a hint of programs of these sizes, with nothing in it."""
    return Hint(np.zeros(1, np.int64), np.zeros(m + (N + 1) * (l + 2 * r + 2 * n), np.int64))


def active_set(N: int, n: int, r: int, m: int, l: int, capacity: int) -> ActiveSet:  # noqa: E741
    """Room for programs of these sizes with so many active rows at most."""
    q = (N + 1) * r
    rows = m + (N + 1) * (l + 2 * r + 2 * n)
    M = min(q, capacity)
    return ActiveSet(
        counts=np.zeros(6, np.int64),
        v=np.zeros(q),
        basis=basis(M, q),
        rows=np.zeros(M, np.int64),
        multipliers=np.zeros(M),
        states=np.zeros(rows, np.int64),
        lengths=np.zeros(rows),
        distances=np.zeros(l + r + n + m),
        furthest=np.zeros(l + r + n + m, np.int64),
        conflict=np.zeros(M + 1, np.int64),
        row=np.zeros(q),
        inside=np.zeros(M),
        outside=np.zeros(q),
        dependence=np.zeros(M),
    )


@allocation_free
def shift_hint(hint: Hint, terminal: int, stage: int, last: int) -> None:
    """Move a hint to a horizon that begins later.

    Args:
        hint: The hint.
        terminal: How many terminal rows there are.
        stage: How many rows each stage has, times the stages that are over.
        last: How many rows there are on the new horizon.
    """
    kept = 0
    for i in range(hint.length[0]):
        row, saturated = hint.rows[i], hint.rows[i] < 0
        if saturated:
            row = -1 - row
        if row >= terminal:
            row -= stage
            if not terminal <= row < last:
                continue
        hint.rows[kept] = -1 - row if saturated else row
        kept += 1
    hint.length[0] = kept


@allocation_free
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
    _begin(qp, penalty, white, at, hint)
    outcome = _DONE
    for row in range(qp.output_error.shape[0]):
        if outcome == _DONE and at.states[row] == _OFF:
            outcome = _meet(qp, penalty, white, at, row, limit, dU, dX)
    for i in range(hint.length[0]):
        row = hint.rows[i]
        known = 0 <= row < at.states.shape[0]
        if outcome == _DONE and known and at.states[row] == _OFF:
            outcome = _meet(qp, penalty, white, at, row, limit, dU, dX)
    while outcome == _DONE:
        unwhiten(qp, white, at.v, dU, dX)
        if not _find_violated(qp, white, at, dU, dX):
            if at.counts[ITERATIONS] > _MANY:
                _retrace(qp, penalty, white, at)
                unwhiten(qp, white, at.v, dU, dX)
            _sharpen(qp, penalty, white, at, dU, dX)
            break
        row = _furthest(at)
        while outcome == _DONE and row >= 0:
            outcome = _meet(qp, penalty, white, at, row, limit, dU, dX)
            row = _furthest(at)
    _leave_hint(at, hint)
    if outcome == _CONTRADICTION:
        return INFEASIBLE
    if outcome == _FULL:
        return ITERATION_LIMIT
    _fill(qp, penalty, at, multipliers)
    return SOLVED


@allocation_free
def _begin(qp: StageQP, penalty: Penalty, white: Whitening, at: ActiveSet, hint: Hint) -> None:
    """The minimum without any row, except those that the hint has at their penalty."""
    at.counts[:] = 0
    at.states[:] = _OFF
    at.lengths[:] = 0.0
    for i in range(at.v.shape[0]):
        at.v[i] = white.optimum[i]
    for i in range(hint.length[0]):
        row = -1 - hint.rows[i]
        if not 0 <= row < at.states.shape[0] or at.states[row] != _OFF:
            continue
        bound, most = limit_of(qp, penalty, row)
        # A row that is hard now is met like any other; one that does not apply has no multiplier.
        if math.inf in (bound, most):
            continue
        _pull(qp, white, at, row, most)
        at.states[row] = _AT_PENALTY
        at.counts[SATURATED] += 1


@allocation_free
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
            if states[row] == _AT_PENALTY:
                excess = -excess
            wanted = TOLERANCE * (1.0 + abs(qp.output_error[row]))
            if states[row] >= _AT_PENALTY and excess > wanted:
                found = _note(qp, white, at, path + r + n + row, row, excess) or found
    row = terminal
    for k in range(qp.g.shape[0]):
        for j in range(path):
            excess = qp.g[k, j]
            for i in range(n):
                excess += qp.g_X[k, j, i] * dX[k, i]
            for a in range(r):
                excess += qp.g_U[k, j, a] * dU[k, a]
            if saturated and states[row] == _AT_PENALTY:
                excess = -excess
            if excess > TOLERANCE * (1.0 + abs(qp.g[k, j])) and states[row] != _ACTIVE:
                found = _note(qp, white, at, j, row, excess) or found
            row += 1
        for a in range(r):
            above, below = dU[k, a] - qp.upper[k, a], qp.lower[k, a] - dU[k, a]
            if above > TOLERANCE * (1.0 + abs(qp.upper[k, a])) and states[row] == _OFF:
                found = _note(qp, white, at, path + a, row, above) or found
            if below > TOLERANCE * (1.0 + abs(qp.lower[k, a])) and states[row + 1] == _OFF:
                found = _note(qp, white, at, path + a, row + 1, below) or found
            row += 2
        for i in range(n):
            excess = abs(dX[k, i]) - qp.trust_radius[i]
            if excess > TOLERANCE * (1.0 + qp.trust_radius[i]):
                side = row if dX[k, i] > 0.0 else row + 1
                if states[side] == _OFF:
                    found = _note(qp, white, at, path + r + i, side, excess) or found
            row += 2
    return found


@allocation_free
def _note(qp: StageQP, white: Whitening, at: ActiveSet, kind: int, row: int, excess: float) -> bool:
    """Keep a violated row if it is further away than any other of its kind."""
    far = _distance(qp, white, at, row, excess)
    if far > at.distances[kind]:
        at.distances[kind] = far
        at.furthest[kind] = row
    return far > 0.0


@allocation_free
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
    if at.states[row] == _IMPLIED:
        return 0.0
    if at.lengths[row] == 0.0:
        if at.counts[SPREAD] == 0:
            spread(qp, white)
            at.counts[SPREAD] = 1
        at.lengths[row] = white_length(qp, white, row)
    return excess / at.lengths[row] if at.lengths[row] > 0.0 else math.inf


@allocation_free
def _meet(
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
    if state == _AT_PENALTY:
        multiplier = most
    elif state == _AT_MINUS_PENALTY:
        multiplier = -most
    elif not is_equality and excess <= TOLERANCE * (1.0 + abs(bound)):
        return _DONE
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
        to_end, first = _first_to_leave(qp, penalty, at)
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
            return _add(at, row, multiplier, sign)
        if step == to_end:
            rest += _release(at, first, at.rows[first] < qp.output_error.shape[0])
        else:
            _rest_at_end(at, row, state, sign, is_equality)
            return _DONE
    return _FULL


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

    Rounding of the active rows would look like a contradiction: it is taken out first.
    """
    _name_conflict(at, row)
    # What was added to its multiplier is theirs, since the row is a combination of them.
    for j in range(at.counts[ACTIVE]):
        at.multipliers[j] += sign * multiplier * at.dependence[j]
    bound, _ = limit_of(qp, penalty, row)
    size = _size_of_dependence(qp, penalty, at)
    rounding = max(_ROUNDING * (1.0 + abs(bound)), TOLERANCE * size)
    unwhiten(qp, white, at.v, dU, dX)
    _sharpen(qp, penalty, white, at, dU, dX)
    if sign * (value_of(qp, row, dU, dX) - bound) > rounding:
        return _CONTRADICTION
    at.states[row] = _IMPLIED
    at.counts[IMPLIED] += 1
    return _DONE


@allocation_free
def _size_of_dependence(qp: StageQP, penalty: Penalty, at: ActiveSet) -> float:
    """What the excess of a row that depends on the active ones is rounded relative to."""
    total = 0.0
    for j in range(at.counts[ACTIVE]):
        of_row, _ = limit_of(qp, penalty, at.rows[j])
        total += abs(at.dependence[j]) * (1.0 + abs(of_row))
    return total


@allocation_free
def _first_to_leave(qp: StageQP, penalty: Penalty, at: ActiveSet) -> Any:
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
        row = at.rows[j]
        _, most = limit_of(qp, penalty, row)
        least = -most if row < qp.output_error.shape[0] else 0.0
        room = at.multipliers[j] - least if rate > 0.0 else most - at.multipliers[j]
        step = max(room, 0.0) / abs(rate)
        if step < nearest:
            nearest, first = step, j
    return nearest, first


@allocation_free
def _add(at: ActiveSet, row: int, multiplier: float, sign: float) -> int:
    count = at.counts[ACTIVE]
    if count == at.rows.shape[0]:
        return _FULL
    append(at.basis, count, at.inside, at.outside, sign)
    at.rows[count] = row
    at.multipliers[count] = multiplier
    if at.states[row] > _ACTIVE:
        at.counts[SATURATED] -= 1
    at.states[row] = _ACTIVE
    at.counts[ACTIVE] += 1
    return _DONE


@allocation_free
def _release(at: ActiveSet, index: int, row_is_equality: bool) -> float:
    """Take a row whose multiplier is at an end out of the active set.

    Returns:
        What the row being met gains outside the span of the others, squared.
    """
    count, row = at.counts[ACTIVE], at.rows[index]
    if at.dependence[index] < 0.0:
        at.states[row] = _AT_PENALTY
    else:
        at.states[row] = _AT_MINUS_PENALTY if row_is_equality else _OFF
    at.counts[SATURATED] += int(at.states[row] != _OFF)
    if at.counts[IMPLIED] > 0:
        # What the active rows implied they may imply no longer.
        at.counts[IMPLIED] = 0
        for other in range(at.states.shape[0]):
            if at.states[other] == _IMPLIED:
                at.states[other] = _OFF
    for j in range(index, count - 1):
        at.rows[j] = at.rows[j + 1]
        at.multipliers[j] = at.multipliers[j + 1]
    at.counts[ACTIVE] -= 1
    return remove(at.basis, count, index, at.inside, at.outside)


@allocation_free
def _rest_at_end(
    at: ActiveSet,
    row: int,
    state: int,
    sign: float,
    is_equality: bool,
) -> None:
    """Leave a row whose own multiplier came to an end first."""
    if is_equality:
        at.states[row] = _AT_PENALTY if sign > 0.0 else _AT_MINUS_PENALTY
    else:
        at.states[row] = _AT_PENALTY if sign > 0.0 else _OFF
    at.counts[SATURATED] += int(at.states[row] > _ACTIVE) - int(state > _ACTIVE)


@allocation_free
def _retrace(qp: StageQP, penalty: Penalty, white: Whitening, at: ActiveSet) -> None:
    """``v`` from the multipliers, without the rounding of the way to it."""
    for i in range(at.v.shape[0]):
        at.v[i] = white.optimum[i]
    for j in range(at.counts[ACTIVE]):
        _pull(qp, white, at, at.rows[j], at.multipliers[j])
    if at.counts[SATURATED] > 0:
        for row in range(at.states.shape[0]):
            if at.states[row] == _AT_PENALTY:
                _pull(qp, white, at, row, limit_of(qp, penalty, row)[1])
            elif at.states[row] == _AT_MINUS_PENALTY:
                _pull(qp, white, at, row, -limit_of(qp, penalty, row)[1])


@allocation_free
def _pull(qp: StageQP, white: Whitening, at: ActiveSet, row: int, multiplier: float) -> None:
    for i in range(white_row(qp, white, row, at.row)):
        at.v[i] -= multiplier * at.row[i]


@allocation_free
def _sharpen(
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
def _fill(qp: StageQP, penalty: Penalty, at: ActiveSet, multipliers: Multipliers) -> None:
    """Write the multipliers of all rows where they belong."""
    multipliers.terminal[:] = 0.0
    multipliers.path[:] = 0.0
    multipliers.trust[:] = 0.0
    multipliers.bounds[:] = 0.0
    for j in range(at.counts[ACTIVE]):
        row = at.rows[j]
        _, most = limit_of(qp, penalty, row)
        least = -most if row < qp.output_error.shape[0] else 0.0
        _put(qp, row, min(max(at.multipliers[j], least), most), multipliers)
    if at.counts[SATURATED] > 0:
        for row in range(at.states.shape[0]):
            if at.states[row] == _AT_PENALTY:
                _put(qp, row, limit_of(qp, penalty, row)[1], multipliers)
            elif at.states[row] == _AT_MINUS_PENALTY:
                _put(qp, row, -limit_of(qp, penalty, row)[1], multipliers)


@allocation_free
def _put(qp: StageQP, row: int, multiplier: float, multipliers: Multipliers) -> None:
    if row < qp.output_error.shape[0]:
        multipliers.terminal[row] = multiplier
        return
    place = place_of(qp, row)
    if place.kind == PATH:
        multipliers.path[place.stage, place.component] = multiplier
    elif place.kind == BOUND:
        multipliers.bounds[place.stage, place.component] += place.sign * multiplier
    else:
        multipliers.trust[place.stage, place.component] += place.sign * multiplier


@allocation_free
def _leave_hint(at: ActiveSet, hint: Hint) -> None:
    found = 0
    for j in range(at.counts[ACTIVE]):
        hint.rows[found] = at.rows[j]
        found += 1
    if at.counts[SATURATED] > 0:
        for row in range(at.states.shape[0]):
            if at.states[row] == _AT_PENALTY:
                hint.rows[found] = -1 - row
                found += 1
    hint.length[0] = found


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
