"""A stage-wise quadratic program in memory: one record a stage, and one a constraint row.

The sizes ``n`` and ``r`` are part of the records' types. Code compiled for them has constant loop
counts, an argument stands for all the arrays of its record, and the fields of a sweep are
side by side. The horizon and the number of path constraints are lengths of arrays. In Python a
field of all records is an ordinary array: ``stages['A']`` has shape ``(N + 1, n, n)``.

Rows are numbered: first the terminal ones; then, for each stage, its path rows, the upper and lower
bound of each control, and the upper and lower limit of the trust region for each state.
"""

import math
from enum import IntEnum
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cmpsp_ros.arrays import Array
from cmpsp_ros.mpsp.jit.compiled import allocation_free
from cmpsp_ros.mpsp.jit.sizes import sized


class Outcome(IntEnum):
    """End of a compiled solver."""

    SOLVED = 0  # the point meets the optimality conditions
    INFEASIBLE = 1  # no point satisfies all hard constraints
    ITERATION_LIMIT = 2  # work, room or numerical accuracy ran out before the conditions were met
    NO_CURVATURE = 3  # the Hessian in the controls is not positive definite


class RowKind(IntEnum):
    """Kinds of inequalities."""

    PATH = 0
    BOUND = 1
    TRUST = 2


RecordType = np.dtype[Any]
Records = NDArray[Any]


@sized
def stage_type(n: int, r: int) -> RecordType:
    """A stage of the quadratic program (45) (54) (57), of its factorisation and of its solution.

    The program, before the states are eliminated, is to minimise the sum over the stages of
    ``L_X' dX + L_U' dU + 1/2 dX' L_XX dX + dU' L_UX dX + 1/2 dU' L_UU dU`` along
    ``dX_(k+1) = A dX_k + B dU_k`` with ``dX_0 = 0``, subject to its rows (see `row_type`),
    ``lower <= dU <= upper``, and ``|dX_k| <= trust_radius`` for ``k >= 1``.
    """
    return _record(
        # Fields of one sweep are side by side. The program first; `A` and `B` of the last stage are
        # not used.
        A=(n, n), B=(n, r), L_X=(n,), L_U=(r,), L_XX=(n, n), L_UX=(r, n), L_UU=(r, r),
        # Its Riccati factorisation, dU = L_inv' v - K dX.
        optimum=(r,), K=(r, n), L_inv=(r, r), A_cl=(n, n), B_cl=(n, r),
        # Its solution, and limits.
        dU=(r,), dX=(n,), lower=(r,), upper=(r,), bounds=(r,), trust=(n,),
        # Controls that are held at a bound (1 at the upper one, -1 at the lower one) are taken out
        # of the factorisation: they move the states by `drift`, and `origin_U`, `origin_X` is the
        # step at v = 0.
        fixed=(r,), drift=(n,), origin_U=(r,), origin_X=(n,), covariance=(n, n),
        # Second-order correction of the step.
        correction_U=(r,), correction_X=(n,),
    )  # fmt: skip


@sized
def row_type(n: int, r: int) -> RecordType:
    """Linearised constraint ``value + X' dX + U' dU``, not positive (path) or 0 (terminal).

    `value` is ``-inf`` where it does not apply; `penalty` the largest multiplier in force, infinite
    for a hard row; `weight` that of the relaxation, `merit` that in the merit function.
    """
    return _record(value=(), X=(n,), U=(r,), multiplier=(), penalty=(), weight=(), merit=())


@sized
def head_type(n: int, r: int) -> RecordType:
    """Record of a whole program: horizon, counters, and the row that is looked at.

    `begun` numbers the stage at which the horizon begins, for warm starts of a later one.
    """
    counters = (
        'horizon', 'begun', 'iterations', 'active', 'saturated', 'implied', 'conflicting', 'fixed',
        'has_covariance', 'is_factorised', 'is_proved', 'work', 'work_limit',
    )  # fmt: skip
    row = _record(trust_radius=(n,), X=(n,), U=(r,))
    return np.dtype([*((name, np.int64) for name in counters), *row.descr])


def _record(**shapes: tuple[int, ...]) -> RecordType:
    return np.dtype([(name, np.float64, shape) for name, shape in shapes.items()])


class Program(NamedTuple):
    """A program with a horizon of at most ``N``, and its solution.

    Of `head_type` ``(1,)``, of `stage_type` ``(N + 1,)``, and of `row_type` ``(m,)`` and
    ``(N + 1, l)``.
    """

    head: Records
    stages: Records
    terminal: Records
    path: Records


def empty_program(N: int, n: int, r: int, m: int, l: int) -> Program:  # noqa: E741 (the paper's l)
    """A program of these sizes with all numbers 0 and no limits, to be filled."""
    program = Program(
        np.zeros(1, head_type(n, r)),
        np.zeros(N + 1, stage_type(n, r)),
        np.zeros(m, row_type(n, r)),
        np.zeros((N + 1, l), row_type(n, r)),
    )
    program.head['horizon'] = N
    program.head['trust_radius'] = np.inf
    program.head['work_limit'] = np.iinfo(np.int64).max
    program.stages['lower'], program.stages['upper'] = -np.inf, np.inf
    for rows in (program.terminal, program.path):
        rows['penalty'] = rows['weight'] = np.inf
    return program


@allocation_free
def rows_per_stage(p: Program) -> int:
    """Number of inequalities of each stage."""
    n, r = p.stages[0].B.shape
    return p.path.shape[1] + 2 * r + 2 * n


@allocation_free
def count_rows(p: Program) -> int:
    """Number of rows on the present horizon."""
    return p.terminal.shape[0] + (p.head[0].horizon + 1) * rows_per_stage(p)


@allocation_free
def locate(p: Program, row: int) -> Any:
    """Kind, stage and component of an inequality, and -1 for a lower limit, else 1."""
    r = p.stages[0].B.shape[1]
    width, path = rows_per_stage(p), p.path.shape[1]
    k = (row - p.terminal.shape[0]) // width
    i = (row - p.terminal.shape[0]) % width
    if i < path:
        return RowKind.PATH, k, i, 1.0
    i -= path
    if i < 2 * r:
        return RowKind.BOUND, k, i // 2, 1.0 - 2.0 * (i % 2)
    i -= 2 * r
    return RowKind.TRUST, k, i // 2, 1.0 - 2.0 * (i % 2)


@allocation_free
def is_bound(p: Program, row: int) -> bool:
    """True for the bound of a control."""
    if row < p.terminal.shape[0]:
        return False
    kind, _, _, _ = locate(p, row)
    return bool(kind == RowKind.BOUND)


@allocation_free
def row_number(p: Program, kind: int, k: int, component: int, sign: float) -> int:
    """Number of an inequality, the reverse of `locate`."""
    first = p.terminal.shape[0] + k * rows_per_stage(p)
    if kind == RowKind.PATH:
        return first + component
    first += p.path.shape[1] + 2 * component + (0 if sign > 0.0 else 1)
    return first if kind == RowKind.BOUND else first + 2 * p.stages[0].B.shape[1]


@allocation_free
def limit(p: Program, row: int) -> Any:
    """Right-hand side of a row, and its largest multiplier."""
    if row < p.terminal.shape[0]:
        return -p.terminal[row].value, p.terminal[row].penalty
    kind, k, i, sign = locate(p, row)
    if kind == RowKind.PATH:
        return -p.path[k, i].value, p.path[k, i].penalty
    if kind == RowKind.BOUND:
        return p.stages[k].upper[i] if sign > 0.0 else -p.stages[k].lower[i], math.inf
    return p.head[0].trust_radius[i], math.inf


@allocation_free
def load_row(p: Program, row: int) -> int:
    """Write a row's derivatives into `X` and `U` of the head; returns its stage."""
    head = p.head[0]
    n, r = p.stages[0].B.shape
    X, U = head.X, head.U
    if row < p.terminal.shape[0]:
        for i in range(n):
            X[i] = p.terminal[row].X[i]
        for a in range(r):
            U[a] = p.terminal[row].U[a]
        return head.horizon
    kind, k, component, sign = locate(p, row)
    if kind == RowKind.PATH:
        constraint = p.path[k, component]
        for i in range(n):
            X[i] = constraint.X[i]
        for a in range(r):
            U[a] = constraint.U[a]
        return k
    for i in range(n):
        X[i] = 0.0
    for a in range(r):
        U[a] = 0.0
    if kind == RowKind.BOUND:
        U[component] = sign
    else:
        X[component] = sign
    return k


@allocation_free
def row_value(p: Program, row: int) -> float:
    """Left-hand side of a row at the solution's ``dX`` and ``dU``."""
    if row < p.terminal.shape[0]:
        return product(p.terminal[row], p.stages[p.head[0].horizon])
    kind, k, i, sign = locate(p, row)
    if kind == RowKind.PATH:
        return product(p.path[k, i], p.stages[k])
    return sign * (p.stages[k].dU[i] if kind == RowKind.BOUND else p.stages[k].dX[i])


@allocation_free
def row_value_at_origin(p: Program, row: int) -> float:
    """Left-hand side of a row at ``v = 0``, which is 0 unless controls are held at a bound."""
    head = p.head[0]
    if head.fixed == 0:
        return 0.0
    stage = p.stages[load_row(p, row)]
    total = 0.0
    for i in range(head.X.shape[0]):
        total += head.X[i] * stage.origin_X[i]
    for a in range(head.U.shape[0]):
        total += head.U[a] * stage.origin_U[a]
    return total


@allocation_free
def product(row: Any, stage: Any) -> float:
    """``X' dX + U' dU`` of a constraint at its stage."""
    total = 0.0
    for i in range(stage.dX.shape[0]):
        total += row.X[i] * stage.dX[i]
    for a in range(stage.dU.shape[0]):
        total += row.U[a] * stage.dU[a]
    return total


@allocation_free
def add_row_gradient(row: Any, X: Array, U: Array) -> None:
    """Add a constraint's derivatives times its multiplier."""
    for i in range(X.shape[0]):
        X[i] += row.X[i] * row.multiplier
    for a in range(U.shape[0]):
        U[a] += row.U[a] * row.multiplier


@allocation_free
def add_cost_gradient(stage: Any, X: Array, U: Array) -> None:
    """Add the derivatives of a stage's cost at its solution."""
    for a in range(U.shape[0]):
        U[a] += stage.L_U[a]
        for i in range(X.shape[0]):
            U[a] += stage.L_UX[a, i] * stage.dX[i]
        for b in range(U.shape[0]):
            U[a] += stage.L_UU[a, b] * stage.dU[b]
    for i in range(X.shape[0]):
        X[i] += stage.L_X[i]
        for j in range(X.shape[0]):
            X[i] += stage.L_XX[i, j] * stage.dX[j]
        for a in range(U.shape[0]):
            X[i] += stage.L_UX[a, i] * stage.dU[a]


@allocation_free
def clear_multipliers(p: Program) -> None:
    """Set all multipliers to 0."""
    for j in range(p.terminal.shape[0]):
        p.terminal[j].multiplier = 0.0
    for k in range(p.head[0].horizon + 1):
        stage = p.stages[k]
        for j in range(p.path.shape[1]):
            p.path[k, j].multiplier = 0.0
        for a in range(stage.bounds.shape[0]):
            stage.bounds[a] = 0.0
        for i in range(stage.trust.shape[0]):
            stage.trust[i] = 0.0


@allocation_free
def set_multiplier(p: Program, row: int, multiplier: float) -> None:
    """Write the multiplier of a row where it belongs."""
    if row < p.terminal.shape[0]:
        p.terminal[row].multiplier = multiplier
        return
    kind, k, i, sign = locate(p, row)
    if kind == RowKind.PATH:
        p.path[k, i].multiplier = multiplier
    elif kind == RowKind.BOUND:
        p.stages[k].bounds[i] += sign * multiplier
    else:
        p.stages[k].trust[i] += sign * multiplier


@allocation_free
def multiplier_of(p: Program, row: int) -> float:
    """Multiplier of a row; of two opposite limits only one has it."""
    if row < p.terminal.shape[0]:
        return p.terminal[row].multiplier
    kind, k, i, sign = locate(p, row)
    if kind == RowKind.PATH:
        return p.path[k, i].multiplier
    both = p.stages[k].bounds[i] if kind == RowKind.BOUND else p.stages[k].trust[i]
    return max(sign * both, 0.0)
