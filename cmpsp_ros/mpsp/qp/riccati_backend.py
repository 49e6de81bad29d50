"""The compiled Riccati active-set method as a back end; nothing is condensed.

Where it gives up, or takes rounding for a contradiction, Clarabel is asked.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from cmpsp_ros.mpsp.problem import Dimensions
from cmpsp_ros.mpsp.qp.active_set.fill import (
    Space,
    borrowed_space,
    compiled_size,
    fill,
    solution_in,
)
from cmpsp_ros.mpsp.qp.active_set.solver import solve as solve_program
from cmpsp_ros.mpsp.qp.active_set.state import Indices, empty_warm_start
from cmpsp_ros.mpsp.qp.dense import clarabel_backend
from cmpsp_ros.mpsp.qp.riccati.outcome import INFEASIBLE, NO_CURVATURE, SOLVED
from cmpsp_ros.mpsp.qp.riccati.program import BOUND, PATH, locate
from cmpsp_ros.mpsp.qp.solution import Penalties, QPSolution, QPStatus
from cmpsp_ros.mpsp.qp.subproblem import Row, Subproblem


def solve(subproblem: Subproblem, penalties: Penalties | None) -> QPSolution:
    """Solve a subproblem by the dual active-set method, or else by Clarabel."""
    return solve_from(subproblem, penalties, no_warm_start(subproblem.size))


def solve_from(subproblem: Subproblem, penalties: Penalties | None, warm: Indices) -> QPSolution:
    """Solve a subproblem, beginning with the active rows of another one of its sizes.

    Args:
        subproblem: The program.
        penalties: Weights of the exact L1 relaxation; None keeps all rows hard.
        warm: Rows to begin with; left as those of this solution, and empty where Clarabel found
            it: there are too many of them, or the active-set method cannot use them.
    """
    size = subproblem.size
    otherwise = QPSolution.unsolved(size, QPStatus.FAILED)
    with borrowed_space(size) as space:
        fill(space, subproblem, penalties)
        outcome = solve_program(space.program, space.active, warm)
        if outcome == SOLVED:
            return solution_in(space)
        if outcome == NO_CURVATURE:
            return otherwise
        if outcome == INFEASIBLE:
            count = int(space.program.head['conflicting'][0])
            conflict = _named(space, space.active.conflict[:count].tolist())
            otherwise = QPSolution.unsolved(size, QPStatus.INFEASIBLE, conflict)
            if space.program.head['is_proved'][0] or _contradict(subproblem, conflict):
                return otherwise
    warm[0] = 0
    answer = clarabel_backend.solve(subproblem, penalties)
    return otherwise if answer.status is QPStatus.FAILED else answer


def _named(space: Space, numbers: Iterable[int]) -> tuple[Row, ...]:
    """Rows by their numbers, in that order; a bound with both its sides once."""
    return tuple(dict.fromkeys(_row(space, number) for number in sorted(numbers)))


def _row(space: Space, number: int) -> Row:
    if number < space.size.output:
        return Row('terminal', space.size.horizon, number)
    kind, stage, component, _ = locate(space.program, number)
    if kind == PATH:
        return Row('path', stage, component)
    return Row('bound' if kind == BOUND else 'trust', stage, component)


def _contradict(subproblem: Subproblem, rows: Sequence[Row]) -> bool:
    """Whether rows that seem to contradict each other do: among very many, rounding may do it."""
    size = subproblem.size
    least = Penalties(np.zeros(size.output), np.zeros((size.horizon + 1, size.path)))
    for row in rows:
        if row.kind == 'terminal':
            least.terminal[row.index] = np.inf
        elif row.kind == 'path':
            least.path[row.stage, row.index] = np.inf
    alone = clarabel_backend.solve(subproblem.only(rows), least)
    return alone.status is QPStatus.INFEASIBLE


def no_warm_start(size: Dimensions) -> Indices:
    """A warm start with nothing in it."""
    n, r = compiled_size(size.state, size.control)
    return empty_warm_start(size.horizon, n, r, size.output, size.path)
