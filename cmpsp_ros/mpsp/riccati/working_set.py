"""What the active-set method knows while it is at work, and what it leaves for the next program."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cmpsp_ros.mpsp.jit.compiled import allocation_free, inlined
from cmpsp_ros.mpsp.problem import Array
from cmpsp_ros.mpsp.riccati.basis import Basis, append, basis, remove

Indices = NDArray[np.int64]

TOLERANCE = 1e-11
"""Violation up to which a row counts as met, relative to 1 plus its right-hand side."""

IS_OFF, IS_ACTIVE, AT_PENALTY, AT_MINUS_PENALTY, IS_IMPLIED = 0, 1, 2, 3, 4
"""States of a row; the last one is of a row that the active ones imply."""

ITERATIONS, ACTIVE, SATURATED, IMPLIED, CONFLICT, SPREAD, PROVED = 0, 1, 2, 3, 4, 5, 6
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
            ones, rows in `conflict`, whether lengths of rows were needed, and whether the conflict
            is proved; shape ``(7,)``.
        v: The point, shape ``(q,)``.
        basis: Of the active rows.
        rows: Numbers of the active rows, shape ``(M,)``.
        multipliers: Theirs, shape ``(M,)``.
        most: Their largest multipliers, infinite for hard rows; shape ``(M,)``.
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
    most: Array
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
        counts=np.zeros(7, np.int64),
        v=np.zeros(q),
        basis=basis(M, q),
        rows=np.zeros(M, np.int64),
        multipliers=np.zeros(M),
        most=np.zeros(M),
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


@inlined
def take_in(at: ActiveSet, row: int, multiplier: float, most: float, sign: float) -> None:
    """Make a row active.

    Args:
        at: There is room in it; `inside` and `outside` are the row's `split`, times the sign.
        row: Its number.
        multiplier: Its multiplier.
        most: Its largest one.
        sign: 1 or -1.
    """
    count = at.counts[ACTIVE]
    append(at.basis, count, at.inside, at.outside, sign)
    at.rows[count] = row
    at.multipliers[count] = multiplier
    at.most[count] = most
    at.states[row] = IS_ACTIVE
    at.counts[ACTIVE] += 1


@allocation_free
def take_out(at: ActiveSet, index: int, inside: Array, outside: Array) -> float:
    """Take a row out of the active ones. Its state, and the multipliers, are the caller's affair.

    The `split` of another row is kept up to date; returns what the square of its rest gains.
    """
    count = at.counts[ACTIVE]
    for j in range(index, count - 1):
        at.rows[j] = at.rows[j + 1]
        at.most[j] = at.most[j + 1]
    at.counts[ACTIVE] -= 1
    return remove(at.basis, count, index, inside, outside)


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
