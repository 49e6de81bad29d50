"""Programs to verify a back end on, their names, and the back end under test."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from benchmarks.common import BenchError
from cmpsp_ros.mpsp.qp import (
    RICCATI_ACTIVE_SET,
    Penalties,
    QPSolution,
    Subproblem,
    backend,
    no_warm_start,
    solve_from,
)

Rng = np.random.Generator


class Origin(NamedTuple):
    """Origin of a program; written ``family/seed/number``."""

    family: str  # name of its family
    seed: int  # seed of the family's generator
    number: int  # index among the programs of that seed, from 0

    def __str__(self) -> str:
        return f'{self.family}/{self.seed}/{self.number}'

    @classmethod
    def parse(cls, text: str) -> Origin:
        """The origin that is written so."""
        parts = text.split('/')
        if len(parts) != 3 or not all(part.isdecimal() for part in parts[1:]):
            raise BenchError(f'case: found {text!r}, wanted FAMILY/SEED/NUMBER, as in loop/17/3')
        return cls(parts[0], int(parts[1]), int(parts[2]))


@dataclass(frozen=True)
class Program:
    """A subproblem, and how to solve it."""

    subproblem: Subproblem  # the program
    # Weights of the exact L1 relaxation; None where its rows are hard.
    penalties: Penalties | None = None


class Draft(NamedTuple):
    """A program as a family makes it."""

    about: str  # description
    program: Program  # the program
    before: Program  # one of the same sizes, whose solution is the warm start; it may be a bad one


class Case(NamedTuple):
    """A draft with the name of its origin; the other attributes are those of `Draft`."""

    origin: Origin
    about: str
    program: Program
    before: Program


@dataclass(frozen=True)
class Contestant:
    """A back end, without the check of its answers that users of it get."""

    name: str
    cold: Callable[[Program], QPSolution]  # solves a program from nothing
    # Solves a program after the one that is given second, whose solution is the warm start; None
    # for back ends without warm starts.
    warm: Callable[[Program, Program], QPSolution] | None = None


def contestant(name: str) -> Contestant:
    """The back end of that name."""
    solve = backend(name)

    def cold(program: Program) -> QPSolution:
        return solve(program.subproblem, program.penalties)

    return Contestant(name, cold, _active_set_after if name == RICCATI_ACTIVE_SET else None)


def _active_set_after(program: Program, before: Program) -> QPSolution:
    warm = no_warm_start(program.subproblem.size)
    solve_from(before.subproblem, before.penalties, warm)
    return solve_from(program.subproblem, program.penalties, warm)
