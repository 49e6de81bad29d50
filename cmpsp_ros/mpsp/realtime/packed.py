"""A workspace in one piece of memory, as it is handed to compiled code.

Python would take longer to hand over its hundred arrays one by one than the solver takes to solve.
Compiled code finds them again by their order, which is that of the named tuples' fields.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cmpsp_ros.mpsp.jit.compiled import inlined
from cmpsp_ros.mpsp.problem import Array
from cmpsp_ros.mpsp.realtime.workspace import Trajectory, Workspace
from cmpsp_ros.mpsp.riccati.basis import Basis
from cmpsp_ros.mpsp.riccati.size import Size, dimension
from cmpsp_ros.mpsp.riccati.solver import Solver
from cmpsp_ros.mpsp.riccati.stage_qp import Multipliers, Penalty, StageQP
from cmpsp_ros.mpsp.riccati.whitening import Whitening
from cmpsp_ros.mpsp.riccati.working_set import ActiveSet, Hint

Indices = NDArray[np.int64]


class Packed(NamedTuple):
    """A workspace for compiled code.

    Attributes:
        state: ``n``.
        control: ``r``.
        horizon: ``N``, the longest there is room for.
        output: ``m``.
        path: ``l``.
        active: Largest number of active rows.
        numbers: All its arrays of numbers.
        indices: All its arrays of indices.
    """

    state: Size
    control: Size
    horizon: int
    output: int
    path: int
    active: int
    numbers: Array
    indices: Indices


def pack(room: Workspace) -> tuple[Packed, Workspace]:
    """Move a workspace into one piece.

    Returns:
        The workspace for compiled code, and the same for Python: views of the one piece.
    """
    arrays = list(_arrays(room))
    numbers = np.concatenate([each.ravel() for each in arrays if each.dtype == np.float64])
    indices = np.concatenate([each.ravel() for each in arrays if each.dtype == np.int64])
    packed = Packed(
        room.qp.state,
        room.qp.control,
        len(room.qp.A),
        len(room.qp.output_error),
        room.qp.g.shape[1],
        len(room.solver.active.rows),
        numbers,
        indices,
    )
    return packed, _views(room, {numbers.dtype: numbers, indices.dtype: indices}, {})


def _arrays(tree: Any) -> Any:
    for branch in tree:
        if isinstance(branch, np.ndarray):
            yield branch
        elif hasattr(branch, '_fields'):
            yield from _arrays(branch)


def _views(tree: Any, buffers: dict[Any, Any], at: dict[Any, int]) -> Any:
    branches = []
    for branch in tree:
        if isinstance(branch, np.ndarray):
            begin = at.get(branch.dtype, 0)
            at[branch.dtype] = begin + branch.size
            view = buffers[branch.dtype][begin : begin + branch.size]
            branches.append(view.reshape(branch.shape))
        elif hasattr(branch, '_fields'):
            branches.append(_views(branch, buffers, at))
        else:
            branches.append(branch)
    return type(tree)(*branches)


@inlined
def unpack(packed: Packed, N: int) -> Workspace:
    """The workspace for a horizon of ``N`` steps, at most the longest."""
    n, r = dimension(packed.state), dimension(packed.control)
    longest, m, l = packed.horizon, packed.output, packed.path  # noqa: E741 (the paper's l)
    full, K, x = longest + 1, N + 1, packed.numbers
    A, at = _stack(x, 0, longest, n, n)
    B, at = _stack(x, at, longest, n, r)
    L_X, at = _matrix(x, at, full, n)
    L_U, at = _matrix(x, at, full, r)
    L_XX, at = _stack(x, at, full, n, n)
    L_UX, at = _stack(x, at, full, r, n)
    L_UU, at = _stack(x, at, full, r, r)
    output_error, at = _vector(x, at, m)
    h_X, at = _matrix(x, at, m, n)
    h_U, at = _matrix(x, at, m, r)
    g, at = _matrix(x, at, full, l)
    g_X, at = _stack(x, at, full, l, n)
    g_U, at = _stack(x, at, full, l, r)
    qp_lower, at = _matrix(x, at, full, r)
    qp_upper, at = _matrix(x, at, full, r)
    trust_radius, at = _vector(x, at, n)
    qp = StageQP(
        packed.state,
        packed.control,
        A[:N],
        B[:N],
        L_X[:K],
        L_U[:K],
        L_XX[:K],
        L_UX[:K],
        L_UU[:K],
        output_error,
        h_X,
        h_U,
        g[:K],
        g_X[:K],
        g_U[:K],
        qp_lower[:K],
        qp_upper[:K],
        trust_radius,
    )
    solver, at, index = _solver(packed, N, at)
    now, at = _trajectory(packed, N, at)
    trial, at = _trajectory(packed, N, at)
    lower, at = _matrix(x, at, full, r)
    upper, at = _matrix(x, at, full, r)
    most, at = _penalty(packed, N, at)
    relaxed, at = _penalty(packed, N, at)
    merit, at = _penalty(packed, N, at)
    bend, at = _matrix(x, at, full, r)
    slack, at = _vector(x, at, l + m)
    counts = packed.indices[index:]
    return Workspace(
        qp,
        solver,
        now,
        trial,
        lower[:K],
        upper[:K],
        most,
        relaxed,
        merit,
        bend[:K],
        slack,
        counts,
    )


@inlined
def _solver(packed: Packed, N: int, at: int) -> Any:
    n, r = dimension(packed.state), dimension(packed.control)
    longest, m, l = packed.horizon, packed.output, packed.path  # noqa: E741
    full, K, M, x, y = longest + 1, N + 1, packed.active, packed.numbers, packed.indices
    q, q_now, width = full * r, K * r, l + 2 * r + 2 * n
    rows, rows_now = m + full * width, m + K * width
    optimum, at = _vector(x, at, q)
    gains, at = _stack(x, at, full, r, n)
    L_inv, at = _stack(x, at, full, r, r)
    A_cl, at = _stack(x, at, longest, n, n)
    B_cl, at = _stack(x, at, longest, n, r)
    covariance, at = _stack(x, at, full, n, n)
    P, at = _matrix(x, at, n, n)
    p, at = _vector(x, at, n)
    PA, at = _matrix(x, at, n, n)
    PB, at = _matrix(x, at, n, r)
    G, at = _matrix(x, at, r, n)
    L, at = _matrix(x, at, r, r)
    s, at = _vector(x, at, n)
    t, at = _vector(x, at, n)
    d, at = _vector(x, at, r)
    white = Whitening(
        optimum[:q_now],
        gains[:K],
        L_inv[:K],
        A_cl[:N],
        B_cl[:N],
        covariance[:K],
        P,
        p,
        PA,
        PB,
        G,
        L,
        s,
        t,
        d,
    )
    v, at = _vector(x, at, q)
    Q, at = _matrix(x, at, M, q)
    R, at = _matrix(x, at, M, M)
    of_rows, at = _vector(x, at, M)
    most, at = _vector(x, at, M)
    lengths, at = _vector(x, at, rows)
    distances, at = _vector(x, at, l + r + n + m)
    row, at = _vector(x, at, q)
    inside, at = _vector(x, at, M)
    outside, at = _vector(x, at, q)
    dependence, at = _vector(x, at, M)
    counts, index = y[:7], 7
    active_rows, index = y[index : index + M], index + M
    states, index = y[index : index + rows_now], index + rows
    furthest, index = y[index : index + l + r + n + m], index + l + r + n + m
    conflict, index = y[index : index + M + 1], index + M + 1
    active = ActiveSet(
        counts,
        v[:q_now],
        Basis(Q, R),
        active_rows,
        of_rows,
        most,
        states,
        lengths[:rows_now],
        distances,
        furthest,
        conflict,
        row[:q_now],
        inside,
        outside[:q_now],
        dependence,
    )
    hard = Hint(y[index : index + 1], y[index + 1 : index + 1 + rows])
    index += 1 + rows
    relaxed = Hint(y[index : index + 1], y[index + 1 : index + 1 + rows])
    index += 1 + rows
    dU, at = _matrix(x, at, full, r)
    dX, at = _matrix(x, at, full, n)
    terminal, at = _vector(x, at, m)
    path, at = _matrix(x, at, full, l)
    trust, at = _matrix(x, at, full, n)
    bounds, at = _matrix(x, at, full, r)
    multipliers = Multipliers(terminal, path[:K], trust[:K], bounds[:K])
    deviation, at = _matrix(x, at, full, n)
    costates, at = _matrix(x, at, 4, n)
    solver = Solver(
        white, active, hard, relaxed, dU[:K], dX[:K], multipliers, deviation[:K], costates
    )
    return solver, at, index


@inlined
def _trajectory(packed: Packed, N: int, at: int) -> Any:
    n, r = dimension(packed.state), dimension(packed.control)
    full, K, x = packed.horizon + 1, N + 1, packed.numbers
    U, at = _matrix(x, at, full, r)
    X, at = _matrix(x, at, full, n)
    output_error, at = _vector(x, at, packed.output)
    g, at = _matrix(x, at, full, packed.path)
    cost, at = _vector(x, at, 1)
    return Trajectory(U[:K], X[:K], output_error, g[:K], cost), at


@inlined
def _penalty(packed: Packed, N: int, at: int) -> Any:
    terminal, at = _vector(packed.numbers, at, packed.output)
    path, at = _matrix(packed.numbers, at, packed.horizon + 1, packed.path)
    return Penalty(terminal, path[: N + 1]), at


@inlined
def _vector(x: Array, at: int, a: int) -> Any:
    return x[at : at + a], at + a


@inlined
def _matrix(x: Array, at: int, a: int, b: int) -> Any:
    return x[at : at + a * b].reshape((a, b)), at + a * b


@inlined
def _stack(x: Array, at: int, a: int, b: int, c: int) -> Any:
    return x[at : at + a * b * c].reshape((a, b, c)), at + a * b * c
