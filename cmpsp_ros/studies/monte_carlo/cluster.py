"""Runs shared out to a Dask cluster; what comes back is kept here, once."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from types import ModuleType
from typing import Any, Final

from cmpsp_ros.studies.monte_carlo import ledger
from cmpsp_ros.studies.monte_carlo.driving import drive, outcome
from cmpsp_ros.studies.monte_carlo.errors import StudyError
from cmpsp_ros.studies.monte_carlo.outcome import Outcome
from cmpsp_ros.studies.monte_carlo.study import Study
from cmpsp_ros.studies.monte_carlo.workers import CHUNK

_ANSWER_TIMEOUT: Final = 10.0

# A worker may have several threads; a run has kernels to load and is not made for company.
_ONE_AT_A_TIME: Final = threading.Lock()


def make_on(
    scheduler: str,
    study: Study,
    numbers: Sequence[int],
    folder: Path,
    progress: Callable[[int], None],
) -> Iterator[Outcome]:
    """Make runs on a cluster; each is in the folder's ledger before it is yielded.

    A worker that goes takes nothing along: what it had not given back is made by another.

    Args:
        scheduler: Address of a Dask scheduler whose workers have this package, as in
            ``tcp://10.0.0.1:8786``.
        study: What they depend on.
        numbers: Which ones.
        folder: Of the ledger.
        progress: Told how many runs have finished since it was last told.

    Raises:
        StudyError: dask.distributed is missing; the scheduler does not answer, has no worker or
            goes away; a worker has other code or none; or the disk refuses.
    """
    distributed = _distributed()
    client = _connected(distributed, scheduler)
    gone = (distributed.client.FutureCancelledError, distributed.KilledWorker, OSError)
    code, futures = ledger.digest(), []
    try:
        futures = [
            client.submit(
                _make_chunk, study, list(numbers[first : first + CHUNK]), code, pure=False
            )
            for first in range(0, len(numbers), CHUNK)
        ]
        for done in distributed.as_completed(futures, loop=client.loop):
            try:
                outcomes = done.result()
            except gone as error:
                text = 'what had come back is kept, and the same command goes on'
                raise StudyError(f'{scheduler}: lost ({type(error).__name__}); {text}') from error
            except ImportError as error:
                raise StudyError(f'{scheduler}: a worker lacks something: {error}') from error
            for each in outcomes:
                _keep(folder, each)
                yield each
            progress(len(outcomes))
    finally:
        client.cancel(futures)
        client.close()


def _distributed() -> ModuleType:
    try:
        import distributed  # noqa: PLC0415 (optional)
    except ImportError as error:
        text = f'--scheduler: found no {error.name}, wanted it: pip install distributed'
        raise StudyError(text) from error
    return distributed


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


def _keep(folder: Path, made: Outcome) -> None:
    try:
        ledger.append(folder, made)
    except OSError as error:
        raise StudyError(f'{folder}: {error.strerror or error}') from error


def _make_chunk(study: Study, numbers: Sequence[int], code: str) -> list[Outcome]:
    """Runs made by a worker that has the code ``code``."""
    found = ledger.digest()
    if found != code:
        raise StudyError(f'a worker has other code: found {found}, wanted {code}')
    with _ONE_AT_A_TIME:
        return [outcome(drive(study.run(number))) for number in numbers]
