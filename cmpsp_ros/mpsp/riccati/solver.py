"""The active-set method, what to do where it fails, and the check that has the last word."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from cmpsp_ros.mpsp.jit.compiled import allocation_free, inlined
from cmpsp_ros.mpsp.problem import Array
from cmpsp_ros.mpsp.riccati.active_set import find_active_set
from cmpsp_ros.mpsp.riccati.outcome import INFEASIBLE, ITERATION_LIMIT, SOLVED
from cmpsp_ros.mpsp.riccati.residual import kkt_residual
from cmpsp_ros.mpsp.riccati.stage_qp import Multipliers, Penalty, StageQP, empty_multipliers
from cmpsp_ros.mpsp.riccati.whitening import Whitening, whitening
from cmpsp_ros.mpsp.riccati.working_set import (
    ITERATIONS,
    PROVED,
    ActiveSet,
    Hint,
    active_set,
    no_hint,
)

TOLERANCE = 1e-8
"""Largest residual (see `kkt_residual`) of a solution."""

CAPACITY = 400
"""Largest number of active rows; with more, the interior point is the faster one by far.

The back end falls back on it (see `cmpsp_ros.mpsp.qp.riccati_backend`).
"""

_ITERATIONS_A_CONTROL = 20
_ITERATIONS_AT_LEAST = 500


class Solver(NamedTuple):
    """Room to solve programs of some sizes, and what is kept from one to the next.

    One for every program in flight: nothing is shared.

    Attributes:
        white: Factorisation of the present program.
        active: State of the active-set method.
        hint_hard: Active rows of the last program with hard rows.
        hint_relaxed: Those of the last relaxed one.
        dU: Control deviations of the solution, shape ``(N + 1, r)``.
        dX: State deviations of the solution, shape ``(N + 1, n)``.
        multipliers: Multipliers of the solution.
        deviation: Scratch, shape ``(N + 1, n)``.
        costates: Scratch, shape ``(4, n)``.
    """

    white: Whitening
    active: ActiveSet
    hint_hard: Hint
    hint_relaxed: Hint
    dU: Array
    dX: Array
    multipliers: Multipliers
    deviation: Array
    costates: Array


def solver(N: int, n: int, r: int, m: int, l: int) -> Solver:  # noqa: E741 (the paper's l)
    """Room for programs of these sizes."""
    return Solver(
        white=whitening(N, n, r),
        active=active_set(N, n, r, m, l, CAPACITY),
        hint_hard=no_hint(N, n, r, m, l),
        hint_relaxed=no_hint(N, n, r, m, l),
        dU=np.zeros((N + 1, r)),
        dX=np.zeros((N + 1, n)),
        multipliers=empty_multipliers(N, n, r, m, l),
        deviation=np.zeros((N + 1, n)),
        costates=np.zeros((4, n)),
    )


@inlined
def solve(qp: StageQP, penalty: Penalty, hint: Hint, room: Solver) -> int:
    """Solve a program that `room.white` is the factorisation of.

    The answer of the active-set method is believed only if it meets the optimality conditions, or
    proves that nothing meets all rows. A doubtful one is looked for once more without the hint.

    Args:
        qp: The program.
        penalty: Largest multipliers, infinite where a row is hard.
        hint: Rows to begin with; left as those of the solution.
        room: Filled with the solution.

    Returns:
        `SOLVED`, `INFEASIBLE` or `ITERATION_LIMIT`.
    """
    outcome = ITERATION_LIMIT
    limit = _ITERATIONS_AT_LEAST + _ITERATIONS_A_CONTROL * room.active.v.shape[0]
    while True:
        hinted = hint.length[0] > 0
        outcome = find_active_set(
            qp, penalty, room.white, room.active, hint, room.dU, room.dX, room.multipliers, limit
        )
        if outcome == SOLVED and _is_solution(qp, penalty, room):
            return SOLVED
        if not hinted or (outcome == INFEASIBLE and room.active.counts[PROVED]):
            break
        hint.length[0] = 0
    return INFEASIBLE if outcome == INFEASIBLE else ITERATION_LIMIT


@inlined
def _is_solution(qp: StageQP, penalty: Penalty, room: Solver) -> bool:
    residual = kkt_residual(qp, penalty, room.dU, room.dX, room.multipliers, room.costates)
    return residual <= TOLERANCE


@allocation_free
def iterations(room: Solver) -> int:
    """Iterations of the last solution."""
    return room.active.counts[ITERATIONS]
