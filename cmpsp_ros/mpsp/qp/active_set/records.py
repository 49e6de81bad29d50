"""Conversion of subproblems to the records that compiled code works on, and back.

Code is compiled for a size, which takes long; a program of another size is filled up with states
and controls that nothing moves and that cost nothing else. They are 0 in every solution.
"""

from collections import defaultdict
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import Final

import numpy as np

from cmpsp_ros.arrays import Array
from cmpsp_ros.mpsp.jit.compiled import entry_for
from cmpsp_ros.mpsp.problem import Dimensions, Linearisation
from cmpsp_ros.mpsp.qp.active_set.fixed_bounds import free_all
from cmpsp_ros.mpsp.qp.active_set.solver import solve
from cmpsp_ros.mpsp.qp.active_set.state import (
    ActiveSet,
    WarmStart,
    empty_active_set,
    empty_warm_start,
)
from cmpsp_ros.mpsp.qp.riccati import kkt
from cmpsp_ros.mpsp.qp.riccati.factorisation import factorise
from cmpsp_ros.mpsp.qp.riccati.program import (
    Outcome,
    Program,
    Records,
    RowKind,
    empty_program,
    locate,
)
from cmpsp_ros.mpsp.qp.subproblem import Penalties, QPSolution, QPStatus, Row, Subproblem

# States and controls that code is compiled for; those of the guidance law first.
SIZES: Final = ((3, 2), (5, 2), (6, 3), (8, 4), (16, 8), (32, 16), (64, 32))


# Sweeps over the stages after which a program is left to Clarabel.
#
# Hard ones take up to 40,000; where rows depend on each other rounding may lead round in circles.
MOST_SWEEPS: Final = 100_000

_FIELDS: Final = tuple(field.name for field in fields(Linearisation))


@dataclass(frozen=True)
class Space:
    """Memory for one program: the user's sizes, records, active set and an empty warm start."""

    size: Dimensions
    program: Program
    active: ActiveSet
    warm: WarmStart

    @cached_property
    def derivatives(self) -> tuple[Array, ...]:
        """Views as of `derivative_arrays`; making them takes longer than a copy."""
        program = self.program
        return derivative_arrays(program.stages, program.path, program.terminal, self.size)

    def solve(self, warm: WarmStart) -> Outcome:
        """Solve the program as `solver.solve` does."""
        return Outcome(self._solve(self.program, self.active, warm))

    def residual(self) -> float:
        """Residual of the solution in the records, as `kkt.kkt_residual`."""
        return self._residual(self.program)

    @cached_property
    def _solve(self) -> Callable[[Program, ActiveSet, WarmStart], int]:
        return entry_for(solve, self.program, self.active, self.warm)

    @cached_property
    def _residual(self) -> Callable[[Program], float]:
        return entry_for(kkt.kkt_residual, self.program)


def compiled_size(n: int, r: int) -> tuple[int, int]:
    """The least size that code is compiled for and that a program fits in."""
    for states, controls in SIZES:
        # The first is for robots alone: most problems fit in the second.
        if n <= states and r <= controls and (states > 3 or (n, r) == (states, controls)):
            return states, controls
    return n, r


def space(size: Dimensions) -> Space:
    """Memory for programs of some sizes."""
    n, r = compiled_size(size.state, size.control)
    sizes = size.horizon, n, r, size.output, size.path
    program = empty_program(*sizes)
    for a in range(size.control, r):
        program.stages['L_UU'][:, a, a] = 1.0
    program.head['work_limit'] = MOST_SWEEPS * (size.horizon + 1)
    return Space(size, program, empty_active_set(*sizes), empty_warm_start(*sizes))


_free: defaultdict[Dimensions, list[Space]] = defaultdict(list)


@contextmanager
def borrowed_space(size: Dimensions) -> Iterator[Space]:
    """Memory that nobody else uses meanwhile: making it takes longer than solving."""
    free = _free[size]
    mine = free.pop() if free else space(size)
    yield mine
    free.append(mine)


def fill(into: Space, qp: Subproblem, penalties: Penalties | None = None) -> None:
    """Write a program of the memory's sizes into its records; all rows hard without penalties."""
    n, r = into.size.state, into.size.control
    program, stages, head = into.program, into.program.stages, into.program.head
    put_derivatives(into.derivatives, qp.linearisation)
    head['horizon'] = into.size.horizon
    head['work'], head['is_factorised'], head['begun'] = 0, 0, 0
    head['trust_radius'] = np.inf
    head['trust_radius'][0, :n] = qp.trust_radius
    stages['lower'][:, :r], stages['upper'][:, :r] = qp.lower, qp.upper
    program.terminal['penalty'] = np.inf if penalties is None else penalties.terminal
    program.path['penalty'] = np.inf if penalties is None else penalties.path


def put_derivatives(into: tuple[Array, ...], lin: Linearisation) -> None:
    """Write derivatives along a trajectory into arrays as of `derivative_arrays`."""
    for array, name in zip(into, _FIELDS, strict=True):
        array[...] = getattr(lin, name)


def derivatives_in(
    stages: Records, path: Records, terminal: Records, size: Dimensions
) -> Linearisation:
    """The derivatives in records, in arrays of their own."""
    return Linearisation(*(each.copy() for each in derivative_arrays(stages, path, terminal, size)))


def subproblem_in(of: Space) -> Subproblem:
    """The program in records, on their present horizon, in arrays of its own."""
    program = of.program
    size = replace(of.size, horizon=int(program.head['horizon'][0]))
    linearisation = derivatives_in(program.stages, program.path, program.terminal, size)
    stages, r = program.stages[: size.horizon + 1], size.control
    lower, upper = stages['lower'][:, :r].copy(), stages['upper'][:, :r].copy()
    trust_radius = program.head['trust_radius'][0, : size.state].copy()
    return Subproblem(linearisation, lower, upper, trust_radius)


def program_in(of: Space) -> tuple[Subproblem, Penalties | None]:
    """The program in records, with its penalties unless all rows are hard."""
    subproblem, program = subproblem_in(of), of.program
    path = program.path['penalty'][: subproblem.size.horizon + 1].copy()
    weights = Penalties(program.terminal['penalty'].copy(), path)
    is_hard = np.isinf(weights.terminal).all() and np.isinf(path).all()
    return subproblem, None if is_hard else weights


def derivative_arrays(
    stages: Records, path: Records, terminal: Records, size: Dimensions
) -> tuple[Array, ...]:
    """Views of records, which may be larger in any size, as the fields of a `Linearisation`."""
    N, n, r, l = size.horizon, size.state, size.control, size.path  # noqa: E741 (the paper's l)
    stages, path = stages[: N + 1], path[: N + 1]
    return (
        stages['A'][:N, :n, :n],
        stages['B'][:N, :n, :r],
        stages['L_X'][:, :n],
        stages['L_U'][:, :r],
        stages['L_XX'][:, :n, :n],
        stages['L_UX'][:, :r, :n],
        stages['L_UU'][:, :r, :r],
        terminal['value'],
        terminal['X'][:, :n],
        terminal['U'][:, :r],
        path['value'][:, :l],
        path['X'][:, :l, :n],
        path['U'][:, :l, :r],
    )


def put_solution(into: Space, found: QPSolution, dX: Array) -> None:
    """Write a solution, and the states ``(N + 1, n)`` it leads to, into records."""
    n, r, count = into.size.state, into.size.control, len(dX)
    stages = into.program.stages[:count]
    stages['dU'], stages['dX'], stages['bounds'], stages['trust'] = 0.0, 0.0, 0.0, 0.0
    stages['dU'][:, :r], stages['dX'][:, :n] = found.dU, dX
    stages['bounds'][:, :r], stages['trust'][:, :n] = found.bounds, found.trust
    into.program.terminal['multiplier'] = found.terminal
    into.program.path['multiplier'][:count] = found.path


def solution_in(of: Space) -> QPSolution:
    """The solution in records, in arrays of its own."""
    n, r, stages = of.size.state, of.size.control, of.program.stages
    return QPSolution(
        QPStatus.SOLVED,
        stages['dU'][:, :r].copy(),
        of.program.terminal['multiplier'].copy(),
        of.program.path['multiplier'].copy(),
        stages['trust'][:, :n].copy(),
        stages['bounds'][:, :r].copy(),
        int(of.program.head['iterations'][0]),
    )


def conflict_in(of: Space) -> tuple[Row, ...]:
    """The rows named by the solver as contradicting each other; a bound with both sides once."""
    count = int(of.program.head['conflicting'][0])
    numbers = sorted(of.active.conflict[:count].tolist())
    return tuple(dict.fromkeys(_row(of, number) for number in numbers))


def _row(of: Space, number: int) -> Row:
    if number < of.size.output:
        return Row('terminal', of.size.horizon, number)
    kind, stage, component, _ = locate(of.program, number)
    if kind == RowKind.PATH:
        return Row('path', stage, component)
    return Row('bound' if kind == RowKind.BOUND else 'trust', stage, component)


def kkt_residual(qp: Subproblem, solution: QPSolution, penalties: Penalties | None) -> float:
    """Largest violation of the optimality conditions, as `kkt.kkt_residual`; of any solution."""
    with borrowed_space(qp.size) as mine:
        fill(mine, qp, penalties)
        put_solution(mine, solution, qp.propagate(solution.dU))
        return mine.residual()


def residual_without_step(
    into: Space, qp: Subproblem, terminal: Array, path: Array, bounds: Array
) -> float:
    """`kkt_residual` at ``dU = 0`` with these multipliers; the program is left in the records."""
    fill(into, qp)
    stages = into.program.stages
    stages['dU'], stages['dX'], stages['trust'] = 0.0, 0.0, 0.0
    stages['bounds'][:, : into.size.control] = bounds
    into.program.terminal['multiplier'] = terminal
    into.program.path['multiplier'] = path
    return into.residual()


def is_positive_definite(qp: Subproblem, shift: float = 0.0) -> bool:
    """True where ``H + shift I`` is, with ``H`` the condensed Hessian; one Riccati sweep."""
    with definite_from(qp, 1.0) as is_definite:
        return is_definite(shift)


@contextmanager
def definite_from(qp: Subproblem, sign: float) -> Iterator[Callable[[float], bool]]:
    """`is_positive_definite` of ``sign H`` of one program, as a function of the shift."""
    with borrowed_space(qp.size) as mine:
        fill(mine, qp)
        if sign != 1.0:
            for block in mine.derivatives[4:7]:
                np.multiply(block, sign, out=block)
        diagonal = np.einsum('kaa->ka', mine.derivatives[6])
        unshifted = diagonal.copy()
        free_all(mine.program)

        def is_definite(shift: float) -> bool:
            # Infinite entries are not definite.
            with np.errstate(over='ignore', invalid='ignore'):
                np.add(unshifted, shift, out=diagonal)
            return bool(factorise(mine.program))

        yield is_definite
