"""The exact L1 merit function, and backtracking along a step until it falls by enough.

Where the full step is refused although it does not lower the violation, the search goes back along
the arc ``a dU + a^2 w``, with ``w`` the second-order correction. It asks for one trial after the
other to be evaluated.
"""

import math

import numpy as np

from cmpsp_ros.arrays import Array
from cmpsp_ros.mpsp.jit.compiled import allocation_free, inner
from cmpsp_ros.mpsp.qp.riccati.program import Program, product
from cmpsp_ros.mpsp.sqp.workspace import Request, Search, Trajectory, Workspace

_ABOVE_MULTIPLIER = 1.1
# Violation of a hard constraint that rounding may leave in a step that meets it.
_MET = 1e-7


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
                if not (merit == math.inf and at.g[k, j] <= _MET):
                    total += merit * at.g[k, j]
    return total


@allocation_free
def merit(p: Program, at: Trajectory, cost: float) -> float:
    """Merit of a trajectory; infinite where it is not finite."""
    total = cost + violation(p, at)
    return total if math.isfinite(total) else math.inf


@allocation_free
def magnitude(p: Program, cost: float) -> float:
    """Scale of the rounding of a merit: the cost, and penalties at unit violation."""
    total = abs(cost)
    for j in range(p.terminal.shape[0]):
        total += p.terminal[j].merit
    return total


@allocation_free
def predicted_reduction(p: Program, slack: Array) -> float:
    """Decrease of the merit that its linearisation predicts for the full step.

    `slack` ``(l + m,)`` is filled with the largest slack of each path constraint and of each
    terminal output in the linearised constraints.
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


_SUFFICIENT_DECREASE = 1e-4
_HALVINGS = 4
# Tried only where all of those fail, which otherwise ends the iteration.
_LAST_HALVINGS = 12
# Rounding of a merit, and a prediction too small to be checked, relative to the same magnitude:
# thousands of terms, and states that went through a whole roll-out.
_ROUNDING = 1e-13
_UNCHECKABLE = 1e-11


@allocation_free
def begin_search(ws: Workspace, last_length: float) -> None:
    """Set the first trial: the full step, or one as long as the last where none can be checked.

    A Hessian too flat for full steps would otherwise swing about the solution at the level of
    rounding.
    """
    run, p = ws.run[0], ws.program
    run.before = merit(p, ws.now, run.cost)
    run.scale = magnitude(p, run.cost)
    run.longest = 1.0
    if 0.0 < last_length < 1.0 and not run.predicted > _UNCHECKABLE * run.scale:
        run.longest = last_length
    run.search = Search.FIRST
    run.is_corrected = 0
    set_trial(ws, run.longest)


@allocation_free
def go_on(ws: Workspace) -> int:
    """Look at the trial that was evaluated.

    Returns:
        `EVALUATE` where there is a new trial; `CORRECT`, after which `go_on_corrected` is to be
        called; `DONE` with the step length in the run, 0 where no step lowers the merit.
    """
    run, p = ws.run[0], ws.program
    tried = merit(p, ws.trial, run.trial_cost)
    if run.search == Search.BEST or (run.search == Search.LAST_RESORT and tried < run.before):
        return _accept(ws)
    if run.search == Search.LAST_RESORT:
        return _set_last_resort(ws, 0.5 * run.trying)
    wanted = _SUFFICIENT_DECREASE * max(run.predicted, 0.0)
    if tried <= run.before - wanted * run.trying + _ROUNDING * run.scale:
        return _accept(ws)
    if run.search == Search.FIRST:
        run.best, run.best_length, run.best_is_corrected = tried, run.longest, 0
        run.search = Search.BACKTRACKING
        # A relaxed step leaves rows violated that no correction could mend.
        if run.longest == 1.0 and run.level == 0:
            refused_for = violation(p, ws.trial)
            if math.isfinite(refused_for) and refused_for > violation(p, ws.now):
                return Request.CORRECT
        return _backtrack(ws, 1.0)
    if tried < run.best:
        run.best, run.best_length, run.best_is_corrected = tried, run.trying, run.is_corrected
    return _backtrack(ws, 0.5 * run.trying)


@allocation_free
def go_on_corrected(ws: Workspace) -> int:
    """Go on with the second-order correction, where it is shorter than the step; as `go_on`.

    One that is longer is none: the constraints bend too much for it.
    """
    p, step, correction = ws.program, 0.0, 0.0
    for k in range(p.head[0].horizon + 1):
        stage = p.stages[k]
        for a in range(stage.dU.shape[0]):
            step += stage.dU[a] * stage.dU[a]
            correction += stage.correction_U[a] * stage.correction_U[a]
    ws.run[0].is_corrected = int(correction < step)
    return _backtrack(ws, 1.0)


@inner
def _backtrack(ws: Workspace, length: float) -> int:
    """Set the next trial, of this length or shorter."""
    run = ws.run[0]
    # The first one again only if it is now a different one.
    while length > run.longest or (length == run.longest and run.is_corrected == 0):
        length *= 0.5
    if length >= 0.5**_HALVINGS:
        set_trial(ws, length)
        return Request.EVALUATE
    if run.best < run.before:
        run.search, run.is_corrected = Search.BEST, run.best_is_corrected
        set_trial(ws, run.best_length)
        return Request.EVALUATE
    run.search = Search.LAST_RESORT
    return _set_last_resort(ws, 0.5 ** (_HALVINGS + 1))


@inner
def _set_last_resort(ws: Workspace, length: float) -> int:
    if length < 0.5**_LAST_HALVINGS:
        ws.run[0].length = 0.0
        return Request.DONE
    set_trial(ws, length)
    return Request.EVALUATE


@allocation_free
def set_trial(ws: Workspace, length: float) -> None:
    """Set the controls at a step length."""
    run, U, trial = ws.run[0], ws.now.U, ws.trial.U
    run.trying = length
    for k in range(ws.program.head[0].horizon + 1):
        stage = ws.program.stages[k]
        for a in range(U.shape[1]):
            moved = U[k, a] + length * stage.dU[a]
            if run.is_corrected == 1:
                moved += length * length * stage.correction_U[a]
            trial[k, a] = min(max(moved, ws.lower[k, a]), ws.upper[k, a])


@inner
def _accept(ws: Workspace) -> int:
    take_trial(ws)
    ws.run[0].length = ws.run[0].trying
    return Request.DONE


@allocation_free
def take_trial(ws: Workspace) -> None:
    """Make the trial the iterate."""
    run, now, trial = ws.run[0], ws.now, ws.trial
    run.cost = run.trial_cost
    for j in range(now.output_error.shape[0]):
        now.output_error[j] = trial.output_error[j]
    stages = ws.program.head[0].horizon + 1
    _copy(trial.U, now.U, stages)
    _copy(trial.X, now.X, stages)
    _copy(trial.g, now.g, stages)


@inner
def _copy(source: Array, target: Array, rows: int) -> None:
    """Copy the first rows, as one vector: a loop over their few columns takes several times."""
    numbers, copies = source.reshape(source.size), target.reshape(target.size)
    for i in range(rows * source.shape[1]):
        copies[i] = numbers[i]
