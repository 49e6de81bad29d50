"""The interior-point solver Clarabel on the sparse program that keeps the states.

Goulart, P. and Chen, Y.: Clarabel: an interior-point solver for conic programs with quadratic
objectives. arXiv:2405.12762 (2024).
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cmpsp_ros.mpsp.problem import Array
from cmpsp_ros.mpsp.qp.dense.infeasibility import contradicting_rows, row_lengths, row_of
from cmpsp_ros.mpsp.qp.dense.sparse_rows import (
    Entries,
    Rows,
    assembled,
    cost_of,
    dynamics_of,
    multipliers_of,
    rows_of,
)
from cmpsp_ros.mpsp.qp.riccati.fill import is_positive_definite
from cmpsp_ros.mpsp.qp.solution import Penalties, QPSolution, QPStatus, kkt_residual
from cmpsp_ros.mpsp.qp.stage_qp import StageQP
from cmpsp_ros.mpsp.qp.subproblem import Subproblem

TOLERANCE = 1e-8
"""Largest residual (see `kkt_residual`) of a solution, as in the active-set method."""

_CLARABEL_TOLERANCE = 1e-12
_MAX_ITERATIONS = 200
# Limits no farther apart than that, relative to 1 plus their size, are an equality.
_EQUAL = 1e-10
# A multiplier so much smaller than its slack, both scaled, is 0: the first that passes the check.
_INACTIVE = (1e-4, 1e-6, 0.0)


class ConeProgram(NamedTuple):
    """Constraints ``A z + s = b`` with ``s`` zero or not negative; slack variables end ``z``.

    Attributes:
        A: Dynamics, equalities, upper and lower limits, signs of slack variables.
        b: Right-hand sides.
        equalities: Number of rows with a zero ``s``, the first ones.
        price: Cost of each slack variable.
        slack_row: Row that each slack variable relaxes.
        slack_sign: 1 where it lets the row exceed its limit, -1 where it lets it fall below.
        equal: Rows that are equalities.
        above: Rows with an upper limit.
        below: Rows with a lower limit.
        weight: Penalty of each row, ``inf`` where hard.
    """

    A: Any
    b: Array
    equalities: int
    price: Array
    slack_row: NDArray[np.intp]
    slack_sign: Array
    equal: NDArray[np.intp]
    above: NDArray[np.intp]
    below: NDArray[np.intp]
    weight: Array


def solve(subproblem: Subproblem, penalties: Penalties | None) -> QPSolution:
    """Solve a subproblem by Clarabel, single-threaded and without a time limit.

    `QPStatus.SOLVED` only where `kkt_residual` is within `TOLERANCE`, `QPStatus.INFEASIBLE` only
    where the rows in ``conflict`` prove it. `QPStatus.FAILED` otherwise: data that are not finite,
    a Hessian that is not positive definite in the controls, or too little accuracy.
    """
    qp, size = subproblem.stages, subproblem.size
    rows = _with_equalities(rows_of(qp))
    weight = row_weights(rows, penalties)
    if not _is_finite(subproblem, rows, weight):
        return QPSolution.unsolved(size, QPStatus.FAILED)
    for index in np.flatnonzero(rows.lower > rows.upper).tolist():
        return QPSolution.unsolved(size, QPStatus.INFEASIBLE, (row_of(qp, rows, index),))
    if not is_positive_definite(qp):
        return QPSolution.unsolved(size, QPStatus.FAILED)
    program = cone_program(qp, rows, weight)
    answer = run(program, *cost_of(qp))
    for threshold in _INACTIVE:
        found = _solution(qp, rows, program, answer, threshold)
        if kkt_residual(subproblem, found, penalties) <= TOLERANCE:
            return found
    hard = weight == np.inf
    # Its multipliers prove a contradiction with fewer rows than the ray of the program itself.
    nearest = cone_program(qp, rows, _violation_weights(qp, rows, hard))
    least = run(nearest, [], np.zeros(nearest.A.shape[1] - len(nearest.price)))
    for cones, z in (nearest, least.z), (program, answer.z):
        multipliers = row_multipliers(cones, np.array(z))
        if conflict := contradicting_rows(qp, rows, hard, multipliers):
            return QPSolution.unsolved(size, QPStatus.INFEASIBLE, conflict)
    return QPSolution.unsolved(size, QPStatus.FAILED)


def row_weights(rows: Rows, penalties: Penalties | None) -> Array:
    """Penalty of each row, ``inf`` where hard; shape ``(R,)``."""
    weight = np.full(len(rows.lower), np.inf)
    if penalties is not None:
        relaxed = np.concatenate([penalties.terminal, penalties.path[rows.path]])
        weight[: len(relaxed)] = relaxed
    return weight


def cone_program(qp: StageQP, rows: Rows, weight: Array) -> ConeProgram:
    """The constraints in Clarabel's form.

    Args:
        qp: The program, of which the dynamics are taken.
        rows: All other rows.
        weight: Penalty of each row, ``inf`` where hard; without a positive one a row is left out.
    """
    is_equal = rows.lower == rows.upper
    kept = weight > 0.0
    equal = np.flatnonzero(is_equal & kept)
    above = np.flatnonzero(~is_equal & kept & np.isfinite(rows.upper))
    below = np.flatnonzero(~is_equal & kept & np.isfinite(rows.lower))
    steps, n, _ = qp.A.shape
    entries = dynamics_of(qp)
    first, column = steps * n, qp.lower.size + steps * n
    slack_row, slack_sign = [np.zeros(0, np.intp)], [np.zeros(0)]
    # An equality can be missed to either side, and has a slack variable for both.
    for part, factor, signs in ((equal, 1.0, (1, -1)), (above, 1.0, (1,)), (below, -1.0, (-1,))):
        entries.append(rows.G.picked(part, factor, first))
        relaxed = np.flatnonzero(np.isfinite(weight[part]))
        for sign in signs:
            slack_row.append(part[relaxed])
            slack_sign.append(np.full(len(relaxed), float(sign)))
            columns = column + np.arange(len(relaxed))
            entries.append(Entries(first + relaxed, columns, -factor * slack_sign[-1]))
            column += len(relaxed)
        first += len(part)
    relaxes = np.concatenate(slack_row)
    slacks = np.arange(len(relaxes))
    entries.append(
        Entries(first + slacks, column - len(slacks) + slacks, np.full(len(slacks), -1.0))
    )
    limits = [rows.upper[equal], rows.upper[above], -rows.lower[below]]
    return ConeProgram(
        A=assembled(entries, (first + len(slacks), column)),
        b=np.concatenate([np.zeros(steps * n), *limits, np.zeros(len(slacks))]),
        equalities=steps * n + len(equal),
        price=weight[relaxes],
        slack_row=relaxes,
        slack_sign=np.concatenate(slack_sign),
        equal=equal,
        above=above,
        below=below,
        weight=weight,
    )


def run(program: ConeProgram, P: list[Entries], q: Array) -> Any:
    """Clarabel's answer, with ``x``, ``z``, ``s``, ``status`` and ``iterations``.

    Args:
        program: The constraints.
        P: Upper triangle of the Hessian without the slack variables, all 0 where empty.
        q: Gradient without the slack variables.
    """
    import clarabel  # noqa: PLC0415 (few runs need it)

    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.max_threads = 1
    settings.direct_solve_method = 'qdldl'
    settings.equilibrate_enable = True
    settings.max_iter = _MAX_ITERATIONS
    settings.tol_feas = settings.tol_gap_abs = settings.tol_gap_rel = _CLARABEL_TOLERANCE
    settings.tol_infeas_abs = settings.tol_infeas_rel = 1e-9
    cones = [
        clarabel.ZeroConeT(program.equalities),
        clarabel.NonnegativeConeT(len(program.b) - program.equalities),
    ]
    size = program.A.shape[1]
    hessian, gradient = assembled(P, (size, size)), np.concatenate([q, program.price])
    return clarabel.DefaultSolver(hessian, gradient, program.A, program.b, cones, settings).solve()


def row_multipliers(program: ConeProgram, z: Array) -> Array:
    """Multipliers of the rows from those of the cones, positive at upper limits; ``(R,)``."""
    counts = [len(part) for part in (program.equal, program.above, program.below)]
    start = program.equalities - counts[0]
    equal, above, below, _ = np.split(z[start:], np.cumsum(counts))
    values = np.zeros(len(program.weight))
    values[program.equal] = equal
    values[program.above] += above
    values[program.below] -= below
    return values


def _solution(
    qp: StageQP, rows: Rows, program: ConeProgram, answer: Any, threshold: float
) -> QPSolution:
    """The point that Clarabel came to, with multipliers of inactive rows exactly 0.

    Args:
        qp: The program.
        rows: Its rows.
        program: What was solved.
        answer: The answer.
        threshold: A multiplier smaller than that times its slack, both scaled, is 0.
    """
    x, z, s = np.array(answer.x), np.array(answer.z), np.array(answer.s)
    dU = x[: qp.lower.size].reshape(qp.lower.shape)
    scale = threshold * (1.0 + np.abs(z).max(initial=0.0)) / (1.0 + np.abs(dU).max(initial=0.0))
    inactive = z < scale * s
    inactive[: program.equalities] = False
    values = row_multipliers(program, np.where(inactive, 0.0, z))
    # What the multiplier of a relaxed row lacks to its weight is the multiplier of its slack.
    full = inactive[len(inactive) - len(program.price) :]
    values[program.slack_row[full]] = (program.slack_sign * program.price)[full]
    values = np.clip(values, -program.weight, program.weight)
    return QPSolution(
        QPStatus.SOLVED, dU, *multipliers_of(qp, rows, values), iterations=answer.iterations
    )


def _with_equalities(rows: Rows) -> Rows:
    """Rows whose two limits are the same but for rounding, as equalities."""
    size = 1.0 + np.minimum(np.abs(rows.lower), np.abs(rows.upper))
    with np.errstate(invalid='ignore'):
        near = np.isfinite(size) & (np.abs(rows.upper - rows.lower) <= _EQUAL * size)
        middle = 0.5 * (rows.lower + rows.upper)
    return rows._replace(
        lower=np.where(near, middle, rows.lower), upper=np.where(near, middle, rows.upper)
    )


def _is_finite(subproblem: Subproblem, rows: Rows, weight: Array) -> bool:
    given = np.concatenate([rows.lower, rows.upper, weight, subproblem.trust_radius])
    return not subproblem.linearisation.not_finite and not bool(np.isnan(given).any())


def _violation_weights(qp: StageQP, rows: Rows, hard: NDArray[np.bool_]) -> Array:
    """Weights under which hard rows but the bounds cost their distance, and others nothing."""
    length = row_lengths(rows)
    weight = np.where(hard, 1.0 / np.where(length > 0.0, length, 1.0), 0.0)
    weight[len(weight) - qp.lower.size :] = np.inf
    return weight
