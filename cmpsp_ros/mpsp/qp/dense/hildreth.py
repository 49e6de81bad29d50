"""Hildreth's quadratic programming procedure, the solver that the paper itself uses (Sec. 2.4).

Coordinate ascent on the dual: one row after the other is met exactly by its own multiplier, the
others held, again and again. In the coordinates ``z = L' dU`` of the Cholesky factor, ``H = L L'``,
each such move is a projection onto the row's slab.

It needs no factorisation beyond that one and no active set, and rows may depend on each other. It
converges linearly: fast where few rows are active, slowly where active rows meet at small angles
in those coordinates. On random programs its controls agree with daqp's to 3e-8 and its multipliers
to 2e-7, relative to the largest; with a Hessian of condition 1e4, one in eight hits the limit of
sweeps and is `FAILED`.
"""

import math
from dataclasses import replace

import numpy as np

from cmpsp_ros.arrays import Array
from cmpsp_ros.mpsp.jit.compiled import allocation_free
from cmpsp_ros.mpsp.qp.dense.rows import Rows
from cmpsp_ros.mpsp.qp.subproblem import Penalties, QPSolution, QPStatus, Subproblem

SWEEP_LIMIT = 20_000  # sweeps through all rows, at most
TOLERANCE = 1e-10  # a sweep none of whose moves is longer has converged; relative to ``1 + |z|``

# Sweeps between two looks for a proof that the rows contradict each other.
SWEEPS_BETWEEN_CHECKS = 50

# Multipliers that prove no point within so many times ``1 + |z|`` feasible prove infeasibility.
FARTHEST = 1e6

_CONVERGED, _LIMIT, _INFEASIBLE = 0, 1, 2


def solve(subproblem: Subproblem, penalties: Penalties | None) -> QPSolution:
    """Condense and solve; relaxed rows have multipliers clipped at their penalty.

    That clipping is the exact L1 relaxation: its dual differs from that of the hard program by
    ``|multiplier| <= penalty`` and nothing else.

    On rows that contradict each other the multipliers grow for ever, in a direction that proves
    the contradiction (Farkas): `QPStatus.INFEASIBLE` is returned when it does. `QPStatus.FAILED`
    is an indefinite Hessian, data that are not finite, or the iteration limit.
    """
    from scipy.linalg import solve_triangular  # noqa: PLC0415 (slow to import, and seldom needed)

    qp = subproblem.condensed
    given, rows = Rows.of(subproblem, penalties), np.concatenate([qp.rows, np.eye(len(qp.c))])
    lower, upper, cap = given.lower, given.upper, given.weight
    failed = QPSolution.unsolved(subproblem.size, QPStatus.FAILED)
    finite = all(np.isfinite(part).all() for part in (qp.H, qp.c, rows))
    if not finite or np.isnan(lower).any() or np.isnan(upper).any():
        return failed
    if (lower > upper).any():
        return replace(failed, status=QPStatus.INFEASIBLE)
    try:
        L = np.linalg.cholesky(qp.H)
    except np.linalg.LinAlgError:
        return failed

    # Rows without any bound are never active.
    kept = np.flatnonzero(np.isfinite(lower) | np.isfinite(upper))
    V = np.ascontiguousarray(solve_triangular(L, rows[kept].T, lower=True).T)
    start = solve_triangular(L, -qp.c, lower=True)
    shares, z = np.zeros(len(kept)), start.copy()
    end, sweeps = _ascend(
        z, shares, V, lower[kept], upper[kept], cap[kept],
        SWEEP_LIMIT, TOLERANCE, SWEEPS_BETWEEN_CHECKS, FARTHEST, np.zeros((3, len(kept))),
    )  # fmt: skip
    if end != _CONVERGED:
        return replace(failed, status=QPStatus.INFEASIBLE) if end == _INFEASIBLE else failed
    # Afresh from the multipliers: `z` has gathered the rounding of every move.
    dU = solve_triangular(L, start - shares @ V, lower=True, trans='T')
    multipliers = np.zeros(len(rows))
    multipliers[kept] = shares
    return given.solution(subproblem, dU, multipliers, sweeps)


@allocation_free
def _ascend(
    z: Array,
    multipliers: Array,
    V: Array,
    lower: Array,
    upper: Array,
    cap: Array,
    limit: int,
    tolerance: float,
    between_checks: int,
    farthest: float,
    memory: Array,
) -> tuple[int, int]:
    """Maximise the dual of ``min |z - z_0|^2 / 2, lower <= V z <= upper``, in place.

    `z` begins as ``z_0`` and `multipliers` as 0; these are positive at upper bounds, and at most
    `cap` in size. `memory` is 0, shape ``(3, count)``. Returns how it ended, and the sweeps done.
    """
    count, q = V.shape
    square, earlier, direction = memory[0], memory[1], memory[2]
    for i in range(count):
        for j in range(q):
            square[i] += V[i, j] * V[i, j]
    for sweep in range(limit):
        longest = 0.0
        for i in range(count):
            value = 0.0
            for j in range(q):
                value += V[i, j] * z[j]
            if square[i] == 0.0:
                # Nothing moves this row: met, or violated at its full penalty.
                if value <= upper[i] and value >= lower[i]:
                    continue
                if not math.isfinite(cap[i]):
                    return _INFEASIBLE, sweep
                multipliers[i] = cap[i] if value > upper[i] else -cap[i]
                continue
            value += square[i] * multipliers[i]
            multiplier = 0.0
            if value > upper[i]:
                multiplier = min((value - upper[i]) / square[i], cap[i])
            elif value < lower[i]:
                multiplier = max((value - lower[i]) / square[i], -cap[i])
            change = multiplier - multipliers[i]
            if change != 0.0:
                multipliers[i] = multiplier
                for j in range(q):
                    z[j] -= change * V[i, j]
                longest = max(longest, abs(change) * math.sqrt(square[i]))
        size = 1.0
        for j in range(q):
            size += abs(z[j])
        if longest <= tolerance * size:
            return _CONVERGED, sweep + 1
        if (sweep + 1) % between_checks == 0:
            for i in range(count):
                # A row that can give proves nothing.
                change = 0.0 if math.isfinite(cap[i]) else multipliers[i] - earlier[i]
                direction[i], earlier[i] = change, multipliers[i]
            if _proves_infeasible(direction, V, lower, upper, farthest * size):
                return _INFEASIBLE, sweep + 1
    return _LIMIT, limit


@allocation_free
def _proves_infeasible(
    direction: Array, V: Array, lower: Array, upper: Array, farthest: float
) -> bool:
    """True where weights on the rows leave no feasible ``z`` within ``|z| <= farthest``.

    Every feasible ``z`` has ``direction' V z <= support``, the sum of upper bounds times positive
    and lower bounds times negative weights. Where that is negative, ``|z|`` must be at least its
    size over ``|V' direction|``.
    """
    count, q = V.shape
    support = 0.0
    for i in range(count):
        if direction[i] > 0.0:
            support += direction[i] * upper[i]
        elif direction[i] < 0.0:
            support += direction[i] * lower[i]
    if not support < 0.0:
        return False
    pull = 0.0
    for j in range(q):
        total = 0.0
        for i in range(count):
            total += direction[i] * V[i, j]
        pull += total * total
    return bool(-support > farthest * math.sqrt(pull))
