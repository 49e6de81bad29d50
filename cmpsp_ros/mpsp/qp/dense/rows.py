"""Rows of a subproblem in one numbering, and its sparse matrices with the states kept."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cmpsp_ros.arrays import Array
from cmpsp_ros.mpsp.qp.subproblem import Penalties, QPSolution, QPStatus, Row, Subproblem

Indices = NDArray[np.intp]


class Rows(NamedTuple):
    """Rows ``lower <= G z <= upper``: terminal, path if it applies, trust if finite, bounds."""

    lower: Array  # shape ``(R,)``, ``-inf`` where there is none
    upper: Array  # shape ``(R,)``, ``inf`` where there is none
    weight: Array  # penalty of each row, ``inf`` where hard, shape ``(R,)``
    path: tuple[Indices, ...]  # stage and constraint of each path row, two of shape ``(p,)``
    trust: tuple[Indices, ...]  # stage and component of each trust row, two of shape ``(t,)``
    outputs: int  # ``m``
    shape: tuple[int, ...]  # of the controls, ``(N + 1, r)``

    @classmethod
    def of(cls, subproblem: Subproblem, penalties: Penalties | None) -> Rows:
        """The rows of a subproblem, hard without penalties."""
        lin = subproblem.linearisation
        path, m = np.nonzero(lin.g != -np.inf), len(lin.output_error)
        # The known first state has no trust region.
        finite = np.tile(subproblem.trust_radius != np.inf, (len(lin.g), 1))
        finite[0] = False
        trust = np.nonzero(finite)
        radius, limit = subproblem.trust_radius[trust[1]], -lin.g[path]
        bounds = subproblem.lower.ravel(), subproblem.upper.ravel()
        upper = np.concatenate([-lin.output_error, limit, radius, bounds[1]])
        weight = np.full(len(upper), np.inf)
        if penalties is not None:
            weight[: m + len(limit)] = np.concatenate([penalties.terminal, penalties.path[path]])
        least = np.full(len(limit), -np.inf)
        lower = np.concatenate([-lin.output_error, least, -radius, bounds[0]])
        return cls(lower, upper, weight, path, trust, m, subproblem.lower.shape)

    @property
    def starts(self) -> tuple[int, int, int]:
        """First numbers of path rows, trust rows and bounds."""
        path = self.outputs + len(self.path[0])
        return self.outputs, path, path + len(self.trust[0])

    def solution(
        self, subproblem: Subproblem, dU: Array, multipliers: Array, iterations: int = 0
    ) -> QPSolution:
        """A solution by the multipliers of all rows, shape ``(R,)``, positive at upper limits."""
        lin = subproblem.linearisation
        terminal, of_path, of_trust, bounds = np.split(multipliers, self.starts)
        path, trust = np.zeros_like(lin.g), np.zeros_like(lin.L_X)
        path[self.path], trust[self.trust] = of_path, of_trust
        dU, bounds = dU.reshape(self.shape), bounds.reshape(self.shape)
        return QPSolution(QPStatus.SOLVED, dU, terminal, path, trust, bounds, iterations)

    def multipliers(self, solution: QPSolution) -> Array:
        """Multipliers of all rows in their order, the inverse of `solution`."""
        path, trust = solution.path[self.path], solution.trust[self.trust]
        return np.concatenate([solution.terminal, path, trust, solution.bounds.ravel()])

    def row(self, index: int) -> Row:
        """The row of a number."""
        m, p, t = self.starts
        if index < m:
            return Row('terminal', self.shape[0] - 1, index)
        if index < p:
            return Row('path', *(int(each[index - m]) for each in self.path))
        if index < t:
            return Row('trust', *(int(each[index - p]) for each in self.trust))
        return Row('bound', *divmod(index - t, self.shape[1]))


class SparseQP(NamedTuple):
    """Minimise ``1/2 z' P z + q' z`` subject to ``D z = 0`` and the rows on ``G z``.

    ``z = (dU_0 ... dU_N, dX_1 ... dX_N)``.
    """

    P: Any  # upper triangle of the Hessian
    q: Array  # gradient at 0
    D: Any  # the ``N n`` rows of the dynamics, ``dX_(k+1) - A dX_k - B dU_k``
    G: Any  # all other rows, shape ``(R, z)``
    rows: Rows  # their limits and penalties


def sparse_qp(subproblem: Subproblem, penalties: Penalties | None) -> SparseQP:
    """The program as sparse matrices, nothing eliminated."""
    from scipy import sparse  # noqa: PLC0415 (takes 0.2 s to import, and few runs need it)

    lin, size, rows = subproblem.linearisation, subproblem.size, Rows.of(subproblem, penalties)
    N, n, r, m, K = size.horizon, size.state, size.control, size.output, size.horizon + 1
    every, later = np.arange(K), np.arange(N - 1)
    H = _blocks(np.triu(lin.L_UU), every, every, K)
    cross = _blocks(lin.L_UX[1:], every[1:], every[:-1], K, N)
    below = _blocks(np.triu(lin.L_XX[1:]), every[:-1], every[:-1], N)
    by_control = _blocks(lin.B, every[:-1], every[:-1], N, K)
    by_state = sparse.csr_array(sparse.identity(N * n)) - _blocks(lin.A[1:], later + 1, later, N)

    path, trust = rows.path, rows.trust
    stage = np.concatenate([np.full(m, N), path[0], trust[0], np.repeat(every, r)])
    G_X = np.concatenate([lin.h_X, lin.g_X[path], np.eye(n)[trust[1]], np.zeros((K * r, n))])
    no_controls, bounds = np.zeros((len(trust[0]), r)), np.tile(np.eye(r), (K, 1))
    G_U = np.concatenate([lin.h_U, lin.g_U[path], no_controls, bounds])
    moves = np.flatnonzero(stage)
    G = [
        _blocks(G_U[:, None], np.arange(len(stage)), stage, len(stage), K),
        _blocks(G_X[moves, None], moves, stage[moves] - 1, len(stage), N),
    ]
    return SparseQP(
        sparse.csc_array(sparse.bmat([[H, cross], [None, below]])),
        np.concatenate([lin.L_U.ravel(), lin.L_X[1:].ravel()]),
        sparse.csr_array(sparse.hstack([-by_control, by_state])),
        sparse.csr_array(sparse.hstack(G)),
        rows,
    )


def _blocks(values: Array, row: Indices, column: Indices, rows: int, columns: int = 0) -> Any:
    """Blocks of shape ``(count, a, b)`` at rows (in order) and columns of a matrix of blocks."""
    from scipy import sparse  # noqa: PLC0415 (as above)

    first = np.searchsorted(row, np.arange(rows + 1))
    shape = rows * values.shape[1], (columns or rows) * values.shape[2]
    matrix = sparse.bsr_array((values, column, first), shape=shape).tocsr()
    matrix.eliminate_zeros()
    return matrix
