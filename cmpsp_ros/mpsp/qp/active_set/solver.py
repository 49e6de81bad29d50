"""Solution of a program: bounds to hold, the active-set method, the check; its correction."""

from typing import Final

from cmpsp_ros.arrays import Array
from cmpsp_ros.mpsp.jit.compiled import allocation_free, inner
from cmpsp_ros.mpsp.qp.active_set.basis import append, solve_transposed, split
from cmpsp_ros.mpsp.qp.active_set.dual import StepOutcome, add_violated_rows
from cmpsp_ros.mpsp.qp.active_set.farkas import leave_proof, still_contradicts
from cmpsp_ros.mpsp.qp.active_set.fixed_bounds import (
    MANY,
    fix_from,
    free_all,
    hold_violated,
    release_wrong,
    restart_from,
)
from cmpsp_ros.mpsp.qp.active_set.state import ActiveSet, RowState, WarmStart, on_horizon, row_in_v
from cmpsp_ros.mpsp.qp.active_set.warm_start import begin, leave_warm_start, shift_warm_start
from cmpsp_ros.mpsp.qp.riccati.factorisation import factorise
from cmpsp_ros.mpsp.qp.riccati.kkt import kkt_residual
from cmpsp_ros.mpsp.qp.riccati.program import (
    Outcome,
    Program,
    RowKind,
    locate,
    multiplier_of,
    product,
    row_number,
)
from cmpsp_ros.mpsp.qp.riccati.sweeps import keep_origin, recover_step

TOLERANCE: Final = 1e-8  # largest residual (see `kkt_residual`) of a solution

# Sweeps that improve the guess of which bounds to hold, before rows are added one by one: at most
# so many, and so many that change no fewer bounds than the best before. More would go in circles.
_SWEEPS, _PATIENCE = 10, 2


@allocation_free
def solve(p: Program, whole: ActiveSet, warm: WarmStart) -> int:
    """Solve a program.

    A guess of the bounds to hold is put right under way. The answer of the active-set method is
    believed only if it meets the optimality conditions, or proves that nothing meets all rows. A
    doubtful one is looked for once more from scratch. The rows of a warm start change the way to
    the solution, not the solution; those of this solution are left in it.
    """
    head, warm_started = p.head[0], warm.head[0].rows > 0
    sweeps, in_vain, fewest = 0, 0, p.stages.shape[0] * p.stages[0].B.shape[1]
    head.iterations = head.active = head.saturated = 0
    at = on_horizon(p, whole)
    shift_warm_start(p, warm)
    if still_contradicts(p, at, warm):
        return Outcome.INFEASIBLE
    fix_from(p, warm)
    while head.work <= head.work_limit:
        if head.is_factorised == 0 and not factorise(p):
            return Outcome.NO_CURVATURE
        keep_origin(p, at.v)
        begin(p, at, warm)
        # After so many sweeps bounds are only let go, which happens a finite number of times.
        sweeps += 1
        guesses = sweeps <= _SWEEPS and in_vain < _PATIENCE
        # Sweeps would go to and fro between holding so many bounds and none.
        is_stuck = guesses and head.fixed > 0 and _misses_terminal(p, at)
        if guesses and not is_stuck:
            changed = release_wrong(p, at) if head.fixed > 0 else 0
            changed += hold_violated(p)
            if warm.head[0].rows > 0 and head.saturated > 0 and changed > MANY and sweeps == 1:
                # Penalties that nothing balances drive the controls far beyond their bounds.
                sweeps, warm.head[0].rows = 0, 0
                free_all(p)
                continue
            if changed > 0:
                in_vain += int(changed >= fewest)
                fewest = min(fewest, changed)
                restart_from(p, at, warm, guesses)
                continue
        outcome = add_violated_rows(p, at, guesses)
        if outcome == StepOutcome.DONE and release_wrong(p, at) > 0:
            outcome = StepOutcome.RELEASED
        if outcome == StepOutcome.FULL and head.fixed > 0 and head.work <= head.work_limit:
            # Rows pile up against bounds that should not be held.
            free_all(p)
            sweeps, guesses, outcome = _SWEEPS, False, StepOutcome.RELEASED
        if outcome in (StepOutcome.RELEASED, StepOutcome.CROWDED):
            restart_from(p, at, warm, guesses)
            continue
        leave_warm_start(p, at, warm)
        if outcome == StepOutcome.DONE and kkt_residual(p) <= TOLERANCE:
            return Outcome.SOLVED
        if outcome == StepOutcome.CONTRADICTION and (head.is_proved == 1 or not warm_started):
            leave_proof(p, at, warm)
            return Outcome.INFEASIBLE
        if not warm_started:
            return Outcome.ITERATION_LIMIT
        warm_started, sweeps, in_vain = False, 0, 0
        warm.head[0].rows = 0
        free_all(p)
    return Outcome.ITERATION_LIMIT


@inner
def _misses_terminal(p: Program, at: ActiveSet) -> bool:
    """True where the bounds that are held leave a terminal row no freedom to be met."""
    for row in range(p.terminal.shape[0]):
        if at.states[row] == RowState.OFF:
            value = p.terminal[row].value
            missed = value + product(p.terminal[row], p.stages[p.head[0].horizon])
            if abs(missed) > TOLERANCE * (1.0 + abs(value)):
                return True
    return False


@allocation_free
def correct(p: Program, whole: ActiveSet, output_error: Array, g: Array) -> None:
    """Compute the least deviations that undo the curvature of the constraints in a full step.

    Near a solution with active curved constraints the full step violates them by the square of
    its length, and the merit may refuse it for that, however close the solution is: the Maratos
    effect. Going back to the constraints along their gradients at the start of the step mends it.
    Least is meant in the metric of the Hessian, in which the rows that are active already have an
    orthonormal basis; controls that are held at a bound stay there.

    `correction_U` of the stages is filled, from the terminal error ``(m,)`` and the path
    constraints ``(N + 1, l)`` after the full step; the rows that it violates join the active set.
    """
    at, head = on_horizon(p, whole), p.head[0]
    for k in range(head.horizon + 1):
        for j in range(p.path.shape[1]):
            if g[k, j] > 0.0:
                _activate(p, at, row_number(p, RowKind.PATH, k, j, 1.0))
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
    # As a difference it does not move held controls.
    fixed, head.fixed = head.fixed, 0
    recover_step(p, at.row)
    head.fixed = fixed
    _swap(p)


@allocation_free
def activate(p: Program, whole: ActiveSet) -> bool:
    """Make the terminal rows and those with a multiplier active, after another solver's answer.

    Returns whether the program can be factorised at all.
    """
    head = p.head[0]
    head.active = 0
    free_all(p)
    if not factorise(p):
        return False
    at = on_horizon(p, whole)
    at.states[:] = RowState.OFF
    for row in range(at.states.shape[0]):
        if row < p.terminal.shape[0] or multiplier_of(p, row) != 0.0:
            _activate(p, at, row)
    return True


@inner
def _activate(p: Program, at: ActiveSet, row: int) -> None:
    count = p.head[0].active
    if at.states[row] != RowState.OFF or count == at.rows.shape[0]:
        return
    length = row_in_v(p, row, at.row)
    if split(at.basis, count, at.row, length, at.inside, at.outside, at.dependence) > 0.0:
        append(at.basis, count, at.inside, at.outside, 1.0)
        at.rows[count] = row
        at.states[row] = RowState.ACTIVE
        p.head[0].active += 1


@inner
def _excess(p: Program, row: int, output_error: Array, g: Array) -> float:
    """By how much a row is missed; bounds and the trust region are met and stay so."""
    missed: float = 0.0
    if row < p.terminal.shape[0]:
        return output_error[row]
    kind, k, component, _ = locate(p, row)
    if kind == RowKind.PATH:
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
