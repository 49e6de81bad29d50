"""What independent solvers say of a program, and how good their answers are."""

from __future__ import annotations

from enum import Enum
from typing import NamedTuple

from benchmarks.verify import clarabel_reference
from benchmarks.verify.case import Program
from benchmarks.verify.measure import Accuracy, accuracy
from cmpsp_ros.mpsp.qp import QPSolution, QPStatus
from cmpsp_ros.mpsp.qp.dense import solve_by_daqp

# A dense solver takes a fifth of a second for 200 steps.
_MAX_DENSE_CONTROLS = 122
# Closer than the back end's own.
_DAQP_TOLERANCE = 1e-9
# A reference that is further from the optimum than this has not solved the program.
_SOLVED = 1e-6


class Verdict(Enum):
    """Whether a program has a solution; the value is a sentence about the references."""

    SOLVED = 'A reference has a solution, and none denies it.'
    INFEASIBLE = 'A reference proves that there is none, and no other has one.'
    DISPUTED = 'One reference has a solution that another denies.'
    UNKNOWN = 'No reference can tell.'


class Reference(NamedTuple):
    """An answer.

    Attributes:
        name: Of the solver.
        solution: The answer.
        accuracy: How good it is.
    """

    name: str
    solution: QPSolution
    accuracy: Accuracy


def references(program: Program) -> list[Reference]:
    """Answers to a program, that with the smallest duality gap first.

    Clarabel is always asked, and daqp where rows are hard and the program is small enough.
    """
    answers = {'clarabel': clarabel_reference.solve(program)}
    if program.penalties is None and program.subproblem.lower.size <= _MAX_DENSE_CONTROLS:
        answers['daqp'] = solve_by_daqp(program.subproblem, None, _DAQP_TOLERANCE)
    judged = [
        Reference(name, answer, accuracy(program, answer)) for name, answer in answers.items()
    ]
    return sorted(judged, key=lambda each: abs(each.accuracy.gap))


def verdict(answers: list[Reference]) -> Verdict:
    """What the references come to together."""
    solved = any(each.accuracy.residual <= _SOLVED for each in answers)
    denied = any(each.solution.status is QPStatus.INFEASIBLE for each in answers)
    if solved:
        return Verdict.DISPUTED if denied else Verdict.SOLVED
    return Verdict.INFEASIBLE if denied else Verdict.UNKNOWN
