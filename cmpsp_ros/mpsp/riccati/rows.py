"""Numbering of the constraint rows of a stage-wise program, and what each of them is.

First the terminal rows; then, for each stage, its path rows, upper and lower bound of each
control, and upper and lower limit of the trust region for each state.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

from cmpsp_ros.mpsp.jit.compiled import allocation_free, inlined
from cmpsp_ros.mpsp.problem import Array
from cmpsp_ros.mpsp.riccati.size import dimension
from cmpsp_ros.mpsp.riccati.stage_qp import Multipliers, Penalty, StageQP
from cmpsp_ros.mpsp.riccati.whitening import Whitening, row_length, whiten_row

PATH, BOUND, TRUST = 0, 1, 2


class Place(NamedTuple):
    """Where an inequality stands.

    Attributes:
        kind: `PATH`, `BOUND` or `TRUST`.
        stage: Its stage.
        component: Which path constraint, control or state.
        sign: -1 for a lower limit, else 1.
    """

    kind: int
    stage: int
    component: int
    sign: float


@allocation_free
def rows_a_stage(qp: StageQP) -> int:
    """How many inequalities each stage has."""
    return qp.g.shape[1] + 2 * dimension(qp.control) + 2 * dimension(qp.state)


@allocation_free
def count_rows(qp: StageQP) -> int:
    """How many rows there are."""
    return qp.output_error.shape[0] + qp.g.shape[0] * rows_a_stage(qp)


@inlined
def place_of(qp: StageQP, row: int) -> Place:
    """Where an inequality stands, by its number."""
    width, path = rows_a_stage(qp), qp.g.shape[1]
    k = (row - qp.output_error.shape[0]) // width
    i = (row - qp.output_error.shape[0]) % width
    if i < path:
        return Place(PATH, k, i, 1.0)
    i -= path
    if i < 2 * dimension(qp.control):
        return Place(BOUND, k, i // 2, 1.0 - 2.0 * (i % 2))
    i -= 2 * dimension(qp.control)
    return Place(TRUST, k, i // 2, 1.0 - 2.0 * (i % 2))


@allocation_free
def number_of(qp: StageQP, kind: int, stage: int, index: int) -> int:
    """Number of an inequality, of the upper one where there are two."""
    first = qp.output_error.shape[0] + stage * rows_a_stage(qp)
    if kind == PATH:
        return first + index
    if kind == BOUND:
        return first + qp.g.shape[1] + 2 * index
    return first + qp.g.shape[1] + 2 * dimension(qp.control) + 2 * index


@inlined
def limit_of(qp: StageQP, penalty: Penalty, row: int) -> Any:
    """Right-hand side of a row, and its largest multiplier."""
    terminal = qp.output_error.shape[0]
    if row < terminal:
        return -qp.output_error[row], penalty.terminal[row]
    place = place_of(qp, row)
    if place.kind == PATH:
        return -qp.g[place.stage, place.component], penalty.path[place.stage, place.component]
    if place.kind == BOUND:
        if place.sign > 0.0:
            return qp.upper[place.stage, place.component], math.inf
        return -qp.lower[place.stage, place.component], math.inf
    return qp.trust_radius[place.component], math.inf


@allocation_free
def white_row(qp: StageQP, white: Whitening, row: int, out: Array) -> int:
    """A row in the variables of the factorisation; returns how many entries may be other than 0."""
    return whiten_row(qp, white, load_row(qp, white, row), out)


@allocation_free
def white_length(qp: StageQP, white: Whitening, row: int) -> float:
    """Length of a row in the variables of the factorisation."""
    return row_length(qp, white, load_row(qp, white, row))


@inlined
def load_row(qp: StageQP, white: Whitening, row: int) -> int:
    """Write a row's derivatives into `s` and `d` of the factorisation; returns its stage."""
    n, r = dimension(qp.state), dimension(qp.control)
    s, d = white.s, white.d
    if row < qp.output_error.shape[0]:
        for i in range(n):
            s[i] = qp.h_X[row, i]
        for a in range(r):
            d[a] = qp.h_U[row, a]
        return qp.A.shape[0]
    place = place_of(qp, row)
    k = place.stage
    for i in range(n):
        s[i] = qp.g_X[k, place.component, i] if place.kind == PATH else 0.0
    for a in range(r):
        d[a] = qp.g_U[k, place.component, a] if place.kind == PATH else 0.0
    if place.kind == BOUND:
        d[place.component] = place.sign
    elif place.kind == TRUST:
        s[place.component] = place.sign
    return k


@allocation_free
def value_of(qp: StageQP, row: int, dU: Array, dX: Array) -> float:
    """Left-hand side of a row."""
    n, r = dimension(qp.state), dimension(qp.control)
    terminal = qp.output_error.shape[0]
    total = 0.0
    if row < terminal:
        N = qp.A.shape[0]
        for i in range(n):
            total += qp.h_X[row, i] * dX[N, i]
        for a in range(r):
            total += qp.h_U[row, a] * dU[N, a]
        return total
    place = place_of(qp, row)
    k = place.stage
    if place.kind == BOUND:
        return place.sign * dU[k, place.component]
    if place.kind == TRUST:
        return place.sign * dX[k, place.component]
    for i in range(n):
        total += qp.g_X[k, place.component, i] * dX[k, i]
    for a in range(r):
        total += qp.g_U[k, place.component, a] * dU[k, a]
    return total


@allocation_free
def put_multiplier(qp: StageQP, row: int, multiplier: float, multipliers: Multipliers) -> None:
    """Write the multiplier of a row where it belongs."""
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
