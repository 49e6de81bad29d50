"""A stage-wise program as sparse matrices with the states kept, nothing eliminated."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cmpsp_ros.mpsp.problem import Array
from cmpsp_ros.mpsp.qp.solution import QPSolution
from cmpsp_ros.mpsp.qp.stage_qp import Multipliers, StageQP

Indices = NDArray[np.intp]


class Entries(NamedTuple):
    """Entries of a sparse matrix, each array of the same shape; duplicates add up."""

    row: Indices
    column: Indices
    value: Array

    def picked(self, rows: Indices, factor: float, first: int) -> Entries:
        """Some of the rows times a factor, as rows ``first``, ``first + 1`` and so on."""
        place = np.full(self.row.max(initial=-1) + 1, -1)
        present = rows < len(place)
        place[rows[present]] = first + np.flatnonzero(present)
        kept = place[self.row] >= 0
        return Entries(place[self.row[kept]], self.column[kept], factor * self.value[kept])


class Rows(NamedTuple):
    """All rows ``lower <= G z <= upper`` in ``z = (dU_0 ... dU_N, dX_1 ... dX_N)``.

    They come in the order terminal, path where it applies, trust where finite, bounds.

    Attributes:
        G: Entries of the matrix of shape ``(R, z)``.
        lower: Shape ``(R,)``, ``-inf`` where there is none.
        upper: Shape ``(R,)``, ``inf`` where there is none.
        path: Stage and constraint of each path row, two of shape ``(p,)``.
        trust: Stage and component of each trust row, two of shape ``(t,)``.
    """

    G: Entries
    lower: Array
    upper: Array
    path: tuple[Indices, ...]
    trust: tuple[Indices, ...]


def assembled(parts: list[Entries], shape: tuple[int, int]) -> Any:
    """The sparse matrix of all the entries, by columns, without those that are 0."""
    from scipy import sparse  # noqa: PLC0415 (takes 0.2 s to import, and few runs need it)

    if not parts:
        return sparse.csc_array(shape)
    row, column, value = (
        np.concatenate([part[index].ravel() for part in parts]) for index in range(3)
    )
    kept = value != 0.0
    return sparse.csc_array((value[kept], (row[kept], column[kept])), shape=shape)


def rows_of(qp: StageQP) -> Rows:
    """The rows of a program, dynamics left out."""
    N, n, r = qp.B.shape
    K, m = N + 1, len(qp.output_error)
    path = np.nonzero(qp.g != -np.inf)
    # The known first state has no trust region.
    finite = np.tile(np.isfinite(qp.trust_radius), (K, 1))
    finite[0] = False
    trust = np.nonzero(finite)
    radius, limit = qp.trust_radius[trust[1]], -qp.g[path]
    stage = np.concatenate([np.full(m, N), path[0], trust[0], np.repeat(np.arange(K), r)])
    bounds = np.tile(np.eye(r), (K, 1))
    by_state = np.concatenate([qp.h_X, qp.g_X[path], np.eye(n)[trust[1]], np.zeros((K * r, n))])
    by_control = np.concatenate([qp.h_U, qp.g_U[path], np.zeros((len(radius), r)), bounds])
    least = np.full(len(limit), -np.inf)
    return Rows(
        _rows(stage, by_state, by_control, K),
        np.concatenate([-qp.output_error, least, -radius, qp.lower.ravel()]),
        np.concatenate([-qp.output_error, limit, radius, qp.upper.ravel()]),
        path,
        trust,
    )


def dynamics_of(qp: StageQP) -> list[Entries]:
    """The ``N n`` rows of the dynamics, ``dX_(k+1) - A dX_k - B dU_k = 0``."""
    N, n, r = qp.B.shape
    stage, i, a = np.indices(qp.B.shape)
    by_control = Entries(stage * n + i, stage * r + a, -qp.B)
    stage, i, j = np.indices(qp.A[1:].shape)
    by_state = Entries((stage + 1) * n + i, (N + 1) * r + stage * n + j, -qp.A[1:])
    diagonal = np.arange(N * n)
    itself = Entries(diagonal, (N + 1) * r + diagonal, np.ones(N * n))
    return [by_control, by_state, itself]


def cost_of(qp: StageQP) -> tuple[list[Entries], Array]:
    """Upper triangle of the Hessian in ``z``, and the gradient at 0."""
    K, r = qp.lower.shape
    n = qp.A.shape[1]
    stage, a, b = np.indices(qp.L_UU.shape)
    control = Entries(stage * r + a, stage * r + b, np.triu(qp.L_UU))
    stage, a, i = np.indices(qp.L_UX[1:].shape)
    cross = Entries((stage + 1) * r + a, K * r + stage * n + i, qp.L_UX[1:])
    stage, i, j = np.indices(qp.L_XX[1:].shape)
    state = Entries(K * r + stage * n + i, K * r + stage * n + j, np.triu(qp.L_XX[1:]))
    return [control, cross, state], np.concatenate([qp.L_U.ravel(), qp.L_X[1:].ravel()])


def multipliers_of(qp: StageQP, rows: Rows, values: Array) -> Multipliers:
    """Multipliers of all rows, in their order, by kind and stage."""
    m, p, t = len(qp.output_error), len(rows.path[0]), len(rows.trust[0])
    terminal, path, trust, bounds = np.split(values, [m, m + p, m + p + t])
    of_path, of_trust = np.zeros_like(qp.g), np.zeros_like(qp.L_X)
    of_path[rows.path], of_trust[rows.trust] = path, trust
    return Multipliers(terminal.copy(), of_path, of_trust, bounds.reshape(qp.lower.shape).copy())


def values_of(rows: Rows, multipliers: QPSolution) -> Array:
    """Multipliers of all rows in their order, from those by kind and stage."""
    return np.concatenate(
        [
            multipliers.terminal,
            multipliers.path[rows.path],
            multipliers.trust[rows.trust],
            multipliers.bounds.ravel(),
        ]
    )


def _rows(stage: Indices, by_state: Array, by_control: Array, K: int) -> Entries:
    """Rows of one stage each; the known first state has no variable."""
    n, r = by_state.shape[1], by_control.shape[1]
    row, a = np.nonzero(by_control)
    later = np.where(stage[:, None] > 0, by_state, 0.0)
    row_x, i = np.nonzero(later)
    return Entries(
        np.concatenate([row, row_x]),
        np.concatenate([stage[row] * r + a, K * r + (stage[row_x] - 1) * n + i]),
        np.concatenate([by_control[row, a], later[row_x, i]]),
    )
