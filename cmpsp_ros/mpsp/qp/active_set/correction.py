"""The second-order correction: what undoes the curvature of the constraints along a step."""

from __future__ import annotations

from cmpsp_ros.arrays import Array
from cmpsp_ros.mpsp.jit.compiled import allocation_free, inner
from cmpsp_ros.mpsp.qp.active_set.basis import append, solve_transposed, split
from cmpsp_ros.mpsp.qp.active_set.fixed_bounds import free_all
from cmpsp_ros.mpsp.qp.active_set.state import IS_ACTIVE, IS_OFF, ActiveSet, on_horizon, row_in_v
from cmpsp_ros.mpsp.qp.riccati.factorisation import factorise
from cmpsp_ros.mpsp.qp.riccati.program import PATH, Program, locate, multiplier_of, row_number
from cmpsp_ros.mpsp.qp.riccati.sweeps import recover_step


@allocation_free
def correct(p: Program, whole: ActiveSet, output_error: Array, g: Array) -> None:
    """Least deviations that undo what the constraints' curvature costs a full step.

    Near a solution with active curved constraints the full step violates them by the square of
    its length, and the merit may refuse it for that, however close the solution is: the Maratos
    effect. Going back to the constraints along their gradients at the start of the step mends it.
    Least is meant in the metric of the Hessian, in which the rows that are active already have an
    orthonormal basis; controls that are held at a bound stay there.

    Args:
        p: The subproblem, as it was solved last; `correction_U` of its stages is filled with the
            deviations on top of the step.
        whole: Its active set; the rows that the full step violates join it.
        output_error: Terminal error after the full step, shape ``(m,)``.
        g: Path constraints after the full step, shape ``(N + 1, l)``.
    """
    at, head = on_horizon(p, whole), p.head[0]
    for k in range(head.horizon + 1):
        for j in range(p.path.shape[1]):
            if g[k, j] > 0.0:
                _activate(p, at, row_number(p, PATH, k, j, 1.0))
    count = head.active
    for j in range(count):
        at.inside[j] = _excess(p, at.rows[j], output_error, g)
    solve_transposed(at.basis, count, at.inside, at.dependence)
    at.row[:] = 0.0
    for j in range(count):
        Q = at.basis.Q[j]
        for i in range(at.row.shape[0]):
            at.row[i] -= at.dependence[j] * Q[i]
    _swap(p)
    # As a difference it does not move what is held.
    fixed, head.fixed = head.fixed, 0
    recover_step(p, at.row)
    head.fixed = fixed
    _swap(p)


@allocation_free
def activate(p: Program, whole: ActiveSet) -> bool:
    """Take the rows that have a multiplier, and the terminal ones, for the active ones.

    For `correct` after a solution that another solver has found.

    Returns:
        Whether the program can be factorised at all.
    """
    head = p.head[0]
    head.active = 0
    free_all(p)
    if not factorise(p):
        return False
    at = on_horizon(p, whole)
    at.states[:] = IS_OFF
    for row in range(at.states.shape[0]):
        if row < p.terminal.shape[0] or multiplier_of(p, row) != 0.0:
            _activate(p, at, row)
    return True


@inner
def _activate(p: Program, at: ActiveSet, row: int) -> None:
    count = p.head[0].active
    if at.states[row] != IS_OFF or count == at.rows.shape[0]:
        return
    length = row_in_v(p, row, at.row)
    if split(at.basis, count, at.row, length, at.inside, at.outside, at.dependence) > 0.0:
        append(at.basis, count, at.inside, at.outside, 1.0)
        at.rows[count] = row
        at.states[row] = IS_ACTIVE
        p.head[0].active += 1


@inner
def _excess(p: Program, row: int, output_error: Array, g: Array) -> float:
    """By how much a row is missed; bounds and the trust region are met and stay so."""
    missed: float = 0.0
    if row < p.terminal.shape[0]:
        return output_error[row]
    kind, k, component, _ = locate(p, row)
    if kind == PATH:
        missed = g[k, component]
    return missed


@inner
def _swap(p: Program) -> None:
    """Exchange step and correction."""
    for k in range(p.head[0].horizon + 1):
        stage = p.stages[k]
        for a in range(stage.dU.shape[0]):
            stage.dU[a], stage.correction_U[a] = stage.correction_U[a], stage.dU[a]
        for i in range(stage.dX.shape[0]):
            stage.dX[i], stage.correction_X[i] = stage.correction_X[i], stage.dX[i]
