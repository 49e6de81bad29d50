"""Many programs of all families, on one process or several."""

import signal
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from itertools import islice
from multiprocessing import get_context
from typing import Final, NamedTuple

import numpy as np

from benchmarks.common import BenchError
from benchmarks.verify.case import Case, Contestant, Draft, Origin, Rng, contestant
from benchmarks.verify.compare import Comparison, compare
from benchmarks.verify.programs.degenerate import degenerate, infeasible
from benchmarks.verify.programs.general import general
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

# Part of all programs that is of each family.
SHARES: Final[Mapping[str, float]] = {
    'loop': 0.4,
    'degenerate': 0.15,
    'infeasible': 0.1,
    'crowded': 0.1,
    'flat': 0.1,
    'general': 0.15,
}


def cases(family: str, seed: int) -> Iterator[Case]:
    """The programs of one seed, always the same."""
    if family not in FAMILIES:
        raise BenchError(f'family: found {family!r}, wanted one of {", ".join(FAMILIES)}')
    rng = np.random.default_rng([*family.encode(), seed])
    for number, draft in enumerate(islice(FAMILIES[family](rng), PROGRAMS_PER_SEED)):
        yield Case(Origin(family, seed, number), *draft)


def case(origin: Origin) -> Case:
    """The program of that name."""
    if origin.number >= PROGRAMS_PER_SEED:
        raise BenchError(f'case: found number {origin.number}, wanted below {PROGRAMS_PER_SEED}')
    return next(islice(cases(origin.family, origin.seed), origin.number, None))


class Batch(NamedTuple):
    """The first programs of one seed of a family."""

    family: str
    seed: int
    programs: int


def verify(
    count: int, qp: str, workers: int = 1, progress: Callable[[int], None] = lambda _: None
) -> list[Comparison]:
    """Compare a back end with the references on programs of all families.

    Returns:
        A comparison of each.
    """
    chosen = contestant(qp)
    results: list[Comparison] = []
    for compared in _compared(batches(count), chosen, workers):
        results += compared
        progress(len(compared))
    return results


def verify_case(name: str, qp: str) -> Comparison:
    """Compare a back end with the references on the one program of that name."""
    return compare(case(Origin.parse(name)), contestant(qp))


def batches(count: int) -> list[Batch]:
    """Batches of ``count`` programs, all families advancing together."""
    ends, spent = [], 0.0
    for share in SHARES.values():
        spent += share
        ends.append(round(spent * count))
    counts = [end - begin for begin, end in zip([0, *ends], ends, strict=False)]
    result = []
    for family, programs in zip(SHARES, counts, strict=True):
        for seed, first in enumerate(range(0, programs, PROGRAMS_PER_SEED)):
            result.append(Batch(family, seed, min(PROGRAMS_PER_SEED, programs - first)))
    return sorted(result, key=lambda batch: batch.seed / SHARES[batch.family])


def compare_batch(batch: Batch, chosen: Contestant) -> list[Comparison]:
    """Comparisons of all programs of a batch."""
    return [
        compare(each, chosen) for each in islice(cases(batch.family, batch.seed), batch.programs)
    ]


def _compared(todo: list[Batch], chosen: Contestant, workers: int) -> Iterator[list[Comparison]]:
    if workers == 1:
        yield from (compare_batch(batch, chosen) for batch in todo)
        return
    # A fork would copy the locks of the numerical libraries' threads. An interrupt from the
    # keyboard reaches all processes; this one ends the others.
    quiet = partial(signal.signal, signal.SIGINT, signal.SIG_IGN)
    with ProcessPoolExecutor(workers, get_context('spawn'), initializer=quiet) as pool:
        yield from pool.map(partial(_in_worker, qp=chosen.name), todo)


def _in_worker(batch: Batch, qp: str) -> list[Comparison]:
    return compare_batch(batch, contestant(qp))
