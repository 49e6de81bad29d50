"""The iteration itself: predict, linearise, solve, search, update (43); and its elastic mode.

It is a state machine that never calls a problem's functions: it returns its next request, and
the driver serves that and calls it again. So one iteration serves problems in Python and
compiled ones, and every QP back end.

Elastic mode says which constraints may be violated where not all can be met: the weights of the
relaxation rank the rows. A sum of weighted slacks would trade a little of one row for much of
another, however far apart the weights are. So a heavier row stays hard as long as there is a
solution without its slack: the next lightest rows are relaxed only where the lightest are not
enough, and the others only where both are not.
"""

import math
from typing import Final

from cmpsp_ros.arrays import Array
from cmpsp_ros.mpsp.jit.compiled import allocation_free, inner
from cmpsp_ros.mpsp.qp.active_set.fixed_bounds import free_all
from cmpsp_ros.mpsp.qp.riccati.program import Outcome, Program
from cmpsp_ros.mpsp.sqp.line_search import (
    begin_search,
    go_on,
    go_on_corrected,
    predicted_reduction,
    set_trial,
    take_trial,
    update_penalties,
)
from cmpsp_ros.mpsp.sqp.workspace import Phase, Request, Workspace

# Relaxation levels: slack in the lightest rows, in the next lightest as well, and in all.
LEVELS: Final = 3


@allocation_free
def relax(p: Program, level: int) -> bool:
    """Set the penalties of a relaxation level, infinite for hard rows; false if no row is hard."""
    heaviest = -math.inf
    for _ in range(level):
        heaviest = _next_weight(p, heaviest)
    if level >= LEVELS:
        heaviest = math.inf
    is_hard = False
    for j in range(p.terminal.shape[0]):
        row = p.terminal[j]
        row.penalty = row.weight if row.weight <= heaviest else math.inf
        is_hard = is_hard or row.weight > heaviest
    for k in range(p.head[0].horizon + 1):
        for j in range(p.path.shape[1]):
            row = p.path[k, j]
            row.penalty = row.weight if row.weight <= heaviest else math.inf
            is_hard = is_hard or row.weight > heaviest
    return is_hard


@inner
def _next_weight(p: Program, lighter: float) -> float:
    """The least weight above another."""
    found = math.inf
    for j in range(p.terminal.shape[0]):
        if p.terminal[j].weight > lighter:
            found = min(found, p.terminal[j].weight)
    for j in range(p.path.shape[1]):
        if p.path[0, j].weight > lighter:
            found = min(found, p.path[0, j].weight)
    return found


@allocation_free
def advance(ws: Workspace) -> int:
    """Iterate up to the next request, and return it.

    `EVALUATE`: predict along ``trial.U`` and evaluate, into `trial` and ``run.trial_cost``.
    `LINEARISE`: the derivatives along `now`, into `program`. `SOLVE_QP`: the step and its
    multipliers, into `program`, and ``run.outcome``. `CORRECT`: the second-order correction of the
    step, into `program`. `ADD_CURVATURE`: the condensed Hessian is not positive definite; mend it
    or leave it. `DONE`: the iteration is over, and the plan is in `now`.
    """
    run = ws.run[0]
    if run.phase == Phase.START:
        _begin(ws)
        run.phase = Phase.EVALUATED
        return Request.EVALUATE
    if run.phase == Phase.EVALUATED:
        take_trial(ws)
        run.cost_limit = (1.0 + abs(run.cost)) * run.growth_limit
        run.control_limit = _largest_control(ws) * run.growth_limit
        return _next_iteration(ws)
    if run.phase == Phase.LINEARISED:
        _bound_step(ws)
        run.level = 0
        run.is_hard = int(relax(ws.program, 0))
        run.phase = Phase.QP_ANSWERED
        return Request.SOLVE_QP
    if run.phase == Phase.QP_ANSWERED:
        if run.outcome == Outcome.NO_CURVATURE and run.asked_for_curvature == 0:
            run.phase, run.asked_for_curvature = Phase.LINEARISED, 1
            return Request.ADD_CURVATURE
        failed = run.outcome not in (Outcome.SOLVED, Outcome.NO_CURVATURE)
        if failed and run.is_hard == 1 and run.elastic == 1:
            run.level += 1
            run.is_hard = int(relax(ws.program, run.level))
            return Request.SOLVE_QP
        return _take_step(ws)
    if run.phase == Phase.FULL_STEP:
        take_trial(ws)
        run.length = 1.0
        return _finish(ws)
    request = go_on_corrected(ws) if run.phase == Phase.CORRECTED else go_on(ws)
    run.phase = Phase.CORRECTED if request == Request.CORRECT else Phase.SEARCHING
    return _finish(ws) if request == Request.DONE else request


@inner
def _begin(ws: Workspace) -> None:
    """Bring the guess within its bounds."""
    run, p = ws.run[0], ws.program
    run.iterations = run.outcome = run.active_rows = run.level = 0
    run.length = run.full_change = 0.0
    p.head[0].work = 0
    ws.slack[:] = 0.0
    U = ws.trial.U
    for k in range(p.head[0].horizon + 1):
        for a in range(U.shape[1]):
            U[k, a] = min(max(U[k, a], ws.lower[k, a]), ws.upper[k, a])


@inner
def _next_iteration(ws: Workspace) -> int:
    run = ws.run[0]
    if run.iterations >= run.max_iterations:
        return Request.DONE
    run.phase = Phase.LINEARISED
    run.asked_for_curvature = 0
    return Request.LINEARISE


@inner
def _bound_step(ws: Workspace) -> None:
    """Bounds of the step, from those of the controls."""
    for k in range(ws.program.head[0].horizon + 1):
        stage = ws.program.stages[k]
        for a in range(stage.lower.shape[0]):
            stage.lower[a] = ws.lower[k, a] - ws.now.U[k, a]
            stage.upper[a] = ws.upper[k, a] - ws.now.U[k, a]
    free_all(ws.program)
    ws.program.head[0].is_factorised = 0


@inner
def _take_step(ws: Workspace) -> int:
    """From a solved subproblem to the first trial."""
    run, p = ws.run[0], ws.program
    if run.outcome != Outcome.SOLVED:
        run.length = 0.0
        return _finish(ws)
    if run.control_tolerance > 0.0:
        run.full_change = _relative_change(p, ws.now.U)
    update_penalties(p)
    run.predicted = predicted_reduction(p, ws.slack)
    if run.line_search == 1:
        run.phase = Phase.SEARCHING
        begin_search(ws, run.length if run.iterations > 0 else 0.0)
    else:
        run.phase = Phase.FULL_STEP
        run.is_corrected = 0
        set_trial(ws, 1.0)
    return Request.EVALUATE


@inner
def _finish(ws: Workspace) -> int:
    """End of an iteration."""
    run = ws.run[0]
    run.iterations += 1
    if run.iterations < run.max_iterations and not _is_over(ws):
        return _next_iteration(ws)
    if run.outcome == Outcome.SOLVED:
        run.active_rows = _active_rows(ws.program)
    return Request.DONE


@inner
def _is_over(ws: Workspace) -> bool:
    """True where the iteration is over by itself, as in `CMPSP.terminate`."""
    run = ws.run[0]
    if run.outcome != Outcome.SOLVED or run.length == 0.0 or not _is_finite(ws):
        return True
    if 1.0 + abs(run.cost) > run.cost_limit or _largest_control(ws) > run.control_limit:
        return True
    if run.full_change > run.control_tolerance:
        return False
    return needs_slack(ws) or _is_met(ws)


@allocation_free
def needs_slack(ws: Workspace) -> bool:
    """True where the relaxation of the last subproblem left a violation."""
    if ws.run[0].level == 0:
        return False
    largest = 0.0
    for j in range(ws.slack.shape[0]):
        largest = max(largest, ws.slack[j])
    return largest > ws.run[0].slack_tolerance


@inner
def _is_met(ws: Workspace) -> bool:
    now, squared = ws.now, 0.0
    for j in range(now.output_error.shape[0]):
        squared += now.output_error[j] ** 2
    if math.sqrt(squared) > ws.run[0].output_tolerance:
        return False
    for k in range(ws.program.head[0].horizon + 1):
        for j in range(now.g.shape[1]):
            if now.g[k, j] > ws.run[0].violation_tolerance:
                return False
    return True


@inner
def _is_finite(ws: Workspace) -> bool:
    total = ws.run[0].cost
    for k in range(ws.program.head[0].horizon + 1):
        for i in range(ws.now.X.shape[1]):
            total += 0.0 * ws.now.X[k, i]
    return math.isfinite(total)


@inner
def _largest_control(ws: Workspace) -> float:
    """The largest control, plus 1."""
    largest = 0.0
    for k in range(ws.program.head[0].horizon + 1):
        for a in range(ws.now.U.shape[1]):
            largest = max(largest, abs(ws.now.U[k, a]))
    return 1.0 + largest


@inner
def _active_rows(p: Program) -> int:
    """Inequalities with a multiplier."""
    count = 0
    for k in range(p.head[0].horizon + 1):
        stage = p.stages[k]
        for j in range(p.path.shape[1]):
            count += int(p.path[k, j].multiplier != 0.0)
        for a in range(stage.bounds.shape[0]):
            count += int(stage.bounds[a] != 0.0)
        for i in range(stage.trust.shape[0]):
            count += int(stage.trust[i] != 0.0)
    return count


@inner
def _relative_change(p: Program, U: Array) -> float:
    """``sum |dU_k| / sum |U_k|``, the measure of ``eps_U`` in Sec. 4."""
    change, whole = 0.0, 0.0
    for k in range(p.head[0].horizon + 1):
        moved, squared, stage = 0.0, 0.0, p.stages[k]
        for a in range(U.shape[1]):
            moved += stage.dU[a] ** 2
            squared += U[k, a] ** 2
        change += math.sqrt(moved)
        whole += math.sqrt(squared)
    return change / (whole or 1.0)
