"""State of the active-set method, the warm start it leaves, and iterative refinement."""

from __future__ import annotations

from enum import IntEnum
from typing import NamedTuple

import numpy as np

from cmpsp_ros.arrays import Array, IntArray
from cmpsp_ros.mpsp.jit.compiled import allocation_free
from cmpsp_ros.mpsp.qp.active_set.basis import Basis, append, remove, solve, solve_transposed
from cmpsp_ros.mpsp.qp.riccati.program import (
    Program,
    Records,
    count_rows,
    limit,
    load_row,
    row_value,
)
from cmpsp_ros.mpsp.qp.riccati.sweeps import recover_step, transform_row

Indices = IntArray

CAPACITY = 400  # largest number of rows in the basis; bounds that are held need none

# Violation up to which a row counts as met, relative to 1 plus its right-hand side.
TOLERANCE = 1e-11

# Rows off by more than this, relative to 1 plus their right-hand side, are refined.
_OFF = 1e-12

_PROOF = 16  # room for the rows of a proof in a warm start; longer ones are not kept


class RowState(IntEnum):
    """State of a row; `IMPLIED` is one that depends on the active ones and agrees with them."""

    OFF = 0
    ACTIVE = 1
    AT_PENALTY = 2
    AT_MINUS_PENALTY = 3
    IMPLIED = 4


class WarmStart(NamedTuple):
    """Rows that a solution leaves for the next program like it."""

    # One record: numbers of `rows` and of rows in the `proof`, and the `begun` of their program's
    # head.
    head: Records
    rows: Records  # `row` and `state` of each, active ones in the order in which they became so
    proof: Records  # `row` and `multiplier` of rows that contradict each other (see `farkas`)

    @property
    def size(self) -> int:
        """Number of rows in it."""
        return int(self.head['rows'][0])

    def clear(self) -> None:
        """Begin without anything that is known."""
        self.head['rows'] = 0

    def copy(self) -> WarmStart:
        """The same in memory of its own."""
        return WarmStart(*(each.copy() for each in self))


class ActiveSet(NamedTuple):
    """State of the method and room for its vectors; counters are in the program's head.

    `v` is the point ``(q,)``. Of the active rows there are `basis`, the numbers `rows`,
    `multipliers` and their largest values `upper`, infinite for hard rows, all ``(M,)``. Every row
    has a `states` entry, and its length in ``v`` in `norms`, 0 where it was not asked for yet.
    `furthest` is the violated row of each kind that is furthest away in ``v``, and `distances` says
    how far. `conflict` names rows that contradict each other. The rest is scratch.
    """

    v: Array
    basis: Basis
    rows: Indices
    multipliers: Array
    upper: Array
    states: Indices
    norms: Array
    distances: Array
    furthest: Indices
    conflict: Indices
    row: Array
    outside: Array
    inside: Array
    dependence: Array


def empty_active_set(N: int, n: int, r: int, m: int, l: int) -> ActiveSet:  # noqa: E741
    """Memory for programs of these sizes."""
    q, rows = (N + 1) * r, m + (N + 1) * (l + 2 * r + 2 * n)
    M, kinds = min(q, CAPACITY), l + r + n + m
    return ActiveSet(
        v=np.zeros(q),
        basis=Basis(np.zeros((M, q)), np.zeros((M, M))),
        rows=np.zeros(M, np.int64),
        multipliers=np.zeros(M),
        upper=np.zeros(M),
        states=np.zeros(rows, np.int64),
        norms=np.zeros(rows),
        distances=np.zeros(kinds),
        furthest=np.zeros(kinds, np.int64),
        conflict=np.zeros(rows, np.int64),
        row=np.zeros(q),
        outside=np.zeros(q),
        inside=np.zeros(M),
        dependence=np.zeros(M),
    )


def empty_warm_start(N: int, n: int, r: int, m: int, l: int) -> WarmStart:  # noqa: E741
    """Memory for a warm start of programs of these sizes, with nothing in it."""
    count = m + (N + 1) * (l + 2 * r + 2 * n)
    return WarmStart(
        np.zeros(1, [('rows', np.int64), ('proof', np.int64), ('begun', np.int64)]),
        np.zeros(count, [('row', np.int64), ('state', np.int64)]),
        np.zeros(_PROOF, [('row', np.int64), ('multiplier', np.float64)]),
    )


@allocation_free
def on_horizon(p: Program, whole: ActiveSet) -> ActiveSet:
    """The part of an active set that the present horizon needs."""
    q, rows = (p.head[0].horizon + 1) * p.stages[0].B.shape[1], count_rows(p)
    return ActiveSet(
        whole.v[:q],
        whole.basis,
        whole.rows,
        whole.multipliers,
        whole.upper,
        whole.states[:rows],
        whole.norms[:rows],
        whole.distances,
        whole.furthest,
        whole.conflict,
        whole.row[:q],
        whole.outside[:q],
        whole.inside,
        whole.dependence,
    )


@allocation_free
def add_constraint(
    p: Program, at: ActiveSet, row: int, multiplier: float, upper: float, sign: float
) -> None:
    """Make a row active; `inside` and `outside` are its `split`, times the sign."""
    head = p.head[0]
    count = head.active
    append(at.basis, count, at.inside, at.outside, sign)
    at.rows[count] = row
    at.multipliers[count] = multiplier
    at.upper[count] = upper
    at.states[row] = RowState.ACTIVE
    head.active += 1


@allocation_free
def remove_constraint(
    p: Program, at: ActiveSet, index: int, inside: Array, outside: Array
) -> float:
    """Take a row out of the active ones. Its state, and the multipliers, are left to the caller.

    The `split` of another row is kept up to date; returns the gain of its squared rest.
    """
    head = p.head[0]
    count = head.active
    for j in range(index, count - 1):
        at.rows[j] = at.rows[j + 1]
        at.upper[j] = at.upper[j + 1]
    head.active -= 1
    head.work += 1 + (count - index) * at.v.shape[0] // 8
    return remove(at.basis, count, index, inside, outside)


@allocation_free
def row_in_v(p: Program, row: int, out: Array) -> int:
    """A row in the variables of the factorisation; returns how many entries may be other than 0."""
    return transform_row(p, load_row(p, row), out)


@allocation_free
def apply_multiplier(p: Program, at: ActiveSet, row: int, multiplier: float) -> None:
    """Move the point by a multiplier of one row; `ActiveSet.row` holds the row afterwards."""
    for i in range(row_in_v(p, row, at.row)):
        at.v[i] -= multiplier * at.row[i]


@allocation_free
def saturated_multiplier(p: Program, at: ActiveSet, row: int) -> float:
    """Multiplier of a row that is not in the basis: 0 unless it is at its penalty."""
    if at.states[row] == RowState.AT_PENALTY:
        return limit(p, row)[1]
    return -limit(p, row)[1] if at.states[row] == RowState.AT_MINUS_PENALTY else 0.0


@allocation_free
def iterative_refinement(p: Program, at: ActiveSet) -> None:
    """Take rounding out of the active rows: one step of iterative refinement."""
    count, is_off = p.head[0].active, False
    for j in range(count):
        bound, _ = limit(p, at.rows[j])
        at.inside[j] = row_value(p, at.rows[j]) - bound
        is_off = is_off or abs(at.inside[j]) > _OFF * (1.0 + abs(bound))
    if not is_off:
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
    recover_step(p, at.v)
