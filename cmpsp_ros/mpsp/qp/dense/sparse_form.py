"""A subproblem as sparse matrices with the states kept, nothing eliminated."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cmpsp_ros.arrays import Array
from cmpsp_ros.mpsp.qp.solution import Penalties, QPSolution, QPStatus
from cmpsp_ros.mpsp.qp.subproblem import Row, Subproblem

Indices = NDArray[np.intp]


class SparseQP(NamedTuple):
    """Minimise ``1/2 z' P z + q' z`` subject to ``D z = 0`` and ``lower <= G z <= upper``.

    ``z = (dU_0 ... dU_N, dX_1 ... dX_N)``. The rows of ``G`` come in the order terminal, path where
    it applies, trust where finite, bounds.

    Attributes:
        P: Upper triangle of the Hessian.
        q: Gradient at 0.
        D: The ``N n`` rows of the dynamics, ``dX_(k+1) - A dX_k - B dU_k``.
        G: All other rows, shape ``(R, z)``.
        lower: Shape ``(R,)``, ``-inf`` where there is none.
        upper: Shape ``(R,)``, ``inf`` where there is none.
        weight: Penalty of each row, ``inf`` where hard, shape ``(R,)``.
        path: Stage and constraint of each path row, two of shape ``(p,)``.
        trust: Stage and component of each trust row, two of shape ``(t,)``.
    """

    P: Any
    q: Array
    D: Any
    G: Any
    lower: Array
    upper: Array
    weight: Array
    path: tuple[Indices, ...]
    trust: tuple[Indices, ...]


def sparse_qp(subproblem: Subproblem, penalties: Penalties | None) -> SparseQP:
    """The sparse program."""
    from scipy import sparse  # noqa: PLC0415 (takes 0.2 s to import, and few runs need it)

    qp, lin, size = subproblem, subproblem.linearisation, subproblem.size
    N, n, r, m, K = size.horizon, size.state, size.control, size.output, size.horizon + 1
    every, later = np.arange(K), np.arange(N - 1)
    H = _blocks(np.triu(lin.L_UU), every, every, K)
    cross = _blocks(lin.L_UX[1:], every[1:], every[:-1], K, N)
    below = _blocks(np.triu(lin.L_XX[1:]), every[:-1], every[:-1], N)
    by_control = _blocks(lin.B, every[:-1], every[:-1], N, K)
    by_state = sparse.eye_array(N * n) - _blocks(lin.A[1:], later + 1, later, N)

    path = np.nonzero(lin.g != -np.inf)
    # The known first state has no trust region.
    finite = np.tile(np.isfinite(qp.trust_radius), (K, 1))
    finite[0] = False
    trust = np.nonzero(finite)
    radius, limit = qp.trust_radius[trust[1]], -lin.g[path]
    stage = np.concatenate([np.full(m, N), path[0], trust[0], np.repeat(every, r)])
    G_X = np.concatenate([lin.h_X, lin.g_X[path], np.eye(n)[trust[1]], np.zeros((K * r, n))])
    no_controls, bounds = np.zeros((len(radius), r)), np.tile(np.eye(r), (K, 1))
    G_U = np.concatenate([lin.h_U, lin.g_U[path], no_controls, bounds])
    moves = np.flatnonzero(stage)
    rows = [
        _blocks(G_U[:, None], np.arange(len(stage)), stage, len(stage), K),
        _blocks(G_X[moves, None], moves, stage[moves] - 1, len(stage), N),
    ]
    weight = np.full(len(stage), np.inf)
    if penalties is not None:
        weight[: m + len(limit)] = np.concatenate([penalties.terminal, penalties.path[path]])
    least = np.full(len(limit), -np.inf)
    return SparseQP(
        sparse.block_array([[H, cross], [None, below]], format='csc'),
        np.concatenate([lin.L_U.ravel(), lin.L_X[1:].ravel()]),
        sparse.hstack([-by_control, by_state], format='csr'),
        sparse.hstack(rows, format='csr'),
        np.concatenate([-lin.output_error, least, -radius, qp.lower.ravel()]),
        np.concatenate([-lin.output_error, limit, radius, qp.upper.ravel()]),
        weight,
        path,
        trust,
    )


def _blocks(values: Array, row: Indices, column: Indices, rows: int, columns: int = 0) -> Any:
    """Blocks of shape ``(count, a, b)`` at rows (in order) and columns of a matrix of blocks."""
    from scipy import sparse  # noqa: PLC0415 (as above)

    first = np.searchsorted(row, np.arange(rows + 1))
    shape = rows * values.shape[1], (columns or rows) * values.shape[2]
    matrix = sparse.bsr_array((values, column, first), shape=shape).tocsr()
    matrix.eliminate_zeros()
    return matrix


def solution_of(
    subproblem: Subproblem, program: SparseQP, dU: Array, rows: Array, iterations: int
) -> QPSolution:
    """A solution by the multipliers of all rows, shape ``(R,)``, positive at upper limits."""
    lin, m, p, t = subproblem.linearisation, *_counts(subproblem, program)
    terminal, of_path, of_trust, bounds = np.split(rows, [m, m + p, m + p + t])
    path, trust = np.zeros_like(lin.g), np.zeros_like(lin.L_X)
    path[program.path], trust[program.trust] = of_path, of_trust
    bounds = bounds.reshape(dU.shape)
    return QPSolution(QPStatus.SOLVED, dU, terminal, path, trust, bounds, iterations)


def multipliers_of(program: SparseQP, solution: QPSolution) -> Array:
    """Multipliers of all rows in their order, the inverse of `solution_of`."""
    path, trust = solution.path[program.path], solution.trust[program.trust]
    return np.concatenate([solution.terminal, path, trust, solution.bounds.ravel()])


def row_of(subproblem: Subproblem, program: SparseQP, index: int) -> Row:
    """The row at an index of ``G``."""
    m, p, t = _counts(subproblem, program)
    if index < m:
        return Row('terminal', subproblem.size.horizon, index)
    if index < m + p:
        return Row('path', *(int(each[index - m]) for each in program.path))
    if index < m + p + t:
        return Row('trust', *(int(each[index - m - p]) for each in program.trust))
    return Row('bound', *divmod(index - m - p - t, subproblem.size.control))


def _counts(subproblem: Subproblem, program: SparseQP) -> tuple[int, int, int]:
    return subproblem.size.output, len(program.path[0]), len(program.trust[0])
