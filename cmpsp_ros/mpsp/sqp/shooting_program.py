"""Compiled parts of multiple shooting: its subproblem, the direction in it, and a point's merit.

Gaps ``d_k`` are taken out of the linearised dynamics: with their response ``e`` the states change
by ``dX = e + dX'``, and what is left is the program (45) (54) (57) in ``dX'`` and ``dU``.
"""

import math
from collections.abc import Callable
from functools import cache
from typing import Any, NamedTuple

import numpy as np

from cmpsp_ros.arrays import Array
from cmpsp_ros.mpsp.jit.compiled import allocation_free, entry_for, inner
from cmpsp_ros.mpsp.problem import Dimensions, Evaluation
from cmpsp_ros.mpsp.qp import QPStatus
from cmpsp_ros.mpsp.qp.active_set.fixed_bounds import free_all
from cmpsp_ros.mpsp.qp.riccati.program import Program, empty_program, product

# Multiplier of a path constraint from which on it is held.
_HELD = 1e-8


class Memory(NamedTuple):
    """Arrays beside a program, in the sizes of the problem."""

    H: Array  # Hessian of the Lagrangian by ``(X_k, U_k)``, shape ``(N + 1, n + r, n + r)``
    gradient: Array  # of the cost, shape ``(N + 1, n + r)``
    gaps: Array  # ``F_k(X_k, U_k) - X_(k+1)``, shape ``(N, n)``
    output_error: Array  # shape ``(m,)``
    g: Array  # path constraints, shape ``(N + 1, l)``
    path: Array  # multipliers of the path constraints at the iterate, shape ``(N + 1, l)``
    bounds: Array  # of the bounds, shape ``(N + 1, r)``
    response: Array  # ``e``, shape ``(N + 1, n)``
    dX: Array  # direction, shape ``(N + 1, n)``
    dU: Array  # direction, shape ``(N + 1, r)``
    slack_terminal: Array  # violation of (54) that the direction leaves, shape ``(m,)``
    slack_path: Array  # of (57), shape ``(N + 1, l)``
    sums: Array  # results of the functions here, shape ``(4,)``


def memory(size: Dimensions) -> Memory:
    """Arrays of an iteration, allocated once for all of a solve."""
    K, n, r, m, l = size.horizon + 1, size.state, size.control, size.output, size.path  # noqa: E741
    shapes: tuple[tuple[int, ...], ...] = (
        (K, n + r, n + r), (K, n + r), (K - 1, n), (m,), (K, l), (K, l), (K, r),
        (K, n), (K, n), (K, r), (m,), (K, l), (4,),
    )  # fmt: skip
    return Memory(*map(np.zeros, shapes))


class Point(NamedTuple):
    """States, controls, their evaluation and dynamics ``(N, n)``, and the sum of all violations."""

    X: Array
    U: Array
    evaluation: Evaluation
    ahead: Array
    violation: float

    @property
    def is_finite(self) -> bool:
        """True where cost and violation are."""
        return math.isfinite(self.evaluation.cost + self.violation)

    @property
    def values(self) -> tuple[Array, Array, Array, Array]:
        """States, dynamics, terminal error and path constraints."""
        return self.X, self.ahead, self.evaluation.output_error, self.evaluation.g


class Direction(NamedTuple):
    """Solution of a subproblem; the direction itself is in the memory."""

    status: QPStatus  # how it ended
    multipliers: tuple[Array, Array, Array]  # of outputs, path constraints and bounds
    shift: float  # term on the diagonal of the Hessian
    held: float  # weight of the rows that are held
    level: int  # relaxation level
    falls: float  # decrease of the cost to first order
    above: float  # weight of gaps and hard rows in the merit
    left: float  # violation that the linearised constraints keep
    weighted: float  # the same with its weights


@allocation_free
def assemble(
    p: Program, s: Memory, U: Array, lower: Array, upper: Array, shift: float, held: float
) -> None:
    """Write the program at a point into records that have the Jacobians already.

    `shift` is added to the Hessian's diagonal. With `held` there is ``held/2 |row|^2`` for rows
    that hold: the terminal ones, and those with a multiplier. Along the rows nothing changes; a
    Hessian that is positive there becomes positive everywhere, if the weight is large enough.
    """
    n, r = s.dX.shape[1], s.dU.shape[1]
    free_all(p)
    p.head[0].is_factorised = p.head[0].work = 0
    for k in range(p.head[0].horizon + 1):
        stage, e = p.stages[k], s.response[k]
        _respond(p, s, k, n)
        for a in range(n + r):
            total = s.gradient[k, a]
            for b in range(n):
                total += s.H[k, a, b] * e[b]
            if a < n:
                stage.L_X[a] = total + shift * e[a]
                for b in range(n):
                    stage.L_XX[a, b] = s.H[k, a, b]
                stage.L_XX[a, a] += shift
            else:
                stage.L_U[a - n] = total
                for b in range(n):
                    stage.L_UX[a - n, b] = s.H[k, a, b]
                for b in range(r):
                    stage.L_UU[a - n, b] = s.H[k, a, n + b]
                stage.L_UU[a - n, a - n] += shift
        for a in range(r):
            if s.bounds[k, a] != 0.0:
                stage.L_UU[a, a] += held
            stage.lower[a], stage.upper[a] = lower[k, a] - U[k, a], upper[k, a] - U[k, a]
        for j in range(s.g.shape[1]):
            p.path[k, j].value = s.g[k, j]
            if s.g[k, j] != -math.inf:
                p.path[k, j].value += _by_states(p.path[k, j], e)
                if held > 0.0 and s.path[k, j] > _HELD:
                    _hold(stage, p.path[k, j], held, n, r)
    for j in range(s.output_error.shape[0]):
        stage = p.stages[p.head[0].horizon]
        p.terminal[j].value = s.output_error[j] + _by_states(p.terminal[j], s.response[-1])
        if held > 0.0:
            _hold(stage, p.terminal[j], held, n, r)


@inner
def _respond(p: Program, s: Memory, k: int, n: int) -> None:
    """Response to the gaps at a stage, from that at the stage before."""
    for i in range(n):
        s.response[k, i] = 0.0
        if k > 0:
            s.response[k, i] = s.gaps[k - 1, i]
            for j in range(n):
                s.response[k, i] += p.stages[k - 1].A[i, j] * s.response[k - 1, j]


@inner
def _by_states(row: Any, states: Array) -> float:
    total = 0.0
    for i in range(states.shape[0]):
        total += row.X[i] * states[i]
    return total


@inner
def _hold(stage: Any, row: Any, weight: float, n: int, r: int) -> None:
    for a in range(n):
        slope = weight * row.X[a]
        stage.L_X[a] += slope * row.value
        for b in range(n):
            stage.L_XX[a, b] += slope * row.X[b]
    for a in range(r):
        slope = weight * row.U[a]
        stage.L_U[a] += slope * row.value
        for b in range(n):
            stage.L_UX[a, b] += slope * row.X[b]
        for b in range(r):
            stage.L_UU[a, b] += slope * row.U[b]


@allocation_free
def read_direction(p: Program, s: Memory, is_relaxed: bool) -> None:
    """Take the direction from a solved program.

    Sums are the fall of the cost to first order, the largest multiplier of a row or finite weight,
    and, of the linearised constraints, the violation that is left, plain and weighted.
    """
    falls, largest, left, weighted = 0.0, 0.0, 0.0, 0.0
    n, N = s.dX.shape[1], p.head[0].horizon
    for k in range(N + 1):
        stage = p.stages[k]
        for i in range(n):
            s.dX[k, i] = stage.dX[i] + s.response[k, i]
            falls -= s.gradient[k, i] * s.dX[k, i]
        for a in range(s.dU.shape[1]):
            s.dU[k, a] = stage.dU[a]
            falls -= s.gradient[k, n + a] * s.dU[k, a]
        for j in range(p.path.shape[1]):
            row = p.path[k, j]
            largest = max(largest, row.multiplier)
            s.slack_path[k, j] = 0.0
            if is_relaxed and row.value != -math.inf:
                s.slack_path[k, j] = max(row.value + product(row, stage), 0.0)
            if row.penalty < math.inf:
                largest = max(largest, row.penalty)
                weighted += row.penalty * s.slack_path[k, j]
            left += s.slack_path[k, j]
    for j in range(p.terminal.shape[0]):
        row = p.terminal[j]
        largest = max(largest, abs(row.multiplier))
        s.slack_terminal[j] = row.value + product(row, p.stages[N]) if is_relaxed else 0.0
        if row.penalty < math.inf:
            largest = max(largest, row.penalty)
            weighted += row.penalty * abs(s.slack_terminal[j])
        left += abs(s.slack_terminal[j])
    s.sums[0], s.sums[1], s.sums[2], s.sums[3] = falls, largest, left, weighted


@allocation_free
def measure(p: Program, s: Memory, X: Array, ahead: Array, error: Array, g: Array) -> None:
    """Measure a point with dynamics `ahead` ``(N, n)``, terminal error and path constraints.

    Sums are all violations together, and, for a merit, those of gaps and hard rows, and those of
    the others times their penalties.
    """
    total, hard, weighted = 0.0, 0.0, 0.0
    for k in range(ahead.shape[0]):
        for i in range(ahead.shape[1]):
            hard += abs(ahead[k, i] - X[k + 1, i])
    total += hard
    for j in range(error.shape[0]):
        total += abs(error[j])
        if p.terminal[j].penalty < math.inf:
            weighted += p.terminal[j].penalty * abs(error[j])
        else:
            hard += abs(error[j])
    for k in range(g.shape[0]):
        for j in range(g.shape[1]):
            # Not `max`, which drops NaN.
            if not g[k, j] <= 0.0:
                total += g[k, j]
                if p.path[k, j].penalty < math.inf:
                    weighted += p.path[k, j].penalty * g[k, j]
                else:
                    hard += g[k, j]
    s.sums[0], s.sums[1], s.sums[2] = total, hard, weighted


@allocation_free
def set_correction(p: Program, s: Memory, X: Array, ahead: Array, error: Array, g: Array) -> None:
    """Set gaps and values of the second-order correction after the full step in `dX`, `dU`.

    They are such that the direction from the present point meets, to first order, the constraints
    as they are after the step; arguments after the step are as of `measure`.
    """
    n, r, N = s.dX.shape[1], s.dU.shape[1], p.head[0].horizon
    for k in range(N):
        stage = p.stages[k]
        for i in range(n):
            moved = s.dX[k + 1, i]
            for j in range(n):
                moved -= stage.A[i, j] * s.dX[k, j]
            for a in range(r):
                moved -= stage.B[i, a] * s.dU[k, a]
            s.gaps[k, i] = ahead[k, i] - X[k + 1, i] + moved
    for k in range(N + 1):
        for j in range(g.shape[1]):
            if s.g[k, j] != -math.inf:
                s.g[k, j] = g[k, j] - _change(p.path[k, j], s.dX[k], s.dU[k])
    for j in range(error.shape[0]):
        s.output_error[j] = error[j] - _change(p.terminal[j], s.dX[N], s.dU[N])


@inner
def _change(row: Any, dX: Array, dU: Array) -> float:
    total = _by_states(row, dX)
    for a in range(dU.shape[0]):
        total += row.U[a] * dU[a]
    return total


class Entries(NamedTuple):
    """Machine code of the functions here."""

    assemble: Callable[..., None]
    read_direction: Callable[..., None]
    measure: Callable[..., None]
    set_correction: Callable[..., None]


@cache
def entries_for(n: int, r: int) -> Entries:
    """Machine code for programs in records of ``n`` states and ``r`` controls."""
    p, s = empty_program(1, n, r, 1, 1), memory(Dimensions(1, n, r, 1, 1))
    point = p, s, s.dX, s.gaps, s.output_error, s.g
    return Entries(
        entry_for(assemble, p, s, s.dU, s.dU, s.dU, 0.0, 0.0),
        entry_for(read_direction, p, s, True),
        entry_for(measure, *point),
        entry_for(set_correction, *point),
    )
