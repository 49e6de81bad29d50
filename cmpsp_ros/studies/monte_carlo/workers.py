"""Runs shared out to processes, each of which keeps what it has finished."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import as_completed
from concurrent.futures.process import BrokenProcessPool
from pathlib import Path
from typing import Final

from cmpsp_ros.studies.monte_carlo import ledger
from cmpsp_ros.studies.monte_carlo.driving import drive, outcome
from cmpsp_ros.studies.monte_carlo.errors import StudyError
from cmpsp_ros.studies.monte_carlo.outcome import Outcome
from cmpsp_ros.studies.monte_carlo.study import Study
from cmpsp_ros.warmup.process_pool import new_pool

CHUNK: Final = 8
"""Runs handed to a process at a time."""


def make(
    study: Study,
    numbers: Sequence[int],
    folder: Path,
    workers: int,
    progress: Callable[[int], None],
) -> Iterator[Outcome]:
    """Make runs, each of which is in the folder's ledger before it is yielded.

    Args:
        study: What they depend on.
        numbers: Which ones.
        folder: Of the ledger.
        workers: Processes that share the work; 1 is this one.
        progress: Told how many runs have finished since it was last told.

    Raises:
        StudyError: A process has died, or the disk refuses.
    """
    try:
        if workers == 1:
            for number in numbers:
                yield _make_one(study, number, folder)
                progress(1)
            return
        yield from _shared(study, numbers, folder, workers, progress)
    except OSError as error:
        raise StudyError(f'{folder}: {error.strerror or error}') from error
    except BrokenProcessPool as error:
        text = 'a worker has died; what it had finished is kept, and the same command goes on'
        raise StudyError(f'{folder}: {text}') from error


def _shared(
    study: Study,
    numbers: Sequence[int],
    folder: Path,
    workers: int,
    progress: Callable[[int], None],
) -> Iterator[Outcome]:
    pool = new_pool(workers)
    try:
        chunks = [
            pool.submit(_make_chunk, study, numbers[first : first + CHUNK], folder)
            for first in range(0, len(numbers), CHUNK)
        ]
        for done in as_completed(chunks):
            outcomes = done.result()
            yield from outcomes
            progress(len(outcomes))
    finally:
        pool.shutdown(cancel_futures=True)


def _make_chunk(study: Study, numbers: Sequence[int], folder: Path) -> list[Outcome]:
    return [_make_one(study, number, folder) for number in numbers]


def _make_one(study: Study, number: int, folder: Path) -> Outcome:
    made = outcome(drive(study.run(number)))
    ledger.append(folder, made)
    return made
