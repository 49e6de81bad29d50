"""The line search along a step, and the second-order correction that bends it."""

from __future__ import annotations

import math
from typing import Any

from cmpsp_ros.mpsp.jit.compiled import allocation_free
from cmpsp_ros.mpsp.problem import Array
from cmpsp_ros.mpsp.realtime.functions import evaluate, predict
from cmpsp_ros.mpsp.realtime.merit import magnitude, promised, value, violation
from cmpsp_ros.mpsp.realtime.workspace import Trajectory, Workspace
from cmpsp_ros.mpsp.riccati.correction import correct

_SUFFICIENT_DECREASE = 1e-4
_HALVINGS = 4
# Tried only where all of those fail, which otherwise ends the iteration.
_LAST_HALVINGS = 12
# Rounding of a merit, and a promise too small to be checked, relative to the same magnitude.
_ROUNDING = 1e-13
_UNCHECKABLE = 1e-11


@allocation_free
def search(data: Any, room: Workspace, last_length: float, relaxed: bool) -> float:
    """Backtrack from the full step until the merit falls by enough.

    The same search as `cmpsp_ros.mpsp.merit.search`, which has the reasons.

    Args:
        data: The problem.
        room: Its iterate is replaced by the one found.
        last_length: Step length of the iteration before, 0 for none.
        relaxed: Whether the step leaves rows violated that no correction could mend.

    Returns:
        The step length taken; 0 where no step lowers the merit.
    """
    promise = promised(room)
    before, scale = value(room.merit, room.at), magnitude(room.merit, room.at)
    longest = 1.0
    if 0.0 < last_length < 1.0 and not promise > _UNCHECKABLE * scale:
        longest = last_length
    wanted = _SUFFICIENT_DECREASE * max(promise, 0.0)
    tolerance = _ROUNDING * scale

    tried = attempt(data, room, longest, False)
    if tried <= before - wanted * longest + tolerance:
        return _take(room, longest)
    best, best_length, best_bent = tried, longest, False
    bent = longest == 1.0 and not relaxed and _bend(room)
    length = 1.0
    for _ in range(_HALVINGS + 1):
        # The first one again only if it is now a different one.
        if length < longest or (length == longest and bent):
            tried = attempt(data, room, length, bent)
            if tried <= before - wanted * length + tolerance:
                return _take(room, length)
            if tried < best:
                best, best_length, best_bent = tried, length, bent
        length /= 2.0
    if best < before:
        attempt(data, room, best_length, best_bent)
        return _take(room, best_length)
    for _ in range(_HALVINGS + 1, _LAST_HALVINGS + 1):
        if attempt(data, room, length, bent) < before:
            return _take(room, length)
        length /= 2.0
    return 0.0


@allocation_free
def attempt(data: Any, room: Workspace, length: float, bent: bool) -> float:
    """Merit at a step length, the trajectory left in `Workspace.trial`."""
    at, trial, dU = room.at, room.trial, room.solver.dU
    for k in range(dU.shape[0]):
        for a in range(dU.shape[1]):
            moved = at.U[k, a] + length * dU[k, a]
            if bent:
                moved += length * length * room.bend[k, a]
            trial.U[k, a] = min(max(moved, room.lower[k, a]), room.upper[k, a])
    predict(data, trial.U, trial.X)
    trial.cost[0] = evaluate(data, trial.X, trial.U, trial.output_error, trial.g)
    return value(room.merit, trial)


@allocation_free
def _take(room: Workspace, length: float) -> float:
    copy(room.trial, room.at)
    return length


@allocation_free
def copy(source: Trajectory, target: Trajectory) -> None:
    """Copy a trajectory."""
    _copy(source.U, target.U)
    _copy(source.X, target.X)
    _copy(source.g, target.g)
    for j in range(source.output_error.shape[0]):
        target.output_error[j] = source.output_error[j]
    target.cost[0] = source.cost[0]


@allocation_free
def _copy(source: Array, target: Array) -> None:
    numbers, copies = source.reshape(source.size), target.reshape(target.size)
    for i in range(numbers.shape[0]):
        copies[i] = numbers[i]


@allocation_free
def _bend(room: Workspace) -> bool:
    """The correction, where violation is what the full step is refused for, and it is small."""
    found = violation(room.merit, room.trial)
    if not (math.isfinite(found) and found > violation(room.merit, room.at)):
        return False
    correct(room.qp, room.solver, room.trial.output_error, room.trial.g, room.bend)
    dU, bend = room.solver.dU, room.bend
    step, correction = 0.0, 0.0
    for k in range(dU.shape[0]):
        for a in range(dU.shape[1]):
            step += dU[k, a] * dU[k, a]
            correction += bend[k, a] * bend[k, a]
    # A correction as long as the step itself is none: the constraints bend too much for it.
    return correction < step
