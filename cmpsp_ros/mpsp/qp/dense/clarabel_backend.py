"""The interior-point solver Clarabel on the sparse program that keeps the states.

Goulart, P. and Chen, Y.: Clarabel: an interior-point solver for conic programs with quadratic
objectives. arXiv:2405.12762 (2024).
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cmpsp_ros.arrays import Array
from cmpsp_ros.mpsp.qp.active_set.fill import is_positive_definite, kkt_residual
from cmpsp_ros.mpsp.qp.dense.infeasibility import contradicting_rows, row_lengths
from cmpsp_ros.mpsp.qp.dense.sparse_form import SparseQP, row_of, solution_of, sparse_qp
from cmpsp_ros.mpsp.qp.solution import Penalties, QPSolution, QPStatus
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
        first: Where the rows begin, after the dynamics.
        rows: Which row of the program each is.
        side: -1 where it is a lower limit, else 1.
        price: Cost of each slack variable.
        slack_row: Row of the program that each slack variable relaxes.
        slack_sign: 1 where it lets the row exceed its limit, -1 where it lets it fall below.
    """

    A: Any
    b: Array
    equalities: int
    first: int
    rows: NDArray[np.intp]
    side: Array
    price: Array
    slack_row: NDArray[np.intp]
    slack_sign: Array

    def row_multipliers(self, z: Array, count: int) -> Array:
        """Multipliers of the program's rows from those of the cones, shape ``(count,)``."""
        values = np.zeros(count)
        np.add.at(values, self.rows, self.side * z[self.first : self.first + len(self.rows)])
        return values


def solve(subproblem: Subproblem, penalties: Penalties | None) -> QPSolution:
    """Solve a subproblem by Clarabel, single-threaded and without a time limit.

    `QPStatus.SOLVED` only where `kkt_residual` is within `TOLERANCE`, `QPStatus.INFEASIBLE` only
    where the rows in ``conflict`` prove it. `QPStatus.FAILED` otherwise: data that are not finite,
    a Hessian that is not positive definite in the controls, or too little accuracy.
    """
    size, lin = subproblem.size, subproblem.linearisation
    given = [subproblem.lower, subproblem.upper, subproblem.trust_radius]
    if penalties is not None:
        given += [penalties.terminal, penalties.path]
    if lin.not_finite or any(np.isnan(each).any() for each in given):
        return QPSolution.unsolved(size, QPStatus.FAILED)
    program = _with_equalities(sparse_qp(subproblem, penalties))
    for index in np.flatnonzero(program.lower > program.upper).tolist():
        crossed = row_of(subproblem, program, index)
        return QPSolution.unsolved(size, QPStatus.INFEASIBLE, (crossed,))
    if not is_positive_definite(subproblem):
        return QPSolution.unsolved(size, QPStatus.FAILED)
    cones = cone_program(program, program.weight)
    answer = run(cones, program.P, program.q)
    for threshold in _INACTIVE:
        found = _solution(subproblem, program, cones, answer, threshold)
        if kkt_residual(subproblem, found, penalties) <= TOLERANCE:
            return found
    # Its multipliers prove a contradiction with fewer rows than the ray of the program itself.
    nearest = cone_program(program, _violation_weights(subproblem, program))
    for each, z in (nearest, run(nearest).z), (cones, answer.z):
        multipliers = each.row_multipliers(np.array(z), len(program.upper))
        if conflict := contradicting_rows(subproblem, program, multipliers):
            return QPSolution.unsolved(size, QPStatus.INFEASIBLE, conflict)
    return QPSolution.unsolved(size, QPStatus.FAILED)


def cone_program(program: SparseQP, weight: Array) -> ConeProgram:
    """The constraints in Clarabel's form.

    Args:
        program: The program.
        weight: Penalty of each row, ``inf`` where hard; without a positive one a row is left out.
    """
    from scipy import sparse  # noqa: PLC0415 (takes 0.2 s to import, and few runs need it)

    is_equal, kept = program.lower == program.upper, weight > 0.0
    equal = np.flatnonzero(is_equal & kept)
    above = np.flatnonzero(~is_equal & kept & np.isfinite(program.upper))
    below = np.flatnonzero(~is_equal & kept & np.isfinite(program.lower))
    up = np.concatenate([equal, above])
    rows, first = np.concatenate([up, below]), program.D.shape[0]
    side = np.ones(len(rows))
    side[len(rows) - len(below) :] = -1.0
    # An equality can be missed to either side, and has a slack variable for both.
    relaxed = np.flatnonzero(np.isfinite(weight[rows]))
    both = relaxed[relaxed < len(equal)]
    relaxed = np.concatenate([both, relaxed])
    sign = side[relaxed]
    sign[len(both) : 2 * len(both)] = -1.0
    slacks = np.arange(len(relaxed))
    entries = -side[relaxed] * sign, (first + relaxed, slacks)
    hard = sparse.vstack([program.D, program.G[up], -program.G[below]], format='csr')
    soft = sparse.csc_array(entries, shape=(hard.shape[0], len(slacks)))
    no_limit = sparse.csc_array((len(slacks), hard.shape[1]))
    limits = np.where(side > 0.0, program.upper[rows], -program.lower[rows])
    return ConeProgram(
        A=sparse.block_array([[hard, soft], [no_limit, -sparse.eye_array(len(slacks))]]).tocsc(),
        b=np.concatenate([np.zeros(first), limits, np.zeros(len(slacks))]),
        equalities=first + len(equal),
        first=first,
        rows=rows,
        side=side,
        price=weight[rows[relaxed]],
        slack_row=rows[relaxed],
        slack_sign=sign,
    )


def run(program: ConeProgram, P: Any = None, q: Array | None = None) -> Any:
    """Clarabel's answer, with ``x``, ``z``, ``s``, ``status`` and ``iterations``.

    Args:
        program: The constraints.
        P: Upper triangle of the Hessian without the slack variables; None for 0.
        q: Gradient without the slack variables; None for 0.
    """
    import clarabel  # noqa: PLC0415 (few runs need it)
    from scipy import sparse  # noqa: PLC0415 (as above)

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
    hessian, gradient = sparse.csc_array((program.A.shape[1],) * 2), np.zeros(program.A.shape[1])
    gradient[len(gradient) - len(program.price) :] = program.price
    if P is not None and q is not None:
        hessian = P.copy()
        hessian.resize((program.A.shape[1],) * 2)
        gradient[: len(q)] = q
    return clarabel.DefaultSolver(hessian, gradient, program.A, program.b, cones, settings).solve()


def _solution(
    subproblem: Subproblem, program: SparseQP, cones: ConeProgram, answer: Any, threshold: float
) -> QPSolution:
    """The point that Clarabel came to, with multipliers of inactive rows exactly 0.

    Args:
        subproblem: The program.
        program: The same as sparse matrices.
        cones: What was solved.
        answer: The answer.
        threshold: A multiplier smaller than that times its slack, both scaled, is 0.
    """
    x, z, s = np.array(answer.x), np.array(answer.z), np.array(answer.s)
    dU = x[: subproblem.lower.size].reshape(subproblem.lower.shape)
    scale = threshold * (1.0 + np.abs(z).max(initial=0.0)) / (1.0 + np.abs(dU).max(initial=0.0))
    inactive = z < scale * s
    inactive[: cones.equalities] = False
    values = cones.row_multipliers(np.where(inactive, 0.0, z), len(program.upper))
    # What the multiplier of a relaxed row lacks to its weight is the multiplier of its slack.
    full = inactive[len(inactive) - len(cones.price) :]
    values[cones.slack_row[full]] = (cones.slack_sign * cones.price)[full]
    values = np.clip(values, -program.weight, program.weight)
    return solution_of(subproblem, program, dU, values, answer.iterations)


def _with_equalities(program: SparseQP) -> SparseQP:
    """Rows whose two limits are the same but for rounding, as equalities."""
    lower, upper = program.lower, program.upper
    size = 1.0 + np.minimum(np.abs(lower), np.abs(upper))
    with np.errstate(invalid='ignore'):
        near = np.isfinite(size) & (np.abs(upper - lower) <= _EQUAL * size)
        middle = 0.5 * (lower + upper)
    return program._replace(
        lower=np.where(near, middle, lower), upper=np.where(near, middle, upper)
    )


def _violation_weights(subproblem: Subproblem, program: SparseQP) -> Array:
    """Weights under which hard rows but the bounds cost their distance, and others nothing."""
    length, hard = row_lengths(program), program.weight == np.inf
    weight = np.where(hard, 1.0 / np.where(length > 0.0, length, 1.0), 0.0)
    weight[len(weight) - subproblem.lower.size :] = np.inf
    return weight
