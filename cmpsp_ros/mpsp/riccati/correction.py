"""The second-order correction: what undoes the curvature of the constraints along a step."""

from __future__ import annotations

from cmpsp_ros.mpsp.jit.compiled import allocation_free
from cmpsp_ros.mpsp.problem import Array
from cmpsp_ros.mpsp.riccati.basis import append, solve_transposed, split
from cmpsp_ros.mpsp.riccati.rows import BOUND, PATH, TRUST, number_of, place_of, white_row
from cmpsp_ros.mpsp.riccati.size import dimension
from cmpsp_ros.mpsp.riccati.solver import Solver
from cmpsp_ros.mpsp.riccati.stage_qp import Multipliers, StageQP
from cmpsp_ros.mpsp.riccati.whitening import unwhiten
from cmpsp_ros.mpsp.riccati.working_set import ACTIVE, IS_ACTIVE, IS_OFF


@allocation_free
def correct(qp: StageQP, room: Solver, output_error: Array, g: Array, bend: Array) -> None:
    """Least deviations that undo what the constraints' curvature costs a full step.

    Near a solution with active curved constraints the full step violates them by the square of
    its length, and the merit may refuse it for that, however close the solution is: the Maratos
    effect. Going back to the constraints along their gradients at the start of the step mends it.
    Least is meant in the metric of the Hessian, in which the rows that are active already have an
    orthonormal basis.

    Args:
        qp: The subproblem, as it was solved last.
        room: Its solver; the rows that the full step violates join the active ones in it.
        output_error: Terminal error after the full step, shape ``(m,)``.
        g: Path constraints after the full step, shape ``(N + 1, l)``.
        bend: Filled with the deviations, on top of the step; shape ``(N + 1, r)``.
    """
    at = room.active
    for k in range(g.shape[0]):
        for j in range(g.shape[1]):
            if g[k, j] > 0.0:
                _activate(qp, room, number_of(qp, PATH, k, j))
    count = at.counts[ACTIVE]
    for j in range(count):
        at.inside[j] = _excess(qp, at.rows[j], output_error, g)
    solve_transposed(at.basis, count, at.inside, at.dependence)
    at.row[:] = 0.0
    for j in range(count):
        Q = at.basis.Q[j]
        for i in range(at.row.shape[0]):
            at.row[i] -= at.dependence[j] * Q[i]
    # The states that go with it are of no use.
    unwhiten(qp, room.white, at.row, bend, room.deviation)


@allocation_free
def activate(qp: StageQP, room: Solver, multipliers: Multipliers) -> None:
    """Take the rows that have a multiplier, and the terminal ones, for the active ones.

    For `correct` after a solution that another solver has found.

    Args:
        qp: The subproblem.
        room: Solver that holds its factorisation.
        multipliers: Of the solution.
    """
    at = room.active
    at.counts[:] = 0
    at.states[:] = IS_OFF
    for row in range(qp.output_error.shape[0]):
        _activate(qp, room, row)
    for k in range(qp.g.shape[0]):
        for j in range(qp.g.shape[1]):
            if multipliers.path[k, j] > 0.0:
                _activate(qp, room, number_of(qp, PATH, k, j))
        for a in range(dimension(qp.control)):
            if multipliers.bounds[k, a] != 0.0:
                _activate(qp, room, number_of(qp, BOUND, k, a))
        for i in range(dimension(qp.state)):
            if multipliers.trust[k, i] != 0.0:
                _activate(qp, room, number_of(qp, TRUST, k, i))


@allocation_free
def _activate(qp: StageQP, room: Solver, row: int) -> None:
    at = room.active
    count = at.counts[ACTIVE]
    if at.states[row] != IS_OFF or count == at.rows.shape[0]:
        return
    length = white_row(qp, room.white, row, at.row)
    if split(at.basis, count, at.row, length, at.inside, at.outside, at.dependence) > 0.0:
        append(at.basis, count, at.inside, at.outside, 1.0)
        at.rows[count] = row
        at.states[row] = IS_ACTIVE
        at.counts[ACTIVE] += 1


@allocation_free
def _excess(qp: StageQP, row: int, output_error: Array, g: Array) -> float:
    """By how much a row is missed; bounds and the trust region are met and stay so."""
    if row < output_error.shape[0]:
        return output_error[row]
    place = place_of(qp, row)
    return g[place.stage, place.component] if place.kind == PATH else 0.0
