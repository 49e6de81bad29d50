"""Primal-dual interior point (Mehrotra's predictor-corrector) along the stages of a program.

Each iteration is a Newton step, which takes time linear in the horizon whatever rows are active.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from cmpsp_ros.mpsp.jit.compiled import allocation_free
from cmpsp_ros.mpsp.riccati.barrier import advance, aim, multiplier_of
from cmpsp_ros.mpsp.riccati.certificate import proves_infeasible
from cmpsp_ros.mpsp.riccati.interior_room import CONFLICT, STEPS, InteriorPoint
from cmpsp_ros.mpsp.riccati.interior_start import begin, is_nothing
from cmpsp_ros.mpsp.riccati.newton import take_curvature, take_slope, take_step
from cmpsp_ros.mpsp.riccati.outcome import INFEASIBLE, ITERATION_LIMIT, NO_CURVATURE, SOLVED
from cmpsp_ros.mpsp.riccati.residual import kkt_residual
from cmpsp_ros.mpsp.riccati.rows import BOUND, count_rows, limit_of, number_of, put_multiplier
from cmpsp_ros.mpsp.riccati.solver import TOLERANCE
from cmpsp_ros.mpsp.riccati.stage_qp import Penalty, StageQP, propagate
from cmpsp_ros.mpsp.riccati.whitening import factorise

_ITERATIONS = 80
# Residual at which to stop at once; where rounding does not allow it, the best one of some more
# counts.
_AIM, _STALLS = 1e-12, 4
_COST = ('L_X', 'L_U', 'L_XX', 'L_UX', 'L_UU')
# By how much rows give (see `aim`): at first, where that holds them up, and where their weights
# are too large for the factorisation.
_GIVE, _LEAST_GIVE, _MOST_GIVE = 1e-9, 1e-14, 1e-3
_LONG, _HELD_UP = 0.9, 0.3
_BACK_OFF, _LEAST_BACK_OFF = 0.99, 1e-6
# A proof of infeasibility is looked for where less than that was gained after some iterations.
_UNMET, _PATIENCE, _SHORTEST = 1e-6, 5, 1e-8


def solve(qp: StageQP, penalty: Penalty, room: InteriorPoint) -> int:
    """Solve a program from scratch.

    Args:
        qp: The program.
        penalty: Largest multipliers, infinite where a row is hard.
        room: Filled with the solution.

    Returns:
        `SOLVED` only where `kkt_residual` is within the tolerance, `INFEASIBLE` only where the rows
        in ``room.conflict`` prove it, `NO_CURVATURE`, or `ITERATION_LIMIT`.
    """
    room.counts[:] = 0
    for k, a in np.argwhere(qp.lower > qp.upper).tolist():
        if not is_nothing(qp.lower[k, a], qp.upper[k, a]):
            row = number_of(qp, BOUND, k, a)
            room.conflict[:2], room.counts[CONFLICT] = (row, row + 1), 2
            return INFEASIBLE
    costs = {name: getattr(room.model, name) for name in _COST}
    room = room._replace(model=qp._replace(**costs))
    outcome = ITERATION_LIMIT
    for priced in (False, True):
        if not factorise(qp, room.white):
            return NO_CURVATURE
        mean, unmet = begin(qp, penalty, room, priced)
        outcome = descend(qp, penalty, room, priced, mean, unmet)
        if outcome != ITERATION_LIMIT:
            break
    return outcome


@allocation_free
def descend(
    qp: StageQP, penalty: Penalty, room: InteriorPoint, priced: bool, mean: float, first: float
) -> int:
    """The method, from where `begin` leaves it.

    Args:
        qp: The program.
        penalty: Largest multipliers, infinite where a row is hard.
        room: Filled with the solution.
        priced: Whether hard rows have a price.
        mean: Mean of the complementary products.
        first: The farthest that a row is from being met.
    """
    b, white, model = room.barrier, room.white, room.model
    begun, best, unmet, give, stalls = mean, math.inf, first, _GIVE, 0
    for iteration in range(_ITERATIONS):
        room.counts[STEPS] += 1
        aim(b, give, 0.0, 0.0)
        if not take_curvature(qp, model, white, b):
            give *= 100.0
            if give > _MOST_GIVE:
                break
            continue
        take_slope(qp, model, white, b, room.U, room.X)
        blocking, product = take_step(qp, model, white, b, room.step_U, room.step_X)
        if mean > 0.0:
            length = 1.0 / max(blocking, 1.0)
            # The step changes the mean of all products to this.
            predicted = (1.0 - length) * mean + length * length * product
            center = min(max(predicted / mean, 0.0), 1.0) ** 3
            aim(b, give, center * mean, length if priced else 1.0)
            take_slope(qp, model, white, b, room.U, room.X)
            blocking, product = take_step(qp, model, white, b, room.step_U, room.step_X)
        # The nearer the solution, the nearer to the boundary.
        nearness = 1.0 - (mean / begun if begun > 0.0 else 0.0)
        back_off = min(max(_BACK_OFF, nearness), 1.0 - _LEAST_BACK_OFF)
        length = back_off / max(blocking, back_off)
        before = unmet
        mean, unmet = _move(qp, room, length)
        if length > _LONG and unmet > _HELD_UP * before:
            give = max(0.1 * give, _LEAST_GIVE)
        if not math.isfinite(mean + unmet):
            break
        residual = _check(qp, penalty, room)
        stalls = 0 if residual < 0.5 * best else stalls + 1
        if residual < best:
            best = residual
            if best <= TOLERANCE:
                _keep(room)
        if best <= _AIM or (stalls >= _STALLS and best <= TOLERANCE):
            break
        hopeless = iteration >= _PATIENCE and unmet > _UNMET * first
        if hopeless or length < _SHORTEST or priced:
            room.counts[CONFLICT] = proves_infeasible(
                qp, model, penalty, white, b, room.U, room.conflict
            )
            if room.counts[CONFLICT] > 0:
                return INFEASIBLE
        if length < _SHORTEST:
            break
    return SOLVED if best <= TOLERANCE else ITERATION_LIMIT


@allocation_free
def _move(qp: StageQP, room: InteriorPoint, share: float) -> Any:
    """Take a share of the step; returns what `advance` does."""
    for k in range(room.U.shape[0]):
        for a in range(room.U.shape[1]):
            room.U[k, a] += share * room.step_U[k, a]
    propagate(qp, room.U, room.X)
    return advance(room.barrier, share)


@allocation_free
def _check(qp: StageQP, penalty: Penalty, room: InteriorPoint) -> float:
    """Residual of the iterate, with the multipliers that it stands for in `candidates`."""
    out = room.candidates
    out.bounds[:] = 0.0
    out.trust[:] = 0.0
    for row in range(count_rows(qp)):
        cap = limit_of(qp, penalty, row)[1]
        put_multiplier(qp, row, multiplier_of(room.barrier, row, cap), out)
    return kkt_residual(qp, penalty, room.U, room.X, out, room.costates)


@allocation_free
def _keep(room: InteriorPoint) -> None:
    """Make the iterate the solution."""
    found, kept = room.candidates, room.multipliers
    for k in range(room.U.shape[0]):
        for a in range(room.U.shape[1]):
            room.dU[k, a] = room.U[k, a]
            kept.bounds[k, a] = found.bounds[k, a]
        for i in range(room.X.shape[1]):
            kept.trust[k, i] = found.trust[k, i]
        for j in range(found.path.shape[1]):
            kept.path[k, j] = found.path[k, j]
    for j in range(found.terminal.shape[0]):
        kept.terminal[j] = found.terminal[j]
