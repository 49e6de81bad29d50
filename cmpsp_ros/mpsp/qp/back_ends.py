"""QP back ends by name, the compiled Riccati active-set method first; every answer is checked."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache, partial
from importlib.util import find_spec
from typing import Final

import numpy as np

from cmpsp_ros.mpsp.arguments import ProblemError
from cmpsp_ros.mpsp.problem import Dimensions
from cmpsp_ros.mpsp.qp.active_set.records import (
    Space,
    borrowed_space,
    compiled_size,
    conflict_in,
    fill,
    kkt_residual,
    solution_in,
)
from cmpsp_ros.mpsp.qp.active_set.state import WarmStart, empty_warm_start
from cmpsp_ros.mpsp.qp.dense import clarabel_backend, hildreth
from cmpsp_ros.mpsp.qp.dense.back_ends import solve_by_daqp, solve_by_qpsolvers
from cmpsp_ros.mpsp.qp.riccati.program import Outcome
from cmpsp_ros.mpsp.qp.subproblem import (
    TOLERANCE,
    Backend,
    Penalties,
    QPSolution,
    QPStatus,
    Row,
    Subproblem,
)

RICCATI_ACTIVE_SET: Final = 'riccati_active_set'  # the default back end

# The back end that the default one falls back on, where it is installed.
CLARABEL: Final = 'clarabel'


def solve(subproblem: Subproblem, penalties: Penalties | None) -> QPSolution:
    """Solve a subproblem by the dual active-set method, or else by Clarabel."""
    return solve_from(subproblem, penalties, no_warm_start(subproblem.size))


def solve_from(subproblem: Subproblem, penalties: Penalties | None, warm: WarmStart) -> QPSolution:
    """Solve a subproblem, beginning with the active rows of another one of its sizes.

    `warm` is left with the rows of this solution, and empty where Clarabel found it: there are too
    many of them, or the active-set method cannot use them.
    """
    with borrowed_space(subproblem.size) as space:
        fill(space, subproblem, penalties)
        return answer_in(space, space.solve(warm), warm, lambda: (subproblem, penalties))


def answer_in(
    space: Space,
    outcome: int,
    warm: WarmStart,
    program: Callable[[], tuple[Subproblem, Penalties | None]],
) -> QPSolution:
    """Answer of the active-set method in records, else that of Clarabel to the same `program`."""
    if outcome == Outcome.SOLVED:
        return solution_in(space)
    otherwise = QPSolution.unsolved(space.size, QPStatus.FAILED)
    if outcome == Outcome.NO_CURVATURE:
        return otherwise
    subproblem, penalties = program()
    if outcome == Outcome.INFEASIBLE:
        conflict = conflict_in(space)
        otherwise = QPSolution.unsolved(space.size, QPStatus.INFEASIBLE, conflict)
        if space.program.head['is_proved'][0] or _contradict(subproblem, conflict):
            return otherwise
    warm.clear()
    answer = _checked(subproblem, penalties, clarabel_backend.solve(subproblem, penalties))
    return otherwise if answer.status is QPStatus.FAILED else answer


def _contradict(subproblem: Subproblem, rows: Sequence[Row]) -> bool:
    """True where rows that seem to contradict each other do; among many, rounding misleads."""
    size = subproblem.size
    least = Penalties(np.zeros(size.output), np.zeros((size.horizon + 1, size.path)))
    for row in rows:
        if row.kind == 'terminal':
            least.terminal[row.index] = np.inf
        elif row.kind == 'path':
            least.path[row.stage, row.index] = np.inf
    alone = clarabel_backend.solve(subproblem.only(rows), least)
    return alone.status is QPStatus.INFEASIBLE


def no_warm_start(size: Dimensions) -> WarmStart:
    """A warm start with nothing in it."""
    n, r = compiled_size(size.state, size.control)
    return empty_warm_start(size.horizon, n, r, size.output, size.path)


_NATIVE: Final[dict[str, Backend]] = {
    RICCATI_ACTIVE_SET: solve,
    CLARABEL: clarabel_backend.solve,
    'daqp': solve_by_daqp,
    'hildreth': hildreth.solve,
}


# Packages of back ends that need one
_PACKAGES: Final = {CLARABEL: 'clarabel', 'daqp': 'daqp'}


def available() -> tuple[str, ...]:
    """Names of all back ends installed here, the native ones first."""
    native = tuple(name for name in _NATIVE if _is_installed(name))
    if find_spec('qpsolvers') is None:
        return native
    import qpsolvers  # noqa: PLC0415 (slow to import, and few runs need it)

    return native + tuple(name for name in qpsolvers.available_solvers if name not in native)


@cache
def backend(name: str) -> Backend:
    """The back end of that name.

    Raises:
        ProblemError: No back end of that name is installed; says which are.
    """
    if name in _NATIVE and _is_installed(name):
        return _NATIVE[name]
    if name not in available():
        raise ProblemError(
            f'qp: found {name!r}, wanted one of {", ".join(available())};'
            ' `pip install daqp qpsolvers clarabel` adds others'
        )
    return partial(solve_by_qpsolvers, name)


def _is_installed(name: str) -> bool:
    package = _PACKAGES.get(name)
    return package is None or find_spec(package) is not None


def solve_qp(
    subproblem: Subproblem,
    name: str,
    penalties: Penalties | None = None,
    warm: WarmStart | None = None,
) -> QPSolution:
    """Solve a subproblem by a back end's name, and check the answer.

    `warm` is as in `solve_from`, for the default back end. Penalties are the weights of the exact
    L1 relaxation of (54) and (57); None keeps them hard. The status is `QPStatus.FAILED` where a
    back end claims a solution that does not meet the optimality conditions.
    """
    if warm is not None and name == RICCATI_ACTIVE_SET:
        return solve_from(subproblem, penalties, warm)
    solution = backend(name)(subproblem, penalties)
    # The active-set method checks its answers itself, in the records that it works on.
    return solution if name == RICCATI_ACTIVE_SET else _checked(subproblem, penalties, solution)


def _checked(
    subproblem: Subproblem, penalties: Penalties | None, solution: QPSolution
) -> QPSolution:
    if solution.status is QPStatus.SOLVED:
        residual = kkt_residual(subproblem, solution, penalties)
        if not residual <= TOLERANCE:
            return replace(solution, status=QPStatus.FAILED)
    return solution
