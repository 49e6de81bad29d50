"""The compiled Riccati solvers as back ends; nothing is condensed."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np

from cmpsp_ros.mpsp.problem import Array, Dimensions
from cmpsp_ros.mpsp.qp.solution import (
    Penalties,
    QPSolution,
    QPStatus,
    Row,
    largest_multipliers,
)
from cmpsp_ros.mpsp.riccati import solver
from cmpsp_ros.mpsp.riccati.correction import activate, correct
from cmpsp_ros.mpsp.riccati.outcome import INFEASIBLE, NO_CURVATURE, SOLVED
from cmpsp_ros.mpsp.riccati.rows import BOUND, PATH, place_of
from cmpsp_ros.mpsp.riccati.solver import Solver
from cmpsp_ros.mpsp.riccati.stage_qp import Multipliers, StageQP
from cmpsp_ros.mpsp.riccati.whitening import factorise
from cmpsp_ros.mpsp.riccati.working_set import CONFLICT, Hint, no_hint
from cmpsp_ros.mpsp.subproblem import Subproblem

_rooms: defaultdict[Dimensions, list[Solver]] = defaultdict(list)


def solve(subproblem: Subproblem, penalties: Penalties | None) -> QPSolution:
    """Solve a subproblem by the dual active-set method."""
    return solve_from(subproblem, penalties, empty_hint(subproblem.size))


def solve_from(subproblem: Subproblem, penalties: Penalties | None, hint: Hint) -> QPSolution:
    """Solve a subproblem, beginning with the active rows of another one of its sizes.

    Args:
        subproblem: The program.
        penalties: Weights of the exact L1 relaxation; None keeps all rows hard.
        hint: Rows to begin with; left as those of this solution.
    """
    qp, size = subproblem.stages, subproblem.size
    with _room(size) as room:
        outcome = NO_CURVATURE
        if factorise(qp, room.white):
            outcome = solver.solve(qp, largest_multipliers(size, penalties), hint, room)
        if outcome == SOLVED:
            return _solution(room)
        if outcome == INFEASIBLE:
            return QPSolution.unsolved(size, QPStatus.INFEASIBLE, _conflict(qp, room))
        return QPSolution.unsolved(size, QPStatus.FAILED)


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
    with _room(subproblem.size) as room:
        if factorise(qp, room.white):
            activate(qp, room, multipliers)
            correct(qp, room, output_error, g, bend)
    return bend


def empty_hint(size: Dimensions) -> Hint:
    """A hint with nothing in it."""
    return no_hint(size.horizon, size.state, size.control, size.output, size.path)


@contextmanager
def _room(size: Dimensions) -> Iterator[Solver]:
    """A solver that nobody else uses; making one takes longer than solving with it."""
    free = _rooms[size]
    try:
        room = free.pop()
    except IndexError:
        room = solver.solver(size.horizon, size.state, size.control, size.output, size.path)
    yield room
    free.append(room)


def _solution(room: Solver) -> QPSolution:
    multipliers = room.multipliers
    return QPSolution(
        QPStatus.SOLVED,
        room.dU.copy(),
        multipliers.terminal.copy(),
        multipliers.path.copy(),
        multipliers.trust.copy(),
        multipliers.bounds.copy(),
        int(solver.iterations(room)),
    )


def _conflict(qp: StageQP, room: Solver) -> tuple[Row, ...]:
    at = room.active
    return tuple(_row(qp, number) for number in sorted(at.conflict[: at.counts[CONFLICT]].tolist()))


def _row(qp: StageQP, number: int) -> Row:
    if number < len(qp.output_error):
        return Row('terminal', len(qp.A), number)
    place = place_of(qp, number)
    if place.kind == PATH:
        return Row('path', place.stage, place.component)
    return Row('bound' if place.kind == BOUND else 'trust', place.stage, place.component)
