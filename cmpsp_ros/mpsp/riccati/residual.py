"""How far a point is from the optimality conditions, by data that no solver has touched.

The largest of several numbers may lose one that is not a number; their sum cannot. So both are
kept of everything that is looked at: of each stage by itself, since a processor works on several
stages side by side only where one need not wait for the last one's sum.
"""

from __future__ import annotations

import math
from typing import Any

from cmpsp_ros.mpsp.jit.compiled import inlined
from cmpsp_ros.mpsp.problem import Array
from cmpsp_ros.mpsp.riccati.size import dimension
from cmpsp_ros.mpsp.riccati.stage_qp import Multipliers, Penalty, StageQP


@inlined
def kkt_residual(
    qp: StageQP,
    penalty: Penalty,
    dU: Array,
    dX: Array,
    multipliers: Multipliers,
    costates: Array,
) -> float:
    """Largest violation of the optimality conditions, relative to the size of the data.

    Covers stationarity, feasibility (of the rows that are hard), signs of multipliers, and
    complementarity, in which a relaxed row may be violated only at its full penalty. Stationarity
    and multipliers are relative to 1 plus the largest part of the gradient, feasibility to 1 plus
    the largest control deviation.

    Args:
        qp: The program.
        penalty: Largest multipliers, ``inf`` where a row is hard.
        dU: Control deviations, shape ``(N + 1, r)``.
        dX: Their linearised states (see `propagate`), shape ``(N + 1, n)``.
        multipliers: Multipliers of all rows.
        costates: Scratch, shape ``(4, n)``.

    Returns:
        The residual; not a number where the data or the point are not.
    """
    stationarity, scale, sum_of_gradients = _stationarity(qp, dU, dX, multipliers, costates)
    violation, sign, gap, sum_of_rows = _rows(qp, penalty, dU, dX, multipliers)
    reach, sum_of_controls = 1.0, 0.0
    for k in range(dU.shape[0]):
        for a in range(dimension(qp.control)):
            reach = max(reach, 1.0 + abs(dU[k, a]))
            sum_of_controls += dU[k, a]
    largest = stationarity + scale + reach + violation + sign + gap
    if not math.isfinite(largest + sum_of_gradients + sum_of_rows + sum_of_controls):
        return math.nan
    worst = max(stationarity / scale, violation / reach)
    return max(worst, sign / scale, gap / (scale * reach))


@inlined
def _stationarity(
    qp: StageQP, dU: Array, dX: Array, multipliers: Multipliers, costates: Array
) -> Any:
    """Largest component of the Lagrangian's gradient, 1 plus that of any of its parts, their sum.

    The parts are cost, rows and bounds; the first two are an adjoint sweep each,
    ``p_k = s_k + A' p_(k+1)``, with the gradient ``d_k + B' p_(k+1)``.
    """
    n, r = dimension(qp.state), dimension(qp.control)
    N = qp.A.shape[0]
    # Costates of the cost and of the rows.
    p, rho, p_next, rho_next = costates[0], costates[1], costates[2], costates[3]
    for i in range(n):
        p[i] = rho[i] = 0.0
    worst, largest, total = 0.0, 0.0, 0.0
    for k in range(N, -1, -1):
        worst_here, largest_here, total_here = 0.0, 0.0, 0.0
        for a in range(r):
            cost, pull, bound = qp.L_U[k, a], 0.0, multipliers.bounds[k, a]
            for i in range(n):
                cost += qp.L_UX[k, a, i] * dX[k, i]
            for b in range(r):
                cost += qp.L_UU[k, a, b] * dU[k, b]
            for j in range(qp.g.shape[1]):
                pull += qp.g_U[k, j, a] * multipliers.path[k, j]
            if k == N:
                for j in range(qp.output_error.shape[0]):
                    pull += qp.h_U[j, a] * multipliers.terminal[j]
            else:
                for i in range(n):
                    cost += qp.B[k, i, a] * p[i]
                    pull += qp.B[k, i, a] * rho[i]
            worst_here = max(worst_here, abs(cost + pull + bound))
            largest_here = max(largest_here, abs(cost), abs(pull), abs(bound))
            total_here += cost + pull + bound
        worst, largest = max(worst, worst_here), max(largest, largest_here)
        total += total_here
        for i in range(n):
            p_next[i], rho_next[i] = p[i], rho[i]
        for i in range(n):
            cost, pull = qp.L_X[k, i], multipliers.trust[k, i]
            for j in range(n):
                cost += qp.L_XX[k, i, j] * dX[k, j]
            for a in range(r):
                cost += qp.L_UX[k, a, i] * dU[k, a]
            for j in range(qp.g.shape[1]):
                pull += qp.g_X[k, j, i] * multipliers.path[k, j]
            if k == N:
                for j in range(qp.output_error.shape[0]):
                    pull += qp.h_X[j, i] * multipliers.terminal[j]
            else:
                for j in range(n):
                    cost += qp.A[k, j, i] * p_next[j]
                    pull += qp.A[k, j, i] * rho_next[j]
            p[i], rho[i] = cost, pull
    # No control has a part in the first state's costate; what is not a number shows in it still.
    for i in range(n):
        total += p[i] + rho[i]
    return worst, 1.0 + largest, total


@inlined
def _rows(qp: StageQP, penalty: Penalty, dU: Array, dX: Array, multipliers: Multipliers) -> Any:
    """Largest violation of a hard row, wrong sign or excess of a multiplier, slackness gap, sum."""
    n, r = dimension(qp.state), dimension(qp.control)
    N = qp.A.shape[0]
    violation, sign, gap, total = 0.0, 0.0, 0.0, 0.0
    for j in range(qp.output_error.shape[0]):
        miss, weight, multiplier = qp.output_error[j], penalty.terminal[j], multipliers.terminal[j]
        for i in range(n):
            miss += qp.h_X[j, i] * dX[N, i]
        for a in range(r):
            miss += qp.h_U[j, a] * dU[N, a]
        total += miss + multiplier
        if weight == math.inf:
            violation = max(violation, abs(miss))
        else:
            sign = max(sign, abs(multiplier) - weight)
            gap = max(gap, abs(abs(miss) * weight - miss * multiplier))
            total += weight
    for k in range(N + 1):
        violation_here, sign_here, gap_here, total_here = _rows_of_stage(
            qp, penalty, dU, dX, multipliers, k
        )
        violation, sign = max(violation, violation_here), max(sign, sign_here)
        gap = max(gap, gap_here)
        total += total_here
    return violation, sign, gap, total


@inlined
def _rows_of_stage(
    qp: StageQP, penalty: Penalty, dU: Array, dX: Array, multipliers: Multipliers, k: int
) -> Any:
    n, r = dimension(qp.state), dimension(qp.control)
    violation, sign, gap, total = 0.0, 0.0, 0.0, 0.0
    for j in range(qp.g.shape[1]):
        value, weight, multiplier = qp.g[k, j], penalty.path[k, j], multipliers.path[k, j]
        sign = max(sign, abs(multiplier) if value == -math.inf else -multiplier)
        if value == -math.inf:
            continue
        for i in range(n):
            value += qp.g_X[k, j, i] * dX[k, i]
        for a in range(r):
            value += qp.g_U[k, j, a] * dU[k, a]
        total += value + multiplier
        if weight == math.inf:
            violation = max(violation, value)
            gap = max(gap, abs(multiplier * value))
        else:
            slack = max(value, 0.0)
            total += weight
            sign = max(sign, multiplier - weight)
            gap = max(gap, abs(multiplier * (value - slack)))
            gap = max(gap, abs(slack * (weight - multiplier)))
    for a in range(r):
        multiplier = multipliers.bounds[k, a]
        above, below = dU[k, a] - qp.upper[k, a], qp.lower[k, a] - dU[k, a]
        violation = max(violation, above, below)
        total += multiplier if qp.lower[k, a] <= qp.upper[k, a] else math.nan
        if multiplier != 0.0:
            gap = max(gap, abs(multiplier * (above if multiplier > 0.0 else below)))
    if k == 0:
        return violation, sign, gap, total
    for i in range(n):
        multiplier = multipliers.trust[k, i]
        outside = abs(dX[k, i]) - qp.trust_radius[i]
        violation = max(violation, outside)
        total += dX[k, i] + multiplier if qp.trust_radius[i] >= 0.0 else math.nan
        if multiplier != 0.0:
            side = 1.0 if multiplier > 0.0 else -1.0
            gap = max(gap, abs(multiplier * (side * dX[k, i] - qp.trust_radius[i])))
    return violation, sign, gap, total
