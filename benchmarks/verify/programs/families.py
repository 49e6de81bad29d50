"""Families of programs, by name and seed."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from functools import partial
from itertools import islice
from typing import Final

import numpy as np

from benchmarks.errors import BenchError
from benchmarks.verify.case import Case, Draft, Origin, Rng
from benchmarks.verify.programs.degenerate import degenerate
from benchmarks.verify.programs.general import general
from benchmarks.verify.programs.infeasible import infeasible
from benchmarks.verify.programs.loop import loops
from benchmarks.verify.programs.scenario import crowded, flat, ordinary

PROGRAMS_PER_SEED: Final = 10

FAMILIES: Final[Mapping[str, Callable[[Rng], Iterator[Draft]]]] = {
    'loop': partial(loops, ordinary),
    'degenerate': degenerate,
    'infeasible': infeasible,
    'crowded': partial(loops, crowded),
    'flat': partial(loops, flat),
    'general': general,
}

SHARES: Final[Mapping[str, float]] = {
    'loop': 0.4,
    'degenerate': 0.15,
    'infeasible': 0.1,
    'crowded': 0.1,
    'flat': 0.1,
    'general': 0.15,
}
"""Part of all programs that is of each family."""


def cases(family: str, seed: int) -> Iterator[Case]:
    """The programs of one seed, always the same.

    Raises:
        BenchError: There is no such family.
    """
    if family not in FAMILIES:
        raise BenchError(f'family: found {family!r}, wanted one of {", ".join(FAMILIES)}')
    rng = np.random.default_rng([*family.encode(), seed])
    for number, draft in enumerate(islice(FAMILIES[family](rng), PROGRAMS_PER_SEED)):
        yield Case(Origin(family, seed, number), *draft)


def case(origin: Origin) -> Case:
    """The program of that name.

    Raises:
        BenchError: There is no such family, or not that many programs of one seed.
    """
    if origin.number >= PROGRAMS_PER_SEED:
        raise BenchError(f'case: found number {origin.number}, wanted below {PROGRAMS_PER_SEED}')
    return next(islice(cases(origin.family, origin.seed), origin.number, None))
