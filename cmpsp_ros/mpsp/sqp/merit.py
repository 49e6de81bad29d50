"""The exact L1 merit function of a step, and the reduction that its linearisation predicts."""

from __future__ import annotations

import math

import numpy as np

from cmpsp_ros.arrays import Array
from cmpsp_ros.mpsp.jit.compiled import allocation_free
from cmpsp_ros.mpsp.qp.riccati.program import Program, product
from cmpsp_ros.mpsp.sqp.workspace import Trajectory

_ABOVE_MULTIPLIER = 1.1
# Violation of a hard constraint that rounding may leave in a step that meets it.
_ROUNDING = 1e-7


@allocation_free
def update_penalties(p: Program) -> None:
    """Weights of the step's merit: the penalties, raised where a multiplier is larger.

    Only then is the solution of the subproblem a direction of descent.
    """
    for j in range(p.terminal.shape[0]):
        row = p.terminal[j]
        row.merit = max(row.weight, _ABOVE_MULTIPLIER * abs(row.multiplier))
    for k in range(p.head[0].horizon + 1):
        for j in range(p.path.shape[1]):
            row = p.path[k, j]
            row.merit = max(row.weight, _ABOVE_MULTIPLIER * row.multiplier)


@allocation_free
def violation(p: Program, at: Trajectory) -> float:
    """Weighted violation of the constraints, the part of the merit that is not cost.

    It is infinite where a hard path constraint, one of infinite weight, is violated.
    """
    total = 0.0
    for j in range(p.terminal.shape[0]):
        total += p.terminal[j].merit * abs(at.output_error[j])
    for k in range(p.head[0].horizon + 1):
        for j in range(p.path.shape[1]):
            # Not `max`, which drops NaN.
            if not at.g[k, j] <= 0.0:
                merit = p.path[k, j].merit
                if not (merit == math.inf and at.g[k, j] <= _ROUNDING):
                    total += merit * at.g[k, j]
    return total


@allocation_free
def merit(p: Program, at: Trajectory, cost: float) -> float:
    """Merit of a trajectory; infinite where it is not finite."""
    total = cost + violation(p, at)
    return total if math.isfinite(total) else math.inf


@allocation_free
def magnitude(p: Program, cost: float) -> float:
    """What the rounding of a merit is relative to: the cost, and penalties at unit violation."""
    total = abs(cost)
    for j in range(p.terminal.shape[0]):
        total += p.terminal[j].merit
    return total


@allocation_free
def predicted_reduction(p: Program, slack: Array) -> float:
    """Decrease of the merit that its linearisation predicts for the full step.

    Args:
        p: The subproblem, solved, with the weights of the merit.
        slack: Filled with the largest slack of each path constraint and of each terminal output
            in the linearised constraints, shape ``(l + m,)``.
    """
    l, decrease = p.path.shape[1], 0.0  # noqa: E741 (the paper's l)
    slack[:] = 0.0
    for k in range(p.head[0].horizon + 1):
        stage = p.stages[k]
        for i in range(stage.dX.shape[0]):
            decrease -= stage.L_X[i] * stage.dX[i]
        for a in range(stage.dU.shape[0]):
            decrease -= stage.L_U[a] * stage.dU[a]
        for j in range(l):
            row = p.path[k, j]
            if row.value == -np.inf:
                continue
            then = row.value + product(row, stage)
            # A hard constraint is met before the step, and after it.
            if row.merit < math.inf:
                decrease += row.merit * (max(row.value, 0.0) - max(then, 0.0))
            slack[j] = max(slack[j], then)
    for j in range(p.terminal.shape[0]):
        row = p.terminal[j]
        then = row.value + product(row, p.stages[p.head[0].horizon])
        decrease += row.merit * (abs(row.value) - abs(then))
        slack[l + j] = abs(then)
    return decrease
