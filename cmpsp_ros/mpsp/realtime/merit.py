"""The exact L1 merit function of a step, and what its linearisation promises."""

from __future__ import annotations

import math

import numpy as np

from cmpsp_ros.mpsp.jit.compiled import allocation_free
from cmpsp_ros.mpsp.realtime.workspace import Trajectory, Workspace
from cmpsp_ros.mpsp.riccati.size import dimension
from cmpsp_ros.mpsp.riccati.stage_qp import Penalty

_ABOVE_MULTIPLIER = 1.1


@allocation_free
def weigh(room: Workspace) -> None:
    """Weights of the step's merit: the penalties, raised where a multiplier is larger.

    Only then is the solution of the subproblem a direction of descent.
    """
    multipliers = room.solver.multipliers
    for j in range(room.merit.terminal.shape[0]):
        least = _ABOVE_MULTIPLIER * abs(multipliers.terminal[j])
        room.merit.terminal[j] = max(room.relaxed.terminal[j], least)
    for k in range(room.merit.path.shape[0]):
        for j in range(room.merit.path.shape[1]):
            least = _ABOVE_MULTIPLIER * multipliers.path[k, j]
            room.merit.path[k, j] = max(room.relaxed.path[k, j], least)


@allocation_free
def violation(weights: Penalty, at: Trajectory) -> float:
    """Weighted violation of the constraints, the part of the merit that is not cost."""
    total = 0.0
    for j in range(at.output_error.shape[0]):
        total += weights.terminal[j] * abs(at.output_error[j])
    for k in range(at.g.shape[0]):
        for j in range(at.g.shape[1]):
            # Not `max`: a number that is not one must show.
            if not at.g[k, j] <= 0.0:
                total += weights.path[k, j] * at.g[k, j]
    return total


@allocation_free
def value(weights: Penalty, at: Trajectory) -> float:
    """Merit of a trajectory; infinite where it is not finite."""
    total = at.cost[0] + violation(weights, at)
    return total if math.isfinite(total) else math.inf


@allocation_free
def magnitude(weights: Penalty, at: Trajectory) -> float:
    """What the rounding of a merit is relative to, its penalties at unit violation."""
    total = abs(at.cost[0])
    for j in range(weights.terminal.shape[0]):
        total += weights.terminal[j]
    return total


@allocation_free
def promised(room: Workspace) -> float:
    """Decrease of the merit that its linearisation promises for the full step.

    Leaves the slack of the linearised constraints in `Workspace.slack`.
    """
    qp, dU, dX, weights, slack = room.qp, room.solver.dU, room.solver.dX, room.merit, room.slack
    n, r = dimension(qp.state), dimension(qp.control)
    N, l = qp.A.shape[0], qp.g.shape[1]  # noqa: E741 (the paper's l)
    decrease = 0.0
    slack[:] = 0.0
    for k in range(N + 1):
        for i in range(n):
            decrease -= qp.L_X[k, i] * dX[k, i]
        for a in range(r):
            decrease -= qp.L_U[k, a] * dU[k, a]
        for j in range(l):
            now = qp.g[k, j]
            if now == -np.inf:
                continue
            then = now
            for i in range(n):
                then += qp.g_X[k, j, i] * dX[k, i]
            for a in range(r):
                then += qp.g_U[k, j, a] * dU[k, a]
            decrease += weights.path[k, j] * (max(now, 0.0) - max(then, 0.0))
            slack[j] = max(slack[j], then)
    for j in range(qp.output_error.shape[0]):
        then = qp.output_error[j]
        for i in range(n):
            then += qp.h_X[j, i] * dX[N, i]
        for a in range(r):
            then += qp.h_U[j, a] * dU[N, a]
        decrease += weights.terminal[j] * (abs(qp.output_error[j]) - abs(then))
        slack[l + j] = abs(then)
    return decrease
