"""Proof by multipliers that no point meets the hard rows of a program (Farkas)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cmpsp_ros.mpsp.problem import Array
from cmpsp_ros.mpsp.qp.dense.sparse_rows import Rows
from cmpsp_ros.mpsp.qp.stage_qp import StageQP
from cmpsp_ros.mpsp.qp.subproblem import Row

FARTHEST = 1e6
"""The proof covers all controls within their bounds, and within this where they have none."""

# Sums of parts are wrong by less than this, relative to the sum of their sizes.
_ROUNDING = 1e-10
_THRESHOLDS = (0.3, 0.1, 0.03, 1e-2, 1e-3, 1e-6, 1e-9, 0.0)


def contradicting_rows(
    qp: StageQP, rows: Rows, hard: NDArray[np.bool_], multipliers: Array
) -> tuple[Row, ...]:
    """Hard rows that contradict each other, found by a dual ray.

    The rows are added up, and the states eliminated: all points that meet them meet the sum,
    ``constant + slope' dU <= 0``. It is infeasible where its least value within the bounds of the
    controls is positive. Rows with small multipliers are left out where that still holds.

    Args:
        qp: The program.
        rows: Its rows.
        hard: Which of them are hard, shape ``(R,)``.
        multipliers: The ray, positive at upper limits and of any length, shape ``(R,)``. Those of
            the bounds are not used: the slope determines them.

    Returns:
        The rows in the order of their stages, terminal ones first; empty where nothing is proved.
    """
    ray = multipliers.copy()
    ray[~hard | ~np.isfinite(np.where(ray > 0.0, rows.upper, rows.lower))] = 0.0
    first_bound = len(ray) - qp.lower.size
    ray[first_bound:] = 0.0
    length = row_lengths(rows)
    size = np.abs(ray) * length
    # A row without an effect has no length, and still contradicts by itself.
    size[length == 0.0] = np.abs(ray[length == 0.0])
    largest = size.max(initial=0.0)
    if not 0.0 < largest < np.inf:
        return ()
    ray, size = ray / largest, size / largest
    for threshold in _THRESHOLDS:
        found = _combine(qp, rows, np.where(size > threshold, ray, 0.0), threshold)
        if found is not None:
            return tuple(sorted((row_of(qp, rows, each) for each in found), key=_order))
    return ()


def row_lengths(rows: Rows) -> Array:
    """Euclidean length of each row in controls and states, shape ``(R,)``."""
    squares: Array = np.zeros_like(rows.lower)
    np.add.at(squares, rows.G.row, rows.G.value**2)
    return np.sqrt(squares)


def row_of(qp: StageQP, rows: Rows, index: int) -> Row:
    """The row at an index of `Rows`."""
    N, r = len(qp.A), qp.lower.shape[1]
    if index < len(qp.output_error):
        return Row('terminal', N, index)
    index -= len(qp.output_error)
    if index < len(rows.path[0]):
        return Row('path', int(rows.path[0][index]), int(rows.path[1][index]))
    index -= len(rows.path[0])
    if index < len(rows.trust[0]):
        return Row('trust', int(rows.trust[0][index]), int(rows.trust[1][index]))
    return Row('bound', *divmod(index - len(rows.trust[0]), r))


def _combine(qp: StageQP, rows: Rows, ray: Array, threshold: float) -> list[int] | None:
    """Indices of the rows that are added up, bounds included; None where they prove nothing."""
    used = np.flatnonzero(ray)
    limit = np.where(ray > 0.0, rows.upper, rows.lower)[used]
    parts = -ray[used] * limit
    gradient: Array = np.zeros(qp.lower.size + qp.L_X[1:].size)
    np.add.at(gradient, rows.G.column, rows.G.value * ray[rows.G.row])
    slope = _eliminate_states(qp, gradient)
    # Where the sum is least: the bound whose multiplier would be the slope.
    bound = np.where(slope > 0.0, -qp.lower, qp.upper)
    at_bound = np.isfinite(bound) & (np.abs(slope) > threshold)
    least = -np.abs(slope) * np.where(at_bound, bound, FARTHEST)
    total = parts.sum() + least.sum()
    size = np.abs(parts).sum() + np.abs(least).sum()
    if not total > _ROUNDING * (size + np.abs(ray[used]) @ row_lengths(rows)[used]):
        return None
    first_bound = len(ray) - qp.lower.size
    return [*used.tolist(), *(first_bound + np.flatnonzero(at_bound)).tolist()]


def _eliminate_states(qp: StageQP, gradient: Array) -> Array:
    """Gradient in the controls alone, by the adjoint of the dynamics.

    Args:
        qp: The program.
        gradient: In ``(dU_0 ... dU_N, dX_1 ... dX_N)``.

    Returns:
        Shape ``(N + 1, r)``.
    """
    controls = qp.lower.size
    slope = gradient[:controls].reshape(qp.lower.shape).copy()
    by_state = gradient[controls:].reshape(-1, qp.A.shape[1])
    costate = np.zeros(qp.A.shape[1])
    for k in range(len(qp.A) - 1, -1, -1):
        costate = by_state[k] + (qp.A[k + 1].T @ costate if k + 1 < len(qp.A) else 0.0)
        slope[k] += qp.B[k].T @ costate
    return slope


def _order(row: Row) -> tuple[bool, int, int, int]:
    kinds = ('terminal', 'path', 'bound', 'trust')
    return (row.kind != 'terminal', row.stage, kinds.index(row.kind), row.index)
