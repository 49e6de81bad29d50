"""How far a point is from the optimality conditions, by data that no solver has touched.

The largest of several numbers is found by `numpy.maximum`: unlike `max`, it cannot lose one that
is not a number.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from cmpsp_ros.mpsp.compiled import allocation_free
from cmpsp_ros.mpsp.problem import Array
from cmpsp_ros.mpsp.riccati.size import dimension
from cmpsp_ros.mpsp.riccati.stage_qp import Multipliers, Penalty, StageQP


@allocation_free
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
    stationarity, scale = _stationarity(qp, dU, dX, multipliers, costates)
    reach = 1.0
    for k in range(dU.shape[0]):
        for a in range(dimension(qp.control)):
            reach = np.maximum(reach, 1.0 + abs(dU[k, a]))
    violation, sign, gap = _rows(qp, penalty, dU, dX, multipliers)
    if not math.isfinite(scale + reach + stationarity + violation + sign + gap):
        return math.nan
    worst = max(stationarity / scale, violation / reach)
    return max(worst, sign / scale, gap / (scale * reach))


@allocation_free
def _stationarity(
    qp: StageQP, dU: Array, dX: Array, multipliers: Multipliers, costates: Array
) -> Any:
    """Largest component of the Lagrangian's gradient, and 1 plus that of any of its parts.

    The parts are cost, rows and bounds; the first two are an adjoint sweep each,
    ``p_k = s_k + A' p_(k+1)``, with the gradient ``d_k + B' p_(k+1)``.
    """
    n, r = dimension(qp.state), dimension(qp.control)
    N = qp.A.shape[0]
    # Costates of the cost and of the rows.
    p, rho, p_next, rho_next = costates[0], costates[1], costates[2], costates[3]
    for i in range(n):
        p[i] = rho[i] = 0.0
    worst, largest = 0.0, 0.0
    for k in range(N, -1, -1):
        for a in range(r):
            cost, pull = qp.L_U[k, a], 0.0
            for i in range(n):
                cost += qp.L_UX[k, a, i] * dX[k, i]
            for b in range(r):
                cost += qp.L_UU[k, a, b] * dU[k, b]
            for j in range(qp.g.shape[1]):
                if multipliers.path[k, j] != 0.0:
                    pull += qp.g_U[k, j, a] * multipliers.path[k, j]
            if k == N:
                for j in range(qp.output_error.shape[0]):
                    pull += qp.h_U[j, a] * multipliers.terminal[j]
            else:
                for i in range(n):
                    cost += qp.B[k, i, a] * p[i]
                    pull += qp.B[k, i, a] * rho[i]
            bound = multipliers.bounds[k, a]
            worst = np.maximum(worst, abs(cost + pull + bound))
            largest = np.maximum(largest, max(abs(cost), abs(pull), abs(bound)))
        for i in range(n):
            p_next[i], rho_next[i] = p[i], rho[i]
        for i in range(n):
            cost, pull = qp.L_X[k, i], multipliers.trust[k, i]
            for j in range(n):
                cost += qp.L_XX[k, i, j] * dX[k, j]
            for a in range(r):
                cost += qp.L_UX[k, a, i] * dU[k, a]
            for j in range(qp.g.shape[1]):
                if multipliers.path[k, j] != 0.0:
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
        worst += 0.0 * (p[i] + rho[i])
    return worst, 1.0 + largest


@allocation_free
def _rows(qp: StageQP, penalty: Penalty, dU: Array, dX: Array, multipliers: Multipliers) -> Any:
    """Largest violation of a hard row, wrong sign or excess of a multiplier, and slackness gap."""
    n, r = dimension(qp.state), dimension(qp.control)
    N = qp.A.shape[0]
    violation, sign, gap = 0.0, 0.0, 0.0
    for j in range(qp.output_error.shape[0]):
        miss = qp.output_error[j]
        for i in range(n):
            miss += qp.h_X[j, i] * dX[N, i]
        for a in range(r):
            miss += qp.h_U[j, a] * dU[N, a]
        weight, multiplier = penalty.terminal[j], multipliers.terminal[j]
        if weight == np.inf:
            violation = np.maximum(violation, abs(miss))
        else:
            sign = np.maximum(sign, abs(multiplier) - weight)
            gap = np.maximum(gap, abs(abs(miss) * weight - miss * multiplier))
    for k in range(N + 1):
        for j in range(qp.g.shape[1]):
            value, multiplier = qp.g[k, j], multipliers.path[k, j]
            if value == -np.inf:
                sign = np.maximum(sign, abs(multiplier))
                continue
            for i in range(n):
                value += qp.g_X[k, j, i] * dX[k, i]
            for a in range(r):
                value += qp.g_U[k, j, a] * dU[k, a]
            weight = penalty.path[k, j]
            sign = np.maximum(sign, -multiplier)
            if weight == np.inf:
                violation = np.maximum(violation, value)
                gap = np.maximum(gap, abs(multiplier * value))
            else:
                sign = np.maximum(sign, multiplier - weight)
                slack = np.maximum(value, 0.0)
                gap = np.maximum(gap, abs(multiplier * (value - slack)))
                gap = np.maximum(gap, abs(slack * (weight - multiplier)))
        for a in range(r):
            multiplier = multipliers.bounds[k, a]
            above, below = dU[k, a] - qp.upper[k, a], qp.lower[k, a] - dU[k, a]
            violation = np.maximum(violation, np.maximum(above, below))
            if multiplier > 0.0:
                gap = np.maximum(gap, abs(multiplier * above))
            elif multiplier < 0.0:
                gap = np.maximum(gap, abs(multiplier * below))
        if k == 0:
            continue
        for i in range(n):
            outside = abs(dX[k, i]) - qp.trust_radius[i]
            violation = np.maximum(violation, outside)
            multiplier = multipliers.trust[k, i]
            if multiplier > 0.0:
                gap = np.maximum(gap, abs(multiplier * (dX[k, i] - qp.trust_radius[i])))
            elif multiplier < 0.0:
                gap = np.maximum(gap, abs(multiplier * (dX[k, i] + qp.trust_radius[i])))
    return violation, sign, gap
