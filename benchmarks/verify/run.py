"""Many programs of all families, on one process or several."""

from __future__ import annotations

import signal
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from itertools import islice
from multiprocessing import get_context
from typing import NamedTuple

from benchmarks.verify.case import Origin
from benchmarks.verify.compare import Comparison, compare
from benchmarks.verify.contestant import Contestant, contestant
from benchmarks.verify.programs.families import PROGRAMS_PER_SEED, SHARES, case, cases


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

    Raises:
        ProblemError: No back end of that name is installed; says which are.
    """
    chosen = contestant(qp)
    results: list[Comparison] = []
    for compared in _compared(batches(count), chosen, workers):
        results += compared
        progress(len(compared))
    return results


def verify_case(name: str, qp: str) -> Comparison:
    """Compare a back end with the references on the one program of that name.

    Raises:
        BenchError: There is no program of that name.
        ProblemError: No back end of that name is installed; says which are.
    """
    return compare(case(Origin.parse(name)), contestant(qp))


def batches(count: int) -> list[Batch]:
    """What ``count`` programs are made of, all families advancing together."""
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
