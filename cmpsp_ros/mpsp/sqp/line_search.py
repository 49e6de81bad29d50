"""Backtracking along a step until the merit falls by enough, with a second-order correction.

Where the full step is refused although it does not lower the violation, the search goes back along
the arc ``a dU + a^2 w``, with ``w`` the correction. The search asks for one trial after the other
to be evaluated.
"""

from __future__ import annotations

import math
from typing import Final

from cmpsp_ros.arrays import Array
from cmpsp_ros.mpsp.jit.compiled import allocation_free, inner
from cmpsp_ros.mpsp.sqp.merit import magnitude, merit, violation
from cmpsp_ros.mpsp.sqp.workspace import Workspace

_SUFFICIENT_DECREASE = 1e-4
_HALVINGS = 4
# Tried only where all of those fail, which otherwise ends the iteration.
_LAST_HALVINGS = 12
# Rounding of a merit, and a prediction too small to be checked, relative to the same magnitude:
# thousands of terms, and states that went through a whole roll-out.
_ROUNDING = 1e-13
_UNCHECKABLE = 1e-11

FIRST, BACKTRACKING, BEST, LAST_RESORT = 0, 1, 2, 3
"""Values of `stage` in the run."""

GOES_ON: Final = -1.0
"""Returned where another trial has to be evaluated."""

WANTS_CORRECTION: Final = -2.0
"""Returned where the second-order correction of the step is wanted first."""


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
    run.stage = FIRST
    run.is_corrected = 0
    set_trial(ws, run.longest)


@allocation_free
def go_on(ws: Workspace) -> float:
    """Look at the trial that was evaluated.

    Returns:
        The step length taken, 0 where no step lowers the merit; `GOES_ON` where there is a new
        trial to be evaluated; `WANTS_CORRECTION`, after which `go_on_corrected` is to be called.
    """
    run, p = ws.run[0], ws.program
    tried = merit(p, ws.trial, run.trial_cost)
    if run.stage == BEST or (run.stage == LAST_RESORT and tried < run.before):
        return _accept(ws)
    if run.stage == LAST_RESORT:
        return _set_last_resort(ws, 0.5 * run.trying)
    wanted = _SUFFICIENT_DECREASE * max(run.predicted, 0.0)
    if tried <= run.before - wanted * run.trying + _ROUNDING * run.scale:
        return _accept(ws)
    if run.stage == FIRST:
        run.best, run.best_length, run.best_is_corrected = tried, run.longest, 0
        run.stage = BACKTRACKING
        # A relaxed step leaves rows violated that no correction could mend.
        if run.longest == 1.0 and run.level == 0:
            refused_for = violation(p, ws.trial)
            if math.isfinite(refused_for) and refused_for > violation(p, ws.now):
                return WANTS_CORRECTION
        return _backtrack(ws, 1.0)
    if tried < run.best:
        run.best, run.best_length, run.best_is_corrected = tried, run.trying, run.is_corrected
    return _backtrack(ws, 0.5 * run.trying)


@allocation_free
def go_on_corrected(ws: Workspace) -> float:
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
def _backtrack(ws: Workspace, length: float) -> float:
    """Set the next trial, of this length or shorter."""
    run = ws.run[0]
    # The first one again only if it is now a different one.
    while length > run.longest or (length == run.longest and run.is_corrected == 0):
        length *= 0.5
    if length >= 0.5**_HALVINGS:
        set_trial(ws, length)
        return GOES_ON
    if run.best < run.before:
        run.stage, run.is_corrected = BEST, run.best_is_corrected
        set_trial(ws, run.best_length)
        return GOES_ON
    run.stage = LAST_RESORT
    return _set_last_resort(ws, 0.5 ** (_HALVINGS + 1))


@inner
def _set_last_resort(ws: Workspace, length: float) -> float:
    if length < 0.5**_LAST_HALVINGS:
        return 0.0
    set_trial(ws, length)
    return GOES_ON


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
def _accept(ws: Workspace) -> float:
    take_trial(ws)
    length: float = ws.run[0].trying
    return length


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
