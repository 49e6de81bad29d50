"""Residual of the optimality conditions, from data that no solver has touched.

`max` drops NaN, a sum propagates it: both are kept of everything that is looked at, of each stage
by itself, since a processor works on several stages side by side only where one need not wait for
the last one's sum.
"""

import math
from typing import Any

from cmpsp_ros.arrays import Array
from cmpsp_ros.mpsp.jit.compiled import allocation_free, inner
from cmpsp_ros.mpsp.jit.intrinsics import room_for
from cmpsp_ros.mpsp.qp.riccati.program import Program, add_cost_gradient, add_row_gradient, product


@allocation_free
def kkt_residual(p: Program) -> float:
    """Largest violation of the optimality conditions, relative to the data; NaN where they are.

    Covers stationarity, feasibility (of the rows that are hard), signs of multipliers, and
    complementarity, in which a relaxed row may be violated only at its full penalty. Stationarity
    and multipliers are relative to 1 plus the largest part of the gradient, feasibility to 1 plus
    the largest control deviation.

    The gradient of the Lagrangian has parts of cost, rows and bounds; the first two are an adjoint
    sweep each, ``p_k = X_k + A' p_(k+1)``, with the gradient ``U_k + B' p_(k+1)``.
    """
    head, first = p.head[0], p.stages[0]
    n, r = first.B.shape
    N = head.horizon
    head.work += 3 * (N + 1)
    # Costates of the cost and of the rows, those of the stage before, and gradients of the rows.
    cost, rows = room_for(first.L_X), room_for(first.L_X)
    cost_before, rows_before = room_for(first.L_X), room_for(first.L_X)
    cost_U, rows_U = room_for(first.L_U), room_for(first.L_U)
    stationarity, scale, reach = 0.0, 1.0, 1.0
    violation, sign, gap, total = 0.0, 0.0, 0.0, 0.0
    for i in range(n):
        cost[i] = rows[i] = 0.0
    for k in range(N, -1, -1):
        stage = p.stages[k]
        for i in range(n):
            cost_before[i], rows_before[i] = 0.0, stage.trust[i]
        for a in range(r):
            cost_U[a] = rows_U[a] = 0.0
        add_cost_gradient(stage, cost_before, cost_U)
        if k == N:
            for j in range(p.terminal.shape[0]):
                row = p.terminal[j]
                parts = _terminal_row(row, stage)
                violation, sign = max(violation, parts[0]), max(sign, parts[1])
                gap, total = max(gap, parts[2]), total + parts[3]
                add_row_gradient(row, rows_before, rows_U)
        for j in range(p.path.shape[1]):
            row = p.path[k, j]
            parts = _path_row(row, stage)
            violation, sign = max(violation, parts[0]), max(sign, parts[1])
            gap, total = max(gap, parts[2]), total + parts[3]
            if row.multiplier != 0.0:
                add_row_gradient(row, rows_before, rows_U)
        parts = _limits(stage, head.trust_radius, k > 0)
        violation, gap, total = max(violation, parts[0]), max(gap, parts[1]), total + parts[2]
        for a in range(r):
            of_cost, of_rows = cost_U[a], rows_U[a]
            if k < N:
                for i in range(n):
                    of_cost += stage.B[i, a] * cost[i]
                    of_rows += stage.B[i, a] * rows[i]
            whole = of_cost + of_rows + stage.bounds[a]
            stationarity = max(stationarity, abs(whole))
            scale = max(scale, 1.0 + max(abs(of_cost), abs(of_rows), abs(stage.bounds[a])))
            reach = max(reach, 1.0 + abs(stage.dU[a]))
            total += whole + stage.dU[a]
        if k < N:
            for i in range(n):
                for j in range(n):
                    cost_before[i] += stage.A[j, i] * cost[j]
                    rows_before[i] += stage.A[j, i] * rows[j]
        for i in range(n):
            cost[i], rows[i] = cost_before[i], rows_before[i]
    # No control has a part in the first state's costate; NaN shows in it still.
    for i in range(n):
        total += cost[i] + rows[i]
    if not math.isfinite(total + stationarity + scale + reach + violation + sign + gap):
        return math.nan
    worst = max(stationarity / scale, violation / reach)
    return max(worst, sign / scale, gap / (scale * reach))


@inner
def _terminal_row(row: Any, stage: Any) -> Any:
    """Violation where hard, wrong size of the multiplier, slackness gap, sum."""
    miss = row.value + product(row, stage)
    if row.penalty == math.inf:
        return abs(miss), 0.0, 0.0, miss + row.multiplier
    gap = abs(abs(miss) * row.penalty - miss * row.multiplier)
    return 0.0, abs(row.multiplier) - row.penalty, gap, miss + row.multiplier + row.penalty


@inner
def _path_row(row: Any, stage: Any) -> Any:
    """As `_terminal_row`."""
    multiplier = row.multiplier
    if row.value == -math.inf:
        return 0.0, abs(multiplier), 0.0, multiplier
    value = row.value + product(row, stage)
    if row.penalty == math.inf:
        return value, -multiplier, abs(multiplier * value), value + multiplier
    slack = max(value, 0.0)
    gap = max(abs(multiplier * (value - slack)), abs(slack * (row.penalty - multiplier)))
    sign = max(-multiplier, multiplier - row.penalty)
    return 0.0, sign, gap, value + multiplier + row.penalty


@inner
def _limits(stage: Any, radius: Array, bounds_states: bool) -> Any:
    """Violation of bounds and trust region, slackness gap, sum."""
    violation, gap, total = 0.0, 0.0, 0.0
    for a in range(stage.dU.shape[0]):
        multiplier = stage.bounds[a]
        above, below = stage.dU[a] - stage.upper[a], stage.lower[a] - stage.dU[a]
        violation = max(violation, above, below)
        total += multiplier if stage.lower[a] <= stage.upper[a] else math.nan
        if multiplier != 0.0:
            gap = max(gap, abs(multiplier * (above if multiplier > 0.0 else below)))
    if bounds_states:
        for i in range(stage.dX.shape[0]):
            multiplier = stage.trust[i]
            violation = max(violation, abs(stage.dX[i]) - radius[i])
            total += stage.dX[i] + multiplier if radius[i] >= 0.0 else math.nan
            if multiplier != 0.0:
                side = 1.0 if multiplier > 0.0 else -1.0
                gap = max(gap, abs(multiplier * (side * stage.dX[i] - radius[i])))
    return violation, gap, total
