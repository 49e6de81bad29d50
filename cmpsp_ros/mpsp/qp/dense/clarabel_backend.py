"""The interior-point solver Clarabel on the sparse program that keeps the states.

Goulart, P. and Chen, Y.: Clarabel: an interior-point solver for conic programs with quadratic
objectives. arXiv:2405.12762 (2024).
"""

from importlib.util import find_spec
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cmpsp_ros.arrays import Array
from cmpsp_ros.mpsp.jit.compiled import entry_for
from cmpsp_ros.mpsp.problem import Dimensions
from cmpsp_ros.mpsp.qp.active_set.farkas import proves
from cmpsp_ros.mpsp.qp.active_set.fixed_bounds import free_all, recover_bound_multipliers
from cmpsp_ros.mpsp.qp.active_set.records import (
    borrowed_space,
    conflict_in,
    fill,
    is_positive_definite,
    kkt_residual,
    put_solution,
)
from cmpsp_ros.mpsp.qp.dense.rows import SparseQP, sparse_qp
from cmpsp_ros.mpsp.qp.subproblem import Penalties, QPSolution, QPStatus, Row, Subproblem

TOLERANCE = 1e-8  # largest residual (see `kkt_residual`) of a solution, as in the active-set method

_CLARABEL_TOLERANCE = 1e-12
_MAX_ITERATIONS = 200
# Limits no farther apart than that, relative to 1 plus their size, are an equality.
_EQUAL = 1e-10
# A multiplier so much smaller than its slack, both scaled, is 0: the first that passes the check.
_INACTIVE = (1e-4, 1e-6, 0.0)
# Multipliers that a proof may do without, relative to the largest.
_THRESHOLDS = (0.3, 0.1, 0.03, 1e-2, 1e-3, 1e-6, 1e-9, 0.0)


class ConeProgram(NamedTuple):
    """Constraints ``A z + s = b`` with ``s`` zero or not negative; slack variables end ``z``.

    Rows of `A` are the dynamics, equalities, upper and lower limits, and signs of slack variables;
    the first `equalities` of them have a zero ``s``, and from `first` on each is one of the
    program's `rows`, with `side` -1 at a lower limit, else 1. A slack variable costs `price` and
    lets `slack_row` exceed its limit (`slack_sign` 1) or fall below it (-1).
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
    a Hessian that is not positive definite in the controls, too little accuracy, or no Clarabel.
    """
    size, lin = subproblem.size, subproblem.linearisation
    given = [subproblem.lower, subproblem.upper, subproblem.trust_radius]
    if penalties is not None:
        given += [penalties.terminal, penalties.path]
    is_finite = not (lin.not_finite or any(np.isnan(each).any() for each in given))
    if not is_finite or find_spec('clarabel') is None:
        return QPSolution.unsolved(size, QPStatus.FAILED)
    program = _with_equalities(sparse_qp(subproblem, penalties))
    rows = program.rows
    for index in np.flatnonzero(rows.lower > rows.upper).tolist():
        return QPSolution.unsolved(size, QPStatus.INFEASIBLE, (rows.row(index),))
    if not is_positive_definite(subproblem):
        return QPSolution.unsolved(size, QPStatus.FAILED)
    cones = cone_program(program, rows.weight)
    answer = run(cones, program.P, program.q)
    for threshold in _INACTIVE:
        found = _solution(subproblem, program, cones, answer, threshold)
        if kkt_residual(subproblem, found, penalties) <= TOLERANCE:
            return found
    # Its multipliers prove a contradiction with fewer rows than the ray of the program itself.
    nearest = cone_program(program, _violation_weights(subproblem, program))
    for each, z in (nearest, run(nearest).z), (cones, answer.z):
        multipliers = each.row_multipliers(np.array(z), len(rows.upper))
        if conflict := contradicting_rows(subproblem, program, multipliers):
            return QPSolution.unsolved(size, QPStatus.INFEASIBLE, conflict)
    return QPSolution.unsolved(size, QPStatus.FAILED)


def cone_program(program: SparseQP, weight: Array) -> ConeProgram:
    """The constraints in Clarabel's form, with the penalty of each row, left out where 0."""
    from scipy import sparse  # noqa: PLC0415 (takes 0.2 s to import, and few runs need it)

    lower, upper = program.rows.lower, program.rows.upper
    is_equal, kept = lower == upper, weight > 0.0
    equal = np.flatnonzero(is_equal & kept)
    above = np.flatnonzero(~is_equal & kept & np.isfinite(upper))
    below = np.flatnonzero(~is_equal & kept & np.isfinite(lower))
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
    limits = np.where(side > 0.0, upper[rows], -lower[rows])
    return ConeProgram(
        A=sparse.csc_array(
            sparse.bmat([[hard, soft], [no_limit, -sparse.identity(len(slacks))]], format='csc')
        ),
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

    `P` is the upper triangle of the Hessian and `q` the gradient, without the slack variables; None
    for 0.
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

    A multiplier smaller than `threshold` times its slack, both scaled, is 0.
    """
    x, z, s = np.array(answer.x), np.array(answer.z), np.array(answer.s)
    dU = x[: subproblem.lower.size].reshape(subproblem.lower.shape)
    scale = threshold * (1.0 + np.abs(z).max(initial=0.0)) / (1.0 + np.abs(dU).max(initial=0.0))
    inactive = z < scale * s
    inactive[: cones.equalities] = False
    values = cones.row_multipliers(np.where(inactive, 0.0, z), len(program.rows.upper))
    # The multipliers of a relaxed row and of its slack add up to its weight.
    full = inactive[len(inactive) - len(cones.price) :]
    values[cones.slack_row[full]] = (cones.slack_sign * cones.price)[full]
    values = np.clip(values, -program.rows.weight, program.rows.weight)
    return program.rows.solution(subproblem, dU, values, answer.iterations)


def _with_equalities(program: SparseQP) -> SparseQP:
    """Rows whose two limits are the same but for rounding, as equalities."""
    lower, upper = program.rows.lower, program.rows.upper
    size = 1.0 + np.minimum(np.abs(lower), np.abs(upper))
    with np.errstate(invalid='ignore'):
        near = np.isfinite(size) & (np.abs(upper - lower) <= _EQUAL * size)
        middle = 0.5 * (lower + upper)
    lower, upper = (np.where(near, middle, each) for each in (lower, upper))
    return program._replace(rows=program.rows._replace(lower=lower, upper=upper))


def _violation_weights(subproblem: Subproblem, program: SparseQP) -> Array:
    """Weights under which hard rows but the bounds cost their distance, and others nothing."""
    length, hard = _row_lengths(program), program.rows.weight == np.inf
    weight = np.where(hard, 1.0 / np.where(length > 0.0, length, 1.0), 0.0)
    weight[len(weight) - subproblem.lower.size :] = np.inf
    return weight


def contradicting_rows(
    subproblem: Subproblem, program: SparseQP, multipliers: Array
) -> tuple[Row, ...]:
    """Hard rows that a dual ray proves to contradict each other; empty where it proves nothing.

    The ray ``(R,)`` is positive at upper limits; its entries for bounds are not used: the others
    determine them. Rows with small multipliers are left out where the rest proves it (see
    `farkas`).
    """
    rows, length = program.rows, _row_lengths(program)
    limit = np.where(multipliers > 0.0, rows.upper, rows.lower)
    used = np.isinf(rows.weight) & np.isfinite(limit)
    used[rows.starts[-1] :] = False
    ray = np.where(used, multipliers, 0.0)
    # A row without an effect has no length, and still contradicts by itself.
    size = np.abs(ray) * np.where(length > 0.0, length, 1.0)
    largest = size.max(initial=0.0)
    if not 0.0 < largest < np.inf:
        return ()
    still = np.zeros_like(subproblem.lower)
    dX = np.zeros_like(subproblem.linearisation.L_X)
    with borrowed_space(subproblem.size) as space:
        fill(space, subproblem)
        free_all(space.program)
        for threshold in _THRESHOLDS:
            kept = np.where(size > threshold * largest, ray / largest, 0.0)
            put_solution(space, rows.solution(subproblem, still, kept), dX)
            recover_bound_multipliers(space.program, 0.0)
            if proves(space.program, space.active, threshold):
                return conflict_in(space)
    return ()


def load_proof(size: Dimensions) -> None:
    """Load the machine code of `contradicting_rows` for programs of these sizes."""
    with borrowed_space(size) as space:
        entry_for(recover_bound_multipliers, space.program, 0.0)
        entry_for(proves, space.program, space.active, 0.0)


def _row_lengths(program: SparseQP) -> Array:
    """Euclidean length of each row in controls and states, shape ``(R,)``."""
    lengths: Array = np.sqrt(program.G.power(2).sum(axis=1))
    return lengths
