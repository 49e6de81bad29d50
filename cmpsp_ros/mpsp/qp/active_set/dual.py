"""A dual active-set method (Goldfarb and Idnani, 1983) with bounded multipliers.

In the variables of the `factorisation` the program is: find the point nearest to ``v*`` that meets
all rows. The method begins at ``v*`` and adds one violated row after the other, keeping

    v = v* - sum_j lambda_j a_j,    0 <= lambda_j <= penalty_j,

so that the cost rises until nothing is violated. A multiplier that comes back to 0 leaves the
active set. One that reaches its penalty stays there while its row stays violated: this is the
exact L1 relaxation, without slack variables. With an infinite penalty the row is hard.

Goldfarb, D. and Idnani, A.: A numerically stable dual method for solving strictly convex
quadratic programs. Mathematical Programming 27 (1983), 1-33.
"""

from __future__ import annotations

import math
from typing import Any

from cmpsp_ros.mpsp.jit.compiled import allocation_free, inner
from cmpsp_ros.mpsp.qp.active_set.fixed_bounds import MANY
from cmpsp_ros.mpsp.qp.active_set.state import (
    AT_PENALTY,
    IS_ACTIVE,
    IS_IMPLIED,
    IS_OFF,
    TOLERANCE,
    ActiveSet,
    iterative_refinement,
)
from cmpsp_ros.mpsp.qp.active_set.step import CROWDED, DONE, active_set_step
from cmpsp_ros.mpsp.qp.riccati.program import Program, is_bound, load_row, product
from cmpsp_ros.mpsp.qp.riccati.sweeps import recover_step, row_norm


@allocation_free
def add_violated_rows(p: Program, at: ActiveSet, may_crowd: bool) -> int:
    """Meet one violated row after the other, from where the method has begun.

    Args:
        p: The program, factorised, with the step of the present point.
        at: Holds the point, and how it ended.
        may_crowd: Whether to stop where many bounds have become active.

    Returns:
        An outcome of `step.active_set_step`; `DONE` where nothing is violated any more.
    """
    head, bounds = p.head[0], 0
    outcome, looked_at, recovered_at = DONE, -1, head.iterations
    while outcome == DONE:
        row = _furthest(at)
        if row < 0:
            # What has been looked for and brought no iteration is violated by rounding alone.
            if head.iterations == looked_at:
                break
            if head.iterations != recovered_at:
                recover_step(p, at.v)
            looked_at = recovered_at = head.iterations
            if not _find_violated(p, at):
                break
            row = _furthest(at)
        outcome = active_set_step(p, at, row)
        if outcome == DONE and may_crowd and is_bound(p, row):
            bounds += 1
            if bounds > MANY and 2 * _bounds_in_basis(p, at) > head.active:
                return CROWDED
    if outcome == DONE:
        iterative_refinement(p, at)
    return outcome


@inner
def _bounds_in_basis(p: Program, at: ActiveSet) -> int:
    count = 0
    for j in range(p.head[0].active):
        count += int(is_bound(p, at.rows[j]))
    return count


@inner
def _find_violated(p: Program, at: ActiveSet) -> bool:
    """Find the row of each kind that is furthest from being met; returns whether there is any.

    For a row at its penalty the same is asked of its being violated. The rows that differ only in
    their stage are one kind: mostly, the worst of each is needed, and one look at all of them
    costs as much as meeting a few.
    """
    head = p.head[0]
    n, r = p.stages[0].B.shape
    terminal, path = p.terminal.shape[0], p.path.shape[1]
    states, saturated, found = at.states, head.saturated > 0, False
    at.distances[:] = 0.0
    head.work += head.horizon + 1
    if saturated:
        for row in range(terminal):
            excess = product(p.terminal[row], p.stages[head.horizon]) + p.terminal[row].value
            if states[row] == AT_PENALTY:
                excess = -excess
            if states[row] >= AT_PENALTY and excess > TOLERANCE:
                kind = path + r + n + row
                found = _note(p, at, kind, row, excess, p.terminal[row].value) or found
    row = terminal
    for k in range(head.horizon + 1):
        stage = p.stages[k]
        for j in range(path):
            constraint = p.path[k, j]
            excess = constraint.value + product(constraint, stage)
            if saturated and states[row] == AT_PENALTY:
                excess = -excess
            if excess > TOLERANCE and states[row] != IS_ACTIVE:
                found = _note(p, at, j, row, excess, constraint.value) or found
            row += 1
        for a in range(r):
            above, below = stage.dU[a] - stage.upper[a], stage.lower[a] - stage.dU[a]
            if above > TOLERANCE and states[row] == IS_OFF:
                found = _note(p, at, path + a, row, above, stage.upper[a]) or found
            if below > TOLERANCE and states[row + 1] == IS_OFF:
                found = _note(p, at, path + a, row + 1, below, stage.lower[a]) or found
            row += 2
        for i in range(n):
            excess = abs(stage.dX[i]) - head.trust_radius[i]
            if excess > TOLERANCE:
                side = row if stage.dX[i] > 0.0 else row + 1
                if states[side] == IS_OFF:
                    kind = path + r + i
                    found = _note(p, at, kind, side, excess, head.trust_radius[i]) or found
            row += 2
    return found


@inner
def _note(p: Program, at: ActiveSet, kind: int, row: int, excess: float, bound: float) -> bool:
    """Keep a row, if it is violated and further away than any other of its kind."""
    if excess <= TOLERANCE * (1.0 + abs(bound)) or at.states[row] == IS_IMPLIED:
        return False
    if at.norms[row] == 0.0:
        at.norms[row] = row_norm(p, load_row(p, row))
    # A row that nothing moves comes first: it contradicts itself.
    far = excess / at.norms[row] if at.norms[row] > 0.0 else math.inf
    if far > at.distances[kind]:
        at.distances[kind] = far
        at.furthest[kind] = row
    return True


@inner
def _furthest(at: ActiveSet) -> Any:
    """Take out the furthest of the rows that were kept; -1 where none is left."""
    best = 0
    for kind in range(1, at.distances.shape[0]):
        if at.distances[kind] > at.distances[best]:
            best = kind
    if at.distances[best] == 0.0:
        return -1
    at.distances[best] = 0.0
    return at.furthest[best]
