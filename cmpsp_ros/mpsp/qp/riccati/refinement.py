"""Taking rounding out of a solution of the active-set method."""

from __future__ import annotations

from cmpsp_ros.mpsp.jit.compiled import allocation_free
from cmpsp_ros.mpsp.qp.riccati.active_set import ActiveSet, apply_multiplier, saturated_multiplier
from cmpsp_ros.mpsp.qp.riccati.basis import solve, solve_transposed
from cmpsp_ros.mpsp.qp.riccati.factorisation import recover_step
from cmpsp_ros.mpsp.qp.riccati.program import Program, limit, row_value

# Rows off by more than this, relative to 1 plus their right-hand side, are refined.
_OFF = 1e-12


@allocation_free
def iterative_refinement(p: Program, at: ActiveSet) -> None:
    """Take rounding out of the active rows: one step of iterative refinement."""
    count, is_off = p.head[0].active, False
    for j in range(count):
        bound, _ = limit(p, at.rows[j])
        at.inside[j] = row_value(p, at.rows[j]) - bound
        is_off = is_off or abs(at.inside[j]) > _OFF * (1.0 + abs(bound))
    if not is_off:
        return
    solve_transposed(at.basis, count, at.inside, at.dependence)
    for j in range(count):
        at.inside[j] = at.dependence[j]
        Q = at.basis.Q[j]
        for i in range(at.v.shape[0]):
            at.v[i] -= at.inside[j] * Q[i]
    solve(at.basis, count, at.inside, at.dependence)
    for j in range(count):
        at.multipliers[j] += at.dependence[j]
    recover_step(p, at.v)


@allocation_free
def recompute_primal(p: Program, at: ActiveSet) -> None:
    """``v`` from the multipliers, without the rounding of the way to it."""
    head, r = p.head[0], p.stages[0].B.shape[1]
    for k in range(head.horizon + 1):
        for a in range(r):
            at.v[k * r + a] = p.stages[k].optimum[a]
    for j in range(head.active):
        apply_multiplier(p, at, at.rows[j], at.multipliers[j])
    if head.saturated > 0:
        for row in range(at.states.shape[0]):
            multiplier = saturated_multiplier(p, at, row)
            if multiplier != 0.0:
                apply_multiplier(p, at, row, multiplier)
