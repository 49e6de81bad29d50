"""Between a program as arrays and the records that compiled code works on.

Code is compiled for a size, which takes long; a program of another size is filled up with states
and controls that nothing moves and that cost nothing else. They are 0 in every solution.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Final, NamedTuple

import numpy as np

from cmpsp_ros.mpsp.problem import Array, Dimensions, Linearisation
from cmpsp_ros.mpsp.qp.riccati.active_set import (
    ActiveSet,
    Indices,
    empty_active_set,
    empty_warm_start,
)
from cmpsp_ros.mpsp.qp.riccati.factorisation import factorise
from cmpsp_ros.mpsp.qp.riccati.fixed_bounds import free_all
from cmpsp_ros.mpsp.qp.riccati.program import Program, Records, empty_program
from cmpsp_ros.mpsp.qp.stage_qp import Multipliers, StageQP
from cmpsp_ros.mpsp.qp.subproblem import Subproblem

SIZES: Final = ((3, 2), (5, 2), (8, 4), (16, 8), (32, 16), (64, 32))
"""States and controls that code is compiled for; those of the guidance law first."""


class Space(NamedTuple):
    """Memory for one program, with the sizes that the user's has.

    Attributes:
        size: The user's sizes.
        program: The records.
        active: Memory for the active-set method.
        warm: A warm start with nothing in it.
    """

    size: Dimensions
    program: Program
    active: ActiveSet
    warm: Indices


def compiled_size(n: int, r: int) -> tuple[int, int]:
    """The least size that code is compiled for and that a program fits in."""
    for states, controls in SIZES:
        if n <= states and r <= controls and (states > 5 or (n, r) == (states, controls)):
            return states, controls
    return n, r


def space(size: Dimensions) -> Space:
    """Memory for programs of some sizes."""
    n, r = compiled_size(size.state, size.control)
    sizes = size.horizon, n, r, size.output, size.path
    program = empty_program(*sizes)
    for a in range(size.control, r):
        program.stages['L_UU'][:, a, a] = 1.0
    return Space(size, program, empty_active_set(*sizes), empty_warm_start(*sizes))


_free: defaultdict[Dimensions, list[Space]] = defaultdict(list)


@contextmanager
def borrowed_space(size: Dimensions) -> Iterator[Space]:
    """Memory that nobody else uses meanwhile: making it takes longer than solving."""
    free = _free[size]
    mine = free.pop() if free else space(size)
    yield mine
    free.append(mine)


def fill(
    into: Space, qp: StageQP, terminal: Array | None = None, path: Array | None = None
) -> None:
    """Write a program into records.

    Args:
        into: Memory for its sizes.
        qp: The program.
        terminal: Largest multipliers of the terminal rows, shape ``(m,)``; None for hard ones.
        path: The same of the path rows, shape ``(N + 1, l)``.
    """
    n, r, N = into.size.state, into.size.control, into.size.horizon
    program, stages = into.program, into.program.stages
    head = program.head
    head['horizon'], head['work'], head['is_factorised'], head['begun'] = N, 0, 0, 0
    head['trust_radius'] = np.inf
    head['trust_radius'][0, :n] = qp.trust_radius
    stages['lower'][:, :r], stages['upper'][:, :r] = qp.lower, qp.upper
    put_derivatives(stages, program.path, program.terminal, qp)
    program.terminal['penalty'] = np.inf if terminal is None else terminal
    program.path['penalty'] = np.inf if path is None else path


def put_derivatives(
    stages: Records, path: Records, terminal: Records, qp: StageQP | Linearisation
) -> None:
    """Write derivatives along a trajectory into records, which may be larger in any size.

    Args:
        stages: Of `cmpsp_ros.mpsp.qp.riccati.layout.stage_type`.
        path: Of `row_type`.
        terminal: Of `row_type`.
        qp: The derivatives.
    """
    N, n, r = qp.B.shape
    stages, path = stages[: N + 1], path[: N + 1]
    stages['A'][:N, :n, :n], stages['B'][:N, :n, :r] = qp.A, qp.B
    stages['L_X'][:, :n], stages['L_U'][:, :r] = qp.L_X, qp.L_U
    stages['L_XX'][:, :n, :n], stages['L_UX'][:, :r, :n] = qp.L_XX, qp.L_UX
    stages['L_UU'][:, :r, :r] = qp.L_UU
    terminal['value'], terminal['X'][:, :n], terminal['U'][:, :r] = qp.output_error, qp.h_X, qp.h_U
    path['value'], path['X'][:, :, :n], path['U'][:, :, :r] = qp.g, qp.g_X, qp.g_U


def derivatives_in(
    stages: Records, path: Records, terminal: Records, n: int, r: int
) -> Linearisation:
    """The derivatives in records, of ``n`` states and ``r`` controls, in arrays of their own."""
    return Linearisation(
        A=stages['A'][:-1, :n, :n].copy(),
        B=stages['B'][:-1, :n, :r].copy(),
        L_X=stages['L_X'][:, :n].copy(),
        L_U=stages['L_U'][:, :r].copy(),
        L_XX=stages['L_XX'][:, :n, :n].copy(),
        L_UX=stages['L_UX'][:, :r, :n].copy(),
        L_UU=stages['L_UU'][:, :r, :r].copy(),
        output_error=terminal['value'].copy(),
        h_X=terminal['X'][:, :n].copy(),
        h_U=terminal['U'][:, :r].copy(),
        g=path['value'].copy(),
        g_X=path['X'][:, :, :n].copy(),
        g_U=path['U'][:, :, :r].copy(),
    )


def subproblem_in(of: Space) -> Subproblem:
    """The program in records, on their present horizon, in arrays of its own."""
    n, r, count = of.size.state, of.size.control, int(of.program.head['horizon'][0]) + 1
    stages, path = of.program.stages[:count], of.program.path[:count]
    lower, upper = stages['lower'][:, :r].copy(), stages['upper'][:, :r].copy()
    trust_radius = of.program.head['trust_radius'][0, :n].copy()
    linearisation = derivatives_in(stages, path, of.program.terminal, n, r)
    return Subproblem(linearisation, lower, upper, trust_radius)


def put_solution(into: Space, dU: Array, dX: Array, multipliers: Multipliers) -> None:
    """Write a step and its multipliers into records; shapes as in `Multipliers`."""
    n, r, count = into.size.state, into.size.control, len(dU)
    stages = into.program.stages[:count]
    stages['dU'], stages['dX'], stages['bounds'], stages['trust'] = 0.0, 0.0, 0.0, 0.0
    stages['dU'][:, :r], stages['dX'][:, :n] = dU, dX
    stages['bounds'][:, :r], stages['trust'][:, :n] = multipliers.bounds, multipliers.trust
    into.program.terminal['multiplier'] = multipliers.terminal
    into.program.path['multiplier'][:count] = multipliers.path


def multipliers_of(of: Space) -> Multipliers:
    """Multipliers of the solution in records, in arrays of their own."""
    n, r, stages = of.size.state, of.size.control, of.program.stages
    return Multipliers(
        of.program.terminal['multiplier'].copy(),
        of.program.path['multiplier'].copy(),
        stages['trust'][:, :n].copy(),
        stages['bounds'][:, :r].copy(),
    )


def is_positive_definite(qp: StageQP, shift: float = 0.0, sign: float = 1.0) -> bool:
    """Whether ``sign H + shift I`` is positive definite, with ``H`` the condensed Hessian.

    One Riccati sweep, which takes time linear in the horizon.
    """
    N, n, r = qp.B.shape
    # What is beyond all numbers is not definite.
    with np.errstate(over='ignore', invalid='ignore'):
        changed = qp._replace(
            L_XX=sign * qp.L_XX, L_UX=sign * qp.L_UX, L_UU=sign * qp.L_UU + shift * np.eye(r)
        )
    size = Dimensions(N, n, r, len(qp.output_error), qp.g.shape[1])
    with borrowed_space(size) as mine:
        fill(mine, changed)
        free_all(mine.program)
        return bool(factorise(mine.program))
