"""Distribution of runs to processes, here or on a Dask cluster; finished runs are kept."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import as_completed
from concurrent.futures.process import BrokenProcessPool
from pathlib import Path
from types import ModuleType
from typing import Any, Final

from cmpsp_ros.studies.common import StudyError
from cmpsp_ros.studies.monte_carlo import results_log
from cmpsp_ros.studies.monte_carlo.driving import drive, outcome
from cmpsp_ros.studies.monte_carlo.outcome import Outcome
from cmpsp_ros.studies.monte_carlo.study import Study
from cmpsp_ros.warmup import new_pool

CHUNK: Final = 8
"""Runs handed to a process at a time."""

Progress = Callable[[int], None]
"""Called with the number of runs finished since the last call."""

_ANSWER_TIMEOUT: Final = 10.0
_CONTINUES: Final = 'is kept, and the same command continues'

# A worker may have several threads; a run has kernels to load and is not made for company.
_ONE_AT_A_TIME: Final = threading.Lock()


def make(
    study: Study, numbers: Sequence[int], folder: Path, workers: int, progress: Progress
) -> Iterator[Outcome]:
    """Make runs, each of which is in the folder's results log before it is yielded.

    Args:
        study: What they depend on.
        numbers: Which ones.
        folder: Of the results log.
        workers: Processes that share the work; 1 is this one.
        progress: See `Progress`.

    Raises:
        StudyError: A process has died, or the disk refuses.
    """
    try:
        if workers == 1:
            for number in numbers:
                yield _make_one(study, number, folder)
                progress(1)
            return
        pool = new_pool(workers)
        try:
            chunks = [pool.submit(_make_chunk, study, each, folder) for each in _chunks(numbers)]
            for done in as_completed(chunks):
                yield from done.result()
                progress(len(done.result()))
        finally:
            pool.shutdown(cancel_futures=True)
    except OSError as error:
        raise StudyError(f'{folder}: {error.strerror or error}') from error
    except BrokenProcessPool as error:
        raise StudyError(
            f'{folder}: a worker has died; what it had finished {_CONTINUES}'
        ) from error


def make_on(
    scheduler: str, study: Study, numbers: Sequence[int], folder: Path, progress: Progress
) -> Iterator[Outcome]:
    """As `make`, on a cluster; unfinished runs of a worker that leaves are repeated by another.

    Args:
        scheduler: Address of a Dask scheduler whose workers have this package, as in
            ``tcp://10.0.0.1:8786``.
        study: What they depend on.
        numbers: Which ones.
        folder: Of the results log.
        progress: See `Progress`.

    Raises:
        StudyError: dask.distributed is missing; the scheduler does not answer, has no worker or
            goes away; a worker has other code or none; or the disk refuses.
    """
    try:
        import distributed  # noqa: PLC0415 (optional)
    except ImportError as error:
        text = f'--scheduler: found no {error.name}, wanted it: pip install distributed'
        raise StudyError(text) from error
    client = _connected(distributed, scheduler)
    gone = (distributed.client.FutureCancelledError, distributed.KilledWorker, OSError)
    code, futures = results_log.digest(), []
    try:
        futures = [
            client.submit(_make_remotely, study, list(each), code, pure=False)
            for each in _chunks(numbers)
        ]
        for done in distributed.as_completed(futures, loop=client.loop):
            try:
                outcomes = done.result()
            except gone as error:
                text = f'lost ({type(error).__name__}); what had been returned {_CONTINUES}'
                raise StudyError(f'{scheduler}: {text}') from error
            except ImportError as error:
                raise StudyError(f'{scheduler}: a worker lacks something: {error}') from error
            for each in outcomes:
                try:
                    results_log.append(folder, each)
                except OSError as error:
                    raise StudyError(f'{folder}: {error.strerror or error}') from error
                yield each
            progress(len(outcomes))
    finally:
        client.cancel(futures)
        client.close()


def _connected(distributed: ModuleType, scheduler: str) -> Any:
    try:
        client = distributed.Client(scheduler, timeout=_ANSWER_TIMEOUT, set_as_default=False)
    except (OSError, ValueError) as error:
        wanted = 'the address of a Dask scheduler, as in tcp://127.0.0.1:8786'
        raise StudyError(
            f'--scheduler: found no answer at {scheduler!r}, wanted {wanted}'
        ) from error
    try:
        client.wait_for_workers(1, timeout=_ANSWER_TIMEOUT)
    except TimeoutError as error:
        client.close()
        raise StudyError(f'--scheduler: found no worker at {scheduler}, wanted one') from error
    return client


def _chunks(numbers: Sequence[int]) -> list[Sequence[int]]:
    return [numbers[first : first + CHUNK] for first in range(0, len(numbers), CHUNK)]


def _make_chunk(study: Study, numbers: Sequence[int], folder: Path) -> list[Outcome]:
    return [_make_one(study, number, folder) for number in numbers]


def _make_one(study: Study, number: int, folder: Path) -> Outcome:
    made = outcome(drive(study.run(number)))
    results_log.append(folder, made)
    return made


def _make_remotely(study: Study, numbers: Sequence[int], code: str) -> list[Outcome]:
    """Runs made by a worker that has the code ``code``."""
    found = results_log.digest()
    if found != code:
        raise StudyError(f'a worker has other code: found {found}, wanted {code}')
    with _ONE_AT_A_TIME:
        return [outcome(drive(study.run(number))) for number in numbers]
