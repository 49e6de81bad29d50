"""The compiled Riccati active-set method as a back end; nothing is condensed.

Where it gives up, or takes rounding for a contradiction, Clarabel is asked.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cmpsp_ros.mpsp.problem import Array, Dimensions
from cmpsp_ros.mpsp.qp import clarabel_backend
from cmpsp_ros.mpsp.qp.rooms import Rooms
from cmpsp_ros.mpsp.qp.solution import (
    Penalties,
    QPSolution,
    QPStatus,
    Row,
    largest_multipliers,
)
from cmpsp_ros.mpsp.qp.stage_answer import named, solved
from cmpsp_ros.mpsp.riccati import solver
from cmpsp_ros.mpsp.riccati.correction import activate, correct
from cmpsp_ros.mpsp.riccati.outcome import INFEASIBLE, NO_CURVATURE, SOLVED
from cmpsp_ros.mpsp.riccati.stage_qp import Multipliers
from cmpsp_ros.mpsp.riccati.whitening import factorise
from cmpsp_ros.mpsp.riccati.working_set import CONFLICT, Hint, no_hint
from cmpsp_ros.mpsp.subproblem import Subproblem

_rooms = Rooms(solver.solver)


def solve(subproblem: Subproblem, penalties: Penalties | None) -> QPSolution:
    """Solve a subproblem by the dual active-set method, or else by Clarabel."""
    return solve_from(subproblem, penalties, empty_hint(subproblem.size))


def solve_from(subproblem: Subproblem, penalties: Penalties | None, hint: Hint) -> QPSolution:
    """Solve a subproblem, beginning with the active rows of another one of its sizes.

    Args:
        subproblem: The program.
        penalties: Weights of the exact L1 relaxation; None keeps all rows hard.
        hint: Rows to begin with; left as those of this solution, and empty where Clarabel found
            it: there are too many of them, or the active-set method cannot use them.
    """
    qp, size = subproblem.stages, subproblem.size
    otherwise = QPSolution.unsolved(size, QPStatus.FAILED)
    with _rooms.of(size) as room:
        outcome = NO_CURVATURE
        if factorise(qp, room.white):
            outcome = solver.solve(qp, largest_multipliers(size, penalties), hint, room)
        if outcome == SOLVED:
            return solved(room.dU, room.multipliers, int(solver.iterations(room)))
        if outcome == NO_CURVATURE:
            return otherwise
        if outcome == INFEASIBLE:
            at = room.active
            conflict = named(qp, at.conflict[: at.counts[CONFLICT]].tolist())
            otherwise = QPSolution.unsolved(size, QPStatus.INFEASIBLE, conflict)
            if _contradict(subproblem, conflict):
                return otherwise
    hint.length[0] = 0
    answer = clarabel_backend.solve(subproblem, penalties)
    return otherwise if answer.status is QPStatus.FAILED else answer


def _contradict(subproblem: Subproblem, rows: Sequence[Row]) -> bool:
    """Whether rows that seem to contradict each other do: among very many, rounding may do it."""
    size = subproblem.size
    least = Penalties(np.zeros(size.output), np.zeros((size.horizon + 1, size.path)))
    for row in rows:
        if row.kind == 'terminal':
            least.terminal[row.index] = np.inf
        elif row.kind == 'path':
            least.path[row.stage, row.index] = np.inf
    alone = clarabel_backend.solve(subproblem.only(rows), least)
    return alone.status is QPStatus.INFEASIBLE


def second_order_correction(
    subproblem: Subproblem, solution: QPSolution, output_error: Array, g: Array
) -> Array:
    """Second-order correction (see `cmpsp_ros.mpsp.riccati.correction.correct`).

    Args:
        subproblem: The program.
        solution: Its solution by any back end.
        output_error: Terminal error after the full step, shape ``(m,)``.
        g: Path constraints after the full step, shape ``(N + 1, l)``.

    Returns:
        Deviations on top of the step, shape ``(N + 1, r)``; 0 where the Hessian is not definite.
    """
    qp, bend = subproblem.stages, np.zeros_like(solution.dU)
    multipliers = Multipliers(solution.terminal, solution.path, solution.trust, solution.bounds)
    with _rooms.of(subproblem.size) as room:
        if factorise(qp, room.white):
            activate(qp, room, multipliers)
            correct(qp, room, output_error, g, bend)
    return bend


def empty_hint(size: Dimensions) -> Hint:
    """A hint with nothing in it."""
    return no_hint(size.horizon, size.state, size.control, size.output, size.path)
