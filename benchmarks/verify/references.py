"""Answers of independent solvers, measures of any answer, and feasibility of a program."""

import math
from collections.abc import Sequence
from dataclasses import replace
from enum import Enum
from typing import NamedTuple

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import splu

from benchmarks.verify.case import Program
from cmpsp_ros.arrays import Array
from cmpsp_ros.mpsp.qp import Penalties, QPSolution, QPStatus, Row, kkt_residual
from cmpsp_ros.mpsp.qp.dense import SparseQP, cone_program, run, solve_by_daqp, sparse_qp

_BITS_CHANGED = 5


class Cost(NamedTuple):
    """Objective of a program at a point."""

    value: float  # value with the penalties of violated rows
    size: float  # 1 plus the sum of the magnitudes of its terms: the scale of rounding


class Accuracy(NamedTuple):
    """Accuracy of an answer, measured without any other; both ``inf`` without a solution."""

    residual: float  # maximum violation of the optimality conditions, relative to the data
    gap: float  # its `duality_gap`


def accuracy(program: Program, solution: QPSolution) -> Accuracy:
    """Measure an answer."""
    if solution.status is not QPStatus.SOLVED:
        return Accuracy(math.inf, math.inf)
    residual = kkt_residual(program.subproblem, solution, program.penalties)
    if not math.isfinite(residual):
        return Accuracy(math.inf, math.inf)
    return Accuracy(residual, duality_gap(program, solution))


def last_bit(program: Program, solution: QPSolution) -> float:
    """Change of the residual of an answer with the last bit of its controls.

    With unstable dynamics, which amplify rounding, no answer in doubles has a smaller residual
    except by chance.
    """
    rng = np.random.default_rng(0)
    residual = accuracy(program, solution).residual
    changes = []
    for _ in range(_BITS_CHANGED):
        towards = rng.choice([-np.inf, np.inf], size=solution.dU.shape)
        moved = replace(solution, dU=np.nextafter(solution.dU, towards))
        changes.append(abs(accuracy(program, moved).residual - residual))
    return max(changes)


def cost(program: Program, dU: Array) -> Cost:
    """Objective of a program at control deviations ``dU (N + 1, r)``."""
    qp, dX = program.subproblem.linearisation, program.subproblem.propagate(dU)
    terms = [
        float(np.vdot(qp.L_X, dX)),
        float(np.vdot(qp.L_U, dU)),
        0.5 * float(np.einsum('ki,kij,kj->', dX, qp.L_XX, dX)),
        float(np.einsum('ka,kai,ki->', dU, qp.L_UX, dX)),
        0.5 * float(np.einsum('ka,kab,kb->', dU, qp.L_UU, dU)),
    ]
    if program.penalties is not None:
        miss, path = program.subproblem.terminal(dU, dX), program.subproblem.path(dU, dX)
        terms.append(float(program.penalties.terminal @ np.abs(miss)))
        terms.append(float(np.vdot(program.penalties.path, np.maximum(path, 0.0))))
    return Cost(sum(terms), 1.0 + sum(map(abs, terms)))


def duality_gap(program: Program, solution: QPSolution) -> float:
    """Cost above the bound that an answer's own multipliers prove, relative to its terms.

    No feasible point costs less than the bound, with any multipliers. It is the least
    Lagrangian along the dynamics, found by one sparse factorisation. A gap that is negative shows
    a point that is not feasible.
    """
    qp = sparse_qp(program.subproblem, program.penalties)
    # Beyond the weight a multiplier proves nothing, and without a limit none does.
    smallest = np.where(np.isfinite(qp.rows.lower), -qp.rows.weight, 0.0)
    largest = np.where(np.isfinite(qp.rows.upper), qp.rows.weight, 0.0)
    multipliers = np.clip(qp.rows.multipliers(solution), smallest, largest)
    limit = np.where(multipliers > 0.0, qp.rows.upper, qp.rows.lower)
    active = multipliers != 0.0
    gradient = qp.q + qp.G.T @ multipliers
    bound = 0.5 * float(gradient @ _least(qp, gradient))
    bound -= float(multipliers[active] @ limit[active])
    at = cost(program, solution.dU)
    return (at.value - bound) / at.size


def _least(qp: SparseQP, gradient: Array) -> Array:
    """Minimiser of a program's cost, with this gradient at 0, along the dynamics."""
    hessian = qp.P + sparse.triu(qp.P, 1).T
    matrix = sparse.csc_array(sparse.bmat([[hessian, qp.D.T], [qp.D, None]]))
    right = np.concatenate([-gradient, np.zeros(qp.D.shape[0])])
    factor = splu(matrix)
    z = factor.solve(right)
    z += factor.solve(right - matrix @ z)
    result: Array = z[: len(gradient)]
    return result


_ENDED_AT_A_POINT = ('Solved', 'AlmostSolved', 'InsufficientProgress')


def clarabel_solve(program: Program) -> QPSolution:
    """Solve, with slack variables for relaxed rows.

    The point may fall short of Clarabel's tolerances: its accuracy must be measured.
    """
    qp = program.subproblem
    matrices = sparse_qp(qp, program.penalties)
    cones = cone_program(matrices, matrices.rows.weight)
    answer = run(cones, matrices.P, matrices.q)
    status = str(answer.status)
    if status not in _ENDED_AT_A_POINT:
        infeasible = status in {'PrimalInfeasible', 'AlmostPrimalInfeasible'}
        failure = QPStatus.INFEASIBLE if infeasible else QPStatus.FAILED
        return replace(QPSolution.unsolved(qp.size, failure), iterations=answer.iterations)
    dU = np.array(answer.x[: qp.lower.size]).reshape(qp.lower.shape)
    multipliers = cones.row_multipliers(np.array(answer.z), len(matrices.rows.upper))
    return matrices.rows.solution(qp, dU, multipliers, answer.iterations)


def least_violation(program: Program) -> float:
    """Minimum sum of violations of the rows that are hard, at any cost.

    Zero to rounding where the program has a solution; ``inf`` where Clarabel fails.
    """
    matrices = sparse_qp(program.subproblem, program.penalties)
    cones = cone_program(matrices, np.isinf(matrices.rows.weight).astype(float))
    answer = run(cones)
    if str(answer.status) not in _ENDED_AT_A_POINT:
        return np.inf
    return float(cones.price @ answer.x[len(answer.x) - len(cones.price) :])


ROUNDING = 1e-7  # change of the limits that is taken for rounding

_NOTICED = 0.1


def nearly_feasible(program: Program) -> bool:
    """True if an infeasible program misses feasibility by rounding alone."""
    return least_violation(program) < ROUNDING


def nearly_infeasible(program: Program) -> bool:
    """True if limits tightened by rounding leave no feasible point."""
    moved = (_tightened(program, side) for side in (1.0, -1.0))
    return any(least_violation(each) > _NOTICED * ROUNDING for each in moved)


def _tightened(program: Program, side: float) -> Program:
    """Every limit moved inwards, and terminal targets to one side and the other by turns."""
    subproblem = program.subproblem
    lin, lower, upper = subproblem.linearisation, subproblem.lower, subproblem.upper
    sides = np.resize([side, -side], len(lin.output_error))
    moved = replace(lin, g=lin.g + ROUNDING, output_error=lin.output_error + ROUNDING * sides)
    room = upper - lower > 2.0 * ROUNDING
    tight = replace(
        subproblem,
        linearisation=moved,
        lower=np.where(room, lower + ROUNDING, lower),
        upper=np.where(room, upper - ROUNDING, upper),
        trust_radius=np.maximum(subproblem.trust_radius - ROUNDING, 0.0),
    )
    return replace(program, subproblem=tight)


def contradict(program: Program, rows: Sequence[Row]) -> bool:
    """True if the named rows alone have no solution, or the whole program nearly has one."""
    alone, outputs = (
        program.subproblem.only(rows),
        [row.index for row in rows if row.kind == 'terminal'],
    )
    lin, weights = alone.linearisation, program.penalties
    left = replace(
        lin, output_error=lin.output_error[outputs], h_X=lin.h_X[outputs], h_U=lin.h_U[outputs]
    )
    if weights is not None:
        weights = Penalties(weights.terminal[outputs], weights.path)
    named = Program(replace(alone, linearisation=left), weights)
    return least_violation(named) > _NOTICED * ROUNDING or nearly_feasible(program)


# A dense solver takes a fifth of a second for 200 steps.
_MAX_DENSE_CONTROLS = 122
# Closer than the back end's own.
_DAQP_TOLERANCE = 1e-9
# A reference that is further from the optimum than this has not solved the program.
_SOLVED = 1e-6


class ReferenceVerdict(Enum):
    """Existence of a solution; the value is a sentence about the references."""

    SOLVED = 'A reference has a solution, and none denies it.'
    INFEASIBLE = 'A reference proves that there is none, and no other has one.'
    DISPUTED = 'One reference has a solution that another denies.'
    UNKNOWN = 'No reference can tell.'


class Reference(NamedTuple):
    """An answer."""

    name: str  # name of the solver
    solution: QPSolution  # the answer
    accuracy: Accuracy  # accuracy of the answer


def references(program: Program) -> list[Reference]:
    """Answers to a program, that with the smallest duality gap first.

    Clarabel is always asked, and daqp where rows are hard and the program is small enough.
    """
    answers = {'clarabel': clarabel_solve(program)}
    if program.penalties is None and program.subproblem.lower.size <= _MAX_DENSE_CONTROLS:
        answers['daqp'] = solve_by_daqp(program.subproblem, None, _DAQP_TOLERANCE)
    judged = [
        Reference(name, answer, accuracy(program, answer)) for name, answer in answers.items()
    ]
    return sorted(judged, key=lambda each: abs(each.accuracy.gap))


def verdict(answers: list[Reference]) -> ReferenceVerdict:
    """Joint verdict of the references."""
    solved = any(each.accuracy.residual <= _SOLVED for each in answers)
    denied = any(each.solution.status is QPStatus.INFEASIBLE for each in answers)
    if solved:
        return ReferenceVerdict.DISPUTED if denied else ReferenceVerdict.SOLVED
    return ReferenceVerdict.INFEASIBLE if denied else ReferenceVerdict.UNKNOWN
