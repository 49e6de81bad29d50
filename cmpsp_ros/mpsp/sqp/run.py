"""The iteration of a compiled problem with the compiled solver, in one call from Python."""

from __future__ import annotations

from typing import Any

from cmpsp_ros.mpsp.jit.addresses import call, call_for_float, call_for_int
from cmpsp_ros.mpsp.jit.compiled import allocation_free
from cmpsp_ros.mpsp.qp.active_set.state import ActiveSet, Indices
from cmpsp_ros.mpsp.sqp.workspace import CORRECT, EVALUATE, LINEARISE, SOLVE_QP, Workspace


@allocation_free
def run(
    ws: Workspace,
    active: ActiveSet,
    hard: Indices,
    relaxed: Indices,
    solver: Indices,
    problem: Indices,
    data: Any,
) -> None:
    """Provide what the iteration asks for until it is over, or the Hessian lacks curvature.

    Args:
        ws: The workspace.
        active: Memory for the active-set method.
        hard: Warm start of subproblems without slack.
        relaxed: Warm start of relaxed ones.
        solver: Addresses of `advance`, `solve` and `correct`.
        problem: Addresses of predict, evaluate and linearise.
        data: The problem's.
    """
    state, p, now, trial = ws.run[0], ws.program, ws.now, ws.trial
    while True:
        request = call_for_int(solver[0], (ws,))
        if request == EVALUATE:
            call(problem[0], (data, trial.U, trial.X))
            at = (data, trial.X, trial.U, trial.output_error, trial.g)
            state.trial_cost = call_for_float(problem[1], at)
        elif request == LINEARISE:
            call(problem[2], (data, now.X, now.U, p.stages, p.path, p.terminal))
        elif request == SOLVE_QP:
            warm = relaxed if state.level > 0 else hard
            state.outcome = call_for_int(solver[1], (p, active, warm))
        elif request == CORRECT:
            call(solver[2], (p, active, trial.output_error, trial.g))
        else:
            return
