"""The back end under test, asked cold and with a warm start."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from benchmarks.verify.case import Program
from cmpsp_ros.mpsp.qp import RICCATI_ACTIVE_SET, QPSolution, backend, no_warm_start, solve_from


@dataclass(frozen=True)
class Contestant:
    """A back end, without the check of its answers that users of it get.

    Attributes:
        name: Its name.
        cold: Solves a program from nothing.
        warm: Solves a program after the one that is given second, whose solution is the warm start;
            None for back ends without warm starts.
    """

    name: str
    cold: Callable[[Program], QPSolution]
    warm: Callable[[Program, Program], QPSolution] | None = None


def contestant(name: str) -> Contestant:
    """The back end of that name.

    Raises:
        ProblemError: No back end of that name is installed; says which are.
    """
    solve = backend(name)

    def cold(program: Program) -> QPSolution:
        return solve(program.subproblem, program.penalties)

    return Contestant(name, cold, _active_set_after if name == RICCATI_ACTIVE_SET else None)


def _active_set_after(program: Program, before: Program) -> QPSolution:
    warm = no_warm_start(program.subproblem.size)
    solve_from(before.subproblem, before.penalties, warm)
    return solve_from(program.subproblem, program.penalties, warm)
