"""Answers by the interior-point solver Clarabel, on a sparse program that keeps the states."""

from __future__ import annotations

from typing import Any, NamedTuple

import clarabel
import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from cmpsp_ros.mpsp.qp import QPSolution, QPStatus
from cmpsp_ros.mpsp.riccati.stage_qp import StageQP
from cmpsp_ros.studies.verify.case import Program
from cmpsp_ros.studies.verify.sparse_rows import (
    Entries,
    Rows,
    assembled,
    cost_of,
    dynamics_of,
    multipliers_of,
    rows_of,
)

Array = NDArray[np.float64]

# Beyond what doubles can give on these programs: it stops where it gets no further.
_TOLERANCE = 1e-11
_INFEASIBILITY = 1e-9
_ENDED_AT_A_POINT = ('Solved', 'AlmostSolved', 'InsufficientProgress')


class _Conic(NamedTuple):
    """``A z + s = b`` with ``s`` zero or not negative, slack variables at the end of ``z``.

    Attributes:
        A: Dynamics, equalities, upper and lower limits, signs of slack variables.
        b: Right-hand sides.
        equalities: How many rows have a zero ``s``.
        price: Cost of each slack variable.
        equal: Which rows are equalities.
        above: Which rows have an upper limit.
        below: Which rows have a lower limit.
    """

    A: Any
    b: Array
    equalities: int
    price: Array
    equal: NDArray[np.int64]
    above: NDArray[np.int64]
    below: NDArray[np.int64]


def solve(program: Program) -> QPSolution:
    """Solve, with slack variables for relaxed rows.

    The point is what Clarabel came to, also where it fell short of its tolerances: how good it is
    must be measured.
    """
    qp = program.subproblem.stages
    rows, penalties = rows_of(qp), program.penalties
    weight = np.full(len(rows.lower), np.inf)
    if penalties is not None:
        relaxed = np.concatenate([penalties.terminal, penalties.path[rows.path]])
        weight[: len(relaxed)] = relaxed
    conic = _conic(qp, rows, weight)
    answer = _run(*cost_of(qp), conic)
    status = str(answer.status)
    multipliers, dU = np.zeros(len(rows.lower)), np.zeros_like(qp.lower)
    if status in _ENDED_AT_A_POINT:
        dU = np.array(answer.x[: dU.size]).reshape(dU.shape)
        multipliers = _multipliers(conic, np.array(answer.z), multipliers)
    return QPSolution(
        _verdict(status), dU, *multipliers_of(qp, rows, multipliers), answer.iterations
    )


def least_violation(program: Program) -> float:
    """Least sum of violations of the rows that are hard, whatever that costs.

    Zero to rounding where the program has a solution; ``inf`` where Clarabel cannot tell.
    """
    qp = program.subproblem.stages
    rows = rows_of(qp)
    weight = np.ones(len(rows.lower))
    if program.penalties is not None:
        weight[: len(qp.output_error) + len(rows.path[0])] = 0.0
    conic = _conic(qp, rows, weight)
    size = qp.lower.size + qp.A.shape[0] * qp.A.shape[1]
    answer = _run([], np.zeros(size), conic)
    if str(answer.status) not in _ENDED_AT_A_POINT:
        return np.inf
    return float(conic.price @ answer.x[size:])


def _conic(qp: StageQP, rows: Rows, weight: Array) -> _Conic:
    equal = np.flatnonzero(rows.lower == rows.upper)
    differ = rows.lower != rows.upper
    above = np.flatnonzero(differ & np.isfinite(rows.upper))
    below = np.flatnonzero(differ & np.isfinite(rows.lower))
    steps, n, _ = qp.A.shape
    entries = dynamics_of(qp)
    first, column, price = steps * n, qp.lower.size + steps * n, []
    # An equality can be missed to either side, and has a slack variable for both.
    for part, factor, signs in ((equal, 1.0, (-1, 1)), (above, 1.0, (-1,)), (below, -1.0, (-1,))):
        entries.append(rows.G.picked(part, factor, first))
        relaxed = np.flatnonzero(np.isfinite(weight[part]))
        for sign in signs:
            columns = column + np.arange(len(relaxed))
            entries.append(Entries(first + relaxed, columns, np.full(len(relaxed), float(sign))))
            column += len(relaxed)
            price.append(weight[part][relaxed])
        first += len(part)
    slacks = sum(map(len, price))
    entries.append(
        Entries(
            first + np.arange(slacks), column - slacks + np.arange(slacks), np.full(slacks, -1.0)
        )
    )
    b = np.zeros(first + slacks)
    b[steps * n : first] = np.concatenate(
        [rows.upper[equal], rows.upper[above], -rows.lower[below]]
    )
    A = assembled(entries, (first + slacks, column))
    return _Conic(A, b, steps * n + len(equal), np.concatenate(price), equal, above, below)


def _run(P: list[Entries], q: Array, conic: _Conic) -> Any:
    cones = [
        clarabel.ZeroConeT(conic.equalities),
        clarabel.NonnegativeConeT(len(conic.b) - conic.equalities),
    ]
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.max_threads = 1
    settings.tol_feas = settings.tol_gap_abs = settings.tol_gap_rel = _TOLERANCE
    settings.tol_infeas_abs = settings.tol_infeas_rel = _INFEASIBILITY
    size = conic.A.shape[1]
    hessian = assembled(P, (size, size)) if P else sparse.csc_array((size, size))
    gradient = np.concatenate([q, conic.price])
    return clarabel.DefaultSolver(hessian, gradient, conic.A, conic.b, cones, settings).solve()


def _multipliers(conic: _Conic, z: Array, values: Array) -> Array:
    """Multipliers of the rows from those of the cones, positive at upper limits."""
    ends = np.cumsum([len(conic.equal), len(conic.above), len(conic.below)])
    dynamics = conic.equalities - len(conic.equal)
    missed, above, below, _ = np.split(z[dynamics:], ends)
    values[conic.equal] = missed
    values[conic.above] += above
    values[conic.below] -= below
    return values


def _verdict(status: str) -> QPStatus:
    if status in _ENDED_AT_A_POINT:
        return QPStatus.SOLVED
    infeasible = status in {'PrimalInfeasible', 'AlmostPrimalInfeasible'}
    return QPStatus.INFEASIBLE if infeasible else QPStatus.FAILED
