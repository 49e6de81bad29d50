"""Proof by multipliers that no point meets the hard rows of a program (Farkas)."""

from __future__ import annotations

import numpy as np

from cmpsp_ros.arrays import Array
from cmpsp_ros.mpsp.qp.dense.sparse_form import SparseQP, row_of
from cmpsp_ros.mpsp.qp.subproblem import Row, Subproblem

FARTHEST = 1e6
"""The proof covers all controls within their bounds, and within this where they have none."""

# Sums of parts are wrong by less than this, relative to the sum of their sizes.
_ROUNDING = 1e-10
_THRESHOLDS = (0.3, 0.1, 0.03, 1e-2, 1e-3, 1e-6, 1e-9, 0.0)


def contradicting_rows(
    subproblem: Subproblem, program: SparseQP, multipliers: Array
) -> tuple[Row, ...]:
    """Hard rows that contradict each other, found by a dual ray.

    The rows are added up, and the states eliminated: all points that meet them meet the sum,
    ``constant + slope' dU <= 0``. It is infeasible where its least value within the bounds of the
    controls is positive. Rows with small multipliers are left out where that still holds.

    Args:
        subproblem: The program.
        program: The same as sparse matrices.
        multipliers: The ray, positive at upper limits and of any length, shape ``(R,)``. Those of
            the bounds are not used: the slope determines them.

    Returns:
        The rows in the order of their stages, terminal ones first; empty where nothing is proved.
    """
    ray, limit = multipliers.copy(), np.where(multipliers > 0.0, program.upper, program.lower)
    ray[np.isfinite(program.weight) | ~np.isfinite(limit)] = 0.0
    ray[len(ray) - subproblem.lower.size :] = 0.0
    length = row_lengths(program)
    # A row without an effect has no length, and still contradicts by itself.
    size = np.abs(ray) * np.where(length > 0.0, length, 1.0)
    largest = size.max(initial=0.0)
    if not 0.0 < largest < np.inf:
        return ()
    ray, size = ray / largest, size / largest
    for threshold in _THRESHOLDS:
        found = _combine(subproblem, program, np.where(size > threshold, ray, 0.0), threshold)
        if found is not None:
            return tuple(sorted((row_of(subproblem, program, i) for i in found), key=_order))
    return ()


def row_lengths(program: SparseQP) -> Array:
    """Euclidean length of each row in controls and states, shape ``(R,)``."""
    lengths: Array = np.sqrt(program.G.power(2).sum(axis=1))
    return lengths


def _combine(
    subproblem: Subproblem, program: SparseQP, ray: Array, threshold: float
) -> list[int] | None:
    """Indices of the rows that are added up, bounds included; None where they prove nothing."""
    used = np.flatnonzero(ray)
    limit = np.where(ray > 0.0, program.upper, program.lower)[used]
    parts = -ray[used] * limit
    controls = subproblem.lower.size
    slope = _eliminate_states(subproblem, program.G.T @ ray)
    # Where the sum is least: the bound whose multiplier would be the slope.
    bound = np.where(slope > 0.0, -subproblem.lower, subproblem.upper)
    at_bound = np.isfinite(bound) & (np.abs(slope) > threshold)
    least = -np.abs(slope) * np.where(at_bound, bound, FARTHEST)
    total = parts.sum() + least.sum()
    size = np.abs(parts).sum() + np.abs(least).sum()
    if not total > _ROUNDING * (size + np.abs(ray[used]) @ row_lengths(program)[used]):
        return None
    return [*used.tolist(), *(len(ray) - controls + np.flatnonzero(at_bound)).tolist()]


def _eliminate_states(subproblem: Subproblem, gradient: Array) -> Array:
    """Gradient in the controls alone, ``(N + 1, r)``, by the adjoint of the dynamics.

    In plain numpy: what is compiled has to be compiled before a robot moves.

    Args:
        subproblem: The program.
        gradient: In ``(dU_0 ... dU_N, dX_1 ... dX_N)``.
    """
    lin, size = subproblem.linearisation, subproblem.size
    by_control, by_state = np.split(gradient, [subproblem.lower.size])
    slope, by_state = by_control.reshape(subproblem.lower.shape), by_state.reshape(-1, size.state)
    costate = by_state[-1]
    for k in range(size.horizon - 1, -1, -1):
        slope[k] += lin.B[k].T @ costate
        if k:
            costate = by_state[k - 1] + lin.A[k].T @ costate
    return slope


def _order(row: Row) -> tuple[bool, int, int, int]:
    kinds = ('terminal', 'path', 'bound', 'trust')
    return (row.kind != 'terminal', row.stage, kinds.index(row.kind), row.index)
