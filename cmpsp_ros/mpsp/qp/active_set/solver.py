"""From a program to its solution: which bounds to hold, the active-set method, and the check."""

from __future__ import annotations

from typing import Final

from cmpsp_ros.mpsp.jit.compiled import allocation_free, inner
from cmpsp_ros.mpsp.qp.active_set.dual import add_violated_rows
from cmpsp_ros.mpsp.qp.active_set.farkas import leave_proof, still_contradicts
from cmpsp_ros.mpsp.qp.active_set.fixed_bounds import (
    fix_from,
    free_all,
    hold_violated,
    release_wrong,
    restart_from,
)
from cmpsp_ros.mpsp.qp.active_set.state import IS_OFF, ActiveSet, Indices, on_horizon
from cmpsp_ros.mpsp.qp.active_set.step import CONTRADICTION, CROWDED, DONE, FULL, RELEASED
from cmpsp_ros.mpsp.qp.active_set.warm_start import begin, leave_warm_start, shift_warm_start
from cmpsp_ros.mpsp.qp.riccati.factorisation import factorise
from cmpsp_ros.mpsp.qp.riccati.kkt import kkt_residual
from cmpsp_ros.mpsp.qp.riccati.outcome import INFEASIBLE, ITERATION_LIMIT, NO_CURVATURE, SOLVED
from cmpsp_ros.mpsp.qp.riccati.program import Program, product
from cmpsp_ros.mpsp.qp.riccati.sweeps import keep_origin

TOLERANCE: Final = 1e-8
"""Largest residual (see `kkt_residual`) of a solution."""

# Sweeps that improve the guess of which bounds to hold, before rows are added one by one: at most
# so many, and so many that change no fewer bounds than the best before. More would go in circles.
_SWEEPS, _PATIENCE = 10, 2


@allocation_free
def solve(p: Program, whole: ActiveSet, warm: Indices) -> int:
    """Solve a program.

    A guess of the bounds to hold is put right under way. The answer of the active-set method is
    believed only if it meets the optimality conditions, or proves that nothing meets all rows. A
    doubtful one is looked for once more from scratch.

    Args:
        p: The program; filled with the solution.
        whole: Memory for the active-set method.
        warm: Rows to begin with. They change the way to the solution, not the solution. Those of
            this solution are left in it.

    Returns:
        `SOLVED`, `INFEASIBLE`, `NO_CURVATURE`, or `ITERATION_LIMIT` where work or room ran out.
    """
    head, warm_started = p.head[0], warm[0] > 0
    sweeps, in_vain, fewest = 0, 0, p.stages.shape[0] * p.stages[0].B.shape[1]
    head.iterations = head.active = head.saturated = 0
    at = on_horizon(p, whole)
    shift_warm_start(p, warm)
    if still_contradicts(p, at, warm):
        return INFEASIBLE
    fix_from(p, warm)
    while head.work <= head.work_limit:
        if head.is_factorised == 0 and not factorise(p):
            return NO_CURVATURE
        keep_origin(p, at.v)
        begin(p, at, warm)
        # After so many sweeps bounds are only let go, which happens a finite number of times.
        sweeps += 1
        guesses = sweeps <= _SWEEPS and in_vain < _PATIENCE
        # Sweeps would go to and fro between holding so many bounds and none.
        is_stuck = guesses and head.fixed > 0 and _misses_terminal(p, at)
        if guesses and not is_stuck:
            changed = release_wrong(p, at) if head.fixed > 0 else 0
            changed += hold_violated(p)
            if changed > 0:
                in_vain += int(changed >= fewest)
                fewest = min(fewest, changed)
                restart_from(p, at, warm, guesses)
                continue
        outcome = add_violated_rows(p, at, guesses)
        if outcome == DONE and release_wrong(p, at) > 0:
            outcome = RELEASED
        if outcome == FULL and head.fixed > 0 and head.work <= head.work_limit:
            # Rows pile up against bounds that should not be held.
            free_all(p)
            sweeps, guesses, outcome = _SWEEPS, False, RELEASED
        if outcome in (RELEASED, CROWDED):
            restart_from(p, at, warm, guesses)
            continue
        leave_warm_start(p, at, warm)
        if outcome == DONE and kkt_residual(p) <= TOLERANCE:
            return SOLVED
        if outcome == CONTRADICTION and (head.is_proved == 1 or not warm_started):
            leave_proof(p, at, warm)
            return INFEASIBLE
        if not warm_started:
            return ITERATION_LIMIT
        warm_started, warm[0], sweeps, in_vain = False, 0, 0, 0
        free_all(p)
    return ITERATION_LIMIT


@inner
def _misses_terminal(p: Program, at: ActiveSet) -> bool:
    """Whether the bounds that are held leave a terminal row no freedom to be met."""
    for row in range(p.terminal.shape[0]):
        if at.states[row] == IS_OFF:
            value = p.terminal[row].value
            missed = value + product(p.terminal[row], p.stages[p.head[0].horizon])
            if abs(missed) > TOLERANCE * (1.0 + abs(value)):
                return True
    return False
