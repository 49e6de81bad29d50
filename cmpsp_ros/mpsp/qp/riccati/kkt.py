"""How far a point is from the optimality conditions, by data that no solver has touched.

`max` drops NaN, a sum propagates it: both are kept of everything that is looked at, of each stage
by itself, since a processor works on several stages side by side only where one need not wait for
the last one's sum.
"""

from __future__ import annotations

import math
from typing import Any

from cmpsp_ros.mpsp.jit.compiled import allocation_free, inner
from cmpsp_ros.mpsp.qp.riccati.program import Program, product


@allocation_free
def kkt_residual(p: Program) -> float:
    """Largest violation of the optimality conditions, relative to the size of the data.

    Covers stationarity, feasibility (of the rows that are hard), signs of multipliers, and
    complementarity, in which a relaxed row may be violated only at its full penalty. Stationarity
    and multipliers are relative to 1 plus the largest part of the gradient, feasibility to 1 plus
    the largest control deviation.

    Args:
        p: The program, with a step, its linearised states and all multipliers.

    Returns:
        The residual; NaN where the data or the point are.
    """
    p.head[0].work += 3 * (p.head[0].horizon + 1)
    stationarity, scale, sum_of_gradients = _stationarity(p)
    violation, sign, gap, sum_of_rows = _rows(p)
    reach, sum_of_controls = 1.0, 0.0
    for k in range(p.head[0].horizon + 1):
        stage = p.stages[k]
        for a in range(stage.dU.shape[0]):
            reach = max(reach, 1.0 + abs(stage.dU[a]))
            sum_of_controls += stage.dU[a]
    largest = stationarity + scale + reach + violation + sign + gap
    if not math.isfinite(largest + sum_of_gradients + sum_of_rows + sum_of_controls):
        return math.nan
    worst = max(stationarity / scale, violation / reach)
    return max(worst, sign / scale, gap / (scale * reach))


@inner
def _stationarity(p: Program) -> Any:
    """Largest component of the Lagrangian's gradient, 1 plus that of any of its parts, their sum.

    The parts are cost, rows and bounds; the first two are an adjoint sweep each,
    ``p_k = X_k + A' p_(k+1)``, with the gradient ``U_k + B' p_(k+1)``.
    """
    head, l = p.head[0], p.path.shape[1]  # noqa: E741 (the paper's l)
    n, r = p.stages[0].B.shape
    N = head.horizon
    # Costates of the cost and of the rows, and those of the stage after.
    cost_now, rows_now, cost_next, rows_next = head.X, head.X_next, head.PA[0], head.p
    for i in range(n):
        cost_now[i] = rows_now[i] = 0.0
    worst, largest, total = 0.0, 0.0, 0.0
    for k in range(N, -1, -1):
        stage = p.stages[k]
        worst_here, largest_here, total_here = 0.0, 0.0, 0.0
        for a in range(r):
            cost, rows, bound = stage.L_U[a], 0.0, stage.bounds[a]
            for i in range(n):
                cost += stage.L_UX[a, i] * stage.dX[i]
            for b in range(r):
                cost += stage.L_UU[a, b] * stage.dU[b]
            for j in range(l):
                rows += p.path[k, j].U[a] * p.path[k, j].multiplier
            if k == N:
                for j in range(p.terminal.shape[0]):
                    rows += p.terminal[j].U[a] * p.terminal[j].multiplier
            else:
                for i in range(n):
                    cost += stage.B[i, a] * cost_now[i]
                    rows += stage.B[i, a] * rows_now[i]
            worst_here = max(worst_here, abs(cost + rows + bound))
            largest_here = max(largest_here, abs(cost), abs(rows), abs(bound))
            total_here += cost + rows + bound
        worst, largest = max(worst, worst_here), max(largest, largest_here)
        total += total_here
        for i in range(n):
            cost_next[i], rows_next[i] = cost_now[i], rows_now[i]
        for i in range(n):
            cost, rows = stage.L_X[i], stage.trust[i]
            for j in range(n):
                cost += stage.L_XX[i, j] * stage.dX[j]
            for a in range(r):
                cost += stage.L_UX[a, i] * stage.dU[a]
            for j in range(l):
                rows += p.path[k, j].X[i] * p.path[k, j].multiplier
            if k == N:
                for j in range(p.terminal.shape[0]):
                    rows += p.terminal[j].X[i] * p.terminal[j].multiplier
            else:
                for j in range(n):
                    cost += stage.A[j, i] * cost_next[j]
                    rows += stage.A[j, i] * rows_next[j]
            cost_now[i], rows_now[i] = cost, rows
    # No control has a part in the first state's costate; NaN shows in it still.
    for i in range(n):
        total += cost_now[i] + rows_now[i]
    return worst, 1.0 + largest, total


@inner
def _rows(p: Program) -> Any:
    """Largest violation of a hard row, wrong sign or excess of a multiplier, slackness gap, sum."""
    N = p.head[0].horizon
    violation, sign, gap, total = 0.0, 0.0, 0.0, 0.0
    for j in range(p.terminal.shape[0]):
        row = p.terminal[j]
        miss = row.value + product(row, p.stages[N])
        total += miss + row.multiplier
        if row.penalty == math.inf:
            violation = max(violation, abs(miss))
        else:
            sign = max(sign, abs(row.multiplier) - row.penalty)
            gap = max(gap, abs(abs(miss) * row.penalty - miss * row.multiplier))
            total += row.penalty
    for k in range(N + 1):
        violation_here, sign_here, gap_here, total_here = _rows_of_stage(p, k)
        violation, sign = max(violation, violation_here), max(sign, sign_here)
        gap = max(gap, gap_here)
        total += total_here
    return violation, sign, gap, total


@inner
def _rows_of_stage(p: Program, k: int) -> Any:
    stage, radius = p.stages[k], p.head[0].trust_radius
    violation, sign, gap, total = 0.0, 0.0, 0.0, 0.0
    for j in range(p.path.shape[1]):
        row = p.path[k, j]
        value, multiplier = row.value, row.multiplier
        sign = max(sign, abs(multiplier) if value == -math.inf else -multiplier)
        if value == -math.inf:
            continue
        value += product(row, stage)
        total += value + multiplier
        if row.penalty == math.inf:
            violation = max(violation, value)
            gap = max(gap, abs(multiplier * value))
        else:
            slack = max(value, 0.0)
            total += row.penalty
            sign = max(sign, multiplier - row.penalty)
            gap = max(gap, abs(multiplier * (value - slack)))
            gap = max(gap, abs(slack * (row.penalty - multiplier)))
    for a in range(stage.dU.shape[0]):
        multiplier = stage.bounds[a]
        above, below = stage.dU[a] - stage.upper[a], stage.lower[a] - stage.dU[a]
        violation = max(violation, above, below)
        total += multiplier if stage.lower[a] <= stage.upper[a] else math.nan
        if multiplier != 0.0:
            gap = max(gap, abs(multiplier * (above if multiplier > 0.0 else below)))
    if k == 0:
        return violation, sign, gap, total
    for i in range(stage.dX.shape[0]):
        multiplier = stage.trust[i]
        outside = abs(stage.dX[i]) - radius[i]
        violation = max(violation, outside)
        total += stage.dX[i] + multiplier if radius[i] >= 0.0 else math.nan
        if multiplier != 0.0:
            side = 1.0 if multiplier > 0.0 else -1.0
            gap = max(gap, abs(multiplier * (side * stage.dX[i] - radius[i])))
    return violation, sign, gap, total
