"""A study from its first run to its pictures; processes or a Dask cluster share its runs."""

import contextlib
import gc
import json
import multiprocessing
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import as_completed
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from types import ModuleType
from typing import Any, Final

from cmpsp_ros.guidance import NANOSECONDS
from cmpsp_ros.studies.common import StudyError, UsageError, disk_errors
from cmpsp_ros.studies.monte_carlo import judging, pictures
from cmpsp_ros.studies.monte_carlo.driving import DrivenRun, drive, outcome
from cmpsp_ros.studies.monte_carlo.outcome import (
    RunVerdict,
    StudyOutcome,
    append,
    digest,
    open_results_log,
)
from cmpsp_ros.studies.monte_carlo.study import RunTask, Study
from cmpsp_ros.studies.monte_carlo.summary import figures, write_parquet
from cmpsp_ros.warmup import new_pool

PICTURES: Final = 12  # failures of which a picture is drawn
CHUNK: Final = 8  # runs handed to a process at a time
_ANSWER_TIMEOUT: Final = 10.0
_CONTINUES: Final = 'is kept, and the same command continues'

# A worker may have several threads; a run has kernels to load and is not made for company.
_ONE_AT_A_TIME: Final = threading.Lock()

# Called with a part of the work and its pieces; returns a function for pieces done.
Progress = Callable[[str, int], Callable[[int], None]]


@dataclass(frozen=True)
class Order:
    """A request for a study of so many runs, with all results in a folder."""

    study: Study
    runs: int
    folder: Path
    workers: int = 1  # processes that share the runs; 1 is this one
    # Address of a Dask scheduler whose workers share them instead, if any, as in
    # ``tcp://10.0.0.1:8786``; they need this package.
    scheduler: str = ''
    judge: bool = False  # true if IPOPT is run on failed runs
    costs: int = 0  # number of runs that arrived whose cost is compared with IPOPT's


def run_study(order: Order, progress: Progress) -> dict[str, Any]:
    """Make the missing runs, and summarise all of them; the figures, as in `summary.json`.

    Raises StudyError if folder, workers or cluster cannot be used or CasADi is missing, and
    ParameterError.
    """
    study, folder = order.study, order.folder
    there = open_results_log(folder, study)
    missing = [number for number in range(order.runs) if number not in there]
    advance = progress('runs', order.runs)
    advance(order.runs - len(missing))
    make = _make_on_cluster if order.scheduler else make_runs
    there |= {made.number: made for made in make(order, missing, advance)}
    outcomes = [there[number] for number in range(order.runs)]
    failed = [each.number for each in outcomes if each.failed(study.tolerance)]
    arrived = [each.number for each in outcomes if each.miss <= study.tolerance]
    solved = partial(_solved, order, progress)
    judged = solved('judge', failed if order.judge else [], judging.JUDGED, judging.judge_failure)
    compared = solved('costs', arrived[: order.costs], judging.COSTS, judging.compare_cost)
    values = figures(study, outcomes, judged, compared)
    with disk_errors(folder):
        (folder / 'summary.json').write_text(json.dumps(values, indent=2) + '\n', encoding='utf-8')
        write_parquet(folder / 'runs.parquet', outcomes, study.tolerance, judged)
        _draw(order, outcomes, failed[:PICTURES], progress)
    return values


def run_one(study: Study, number: int, folder: Path) -> tuple[StudyOutcome, list[str], Path]:
    """Make one run again; its outcome, the changes of level and all contacts, and the picture."""
    study.values()
    if folder.exists() and not folder.is_dir():
        raise UsageError(f'{folder}: found a file, wanted a folder or a new one (--output)')
    driven = drive(study.run(number))
    with disk_errors(folder):
        folder.mkdir(parents=True, exist_ok=True)
        picture = _draw_one(folder, study, driven)
    made = outcome(driven)
    met = () if made.crowd is None else made.crowd.contacts
    return made, [*_changes(driven), *(each.sentence for each in met)], picture


def make_runs(
    order: Order, numbers: Sequence[int], advance: Callable[[int], None]
) -> Iterator[StudyOutcome]:
    """Make runs here, each of which is in the folder's results log before it is yielded."""
    make = partial(_make_and_log, order.study, order.folder)
    with disk_errors(order.folder):
        if order.workers == 1:
            for number in numbers:
                yield from make([number])
                advance(1)
            return
        pool, is_finished = new_pool(order.workers), False
        try:
            chunks = [pool.submit(make, each) for each in _chunks(numbers)]
            for done in as_completed(chunks):
                yield from done.result()
                advance(len(done.result()))
            is_finished = True
        except BrokenProcessPool as error:
            text = f'a worker has died; what it had finished {_CONTINUES}'
            raise StudyError(f'{order.folder}: {text}') from error
        finally:
            # What they have finished is in the log; the runs that they make may take minutes.
            for worker in () if is_finished else multiprocessing.active_children():
                worker.terminate()
            pool.shutdown(cancel_futures=True)


def _make_on_cluster(
    order: Order, numbers: Sequence[int], advance: Callable[[int], None]
) -> Iterator[StudyOutcome]:
    """As `make_runs`, on a cluster; unfinished runs of a worker that leaves are repeated."""
    try:
        import distributed  # noqa: PLC0415 (optional)
    except ImportError as error:
        text = f'--scheduler: found no {error.name}, wanted it: pip install distributed'
        raise StudyError(text) from error
    client = _connected(distributed, order.scheduler)
    gone = (distributed.client.FutureCancelledError, distributed.KilledWorker, OSError)
    code, futures = digest(), []
    try:
        futures = [
            client.submit(_make_remotely, order.study, list(each), code, pure=False)
            for each in _chunks(numbers)
        ]
        for done in distributed.as_completed(futures, loop=client.loop):
            try:
                outcomes = done.result()
            except gone as error:
                text = f'lost ({type(error).__name__}); what had been returned {_CONTINUES}'
                raise StudyError(f'{order.scheduler}: {text}') from error
            except ImportError as error:
                text = f'a worker lacks something: {error}'
                raise StudyError(f'{order.scheduler}: {text}') from error
            for each in outcomes:
                with disk_errors(order.folder):
                    append(order.folder, each)
                yield each
            advance(len(outcomes))
    finally:
        client.cancel(futures)
        client.close()


def _connected(distributed: ModuleType, scheduler: str) -> Any:
    try:
        client = distributed.Client(scheduler, timeout=_ANSWER_TIMEOUT, set_as_default=False)
    except (OSError, ValueError) as error:
        wanted = 'the address of a Dask scheduler, as in tcp://127.0.0.1:8786'
        text = f'--scheduler: found no answer at {scheduler!r}, wanted {wanted}'
        raise StudyError(text) from error
    try:
        client.wait_for_workers(1, timeout=_ANSWER_TIMEOUT)
    except TimeoutError as error:
        client.close()
        raise StudyError(f'--scheduler: found no worker at {scheduler}, wanted one') from error
    return client


def _chunks(numbers: Sequence[int]) -> list[Sequence[int]]:
    return [numbers[first : first + CHUNK] for first in range(0, len(numbers), CHUNK)]


def _make_and_log(study: Study, folder: Path, numbers: Sequence[int]) -> list[StudyOutcome]:
    outcomes = []
    for number in numbers:
        outcomes.append(_made(study, number))
        append(folder, outcomes[-1])
    return outcomes


def _made(study: Study, number: int) -> StudyOutcome:
    """One run; among people beside the same with people known exactly, and without any."""
    # The last one has left cycles, and in them grids: a gigabyte after a hundred.
    gc.collect()
    task = study.run(number)
    made = outcome(drive(task))
    if task.crowd is None or made.crowd is None or study.told or study.seen:
        return made
    told = replace(task, crowd=replace(task.crowd, told=True))
    empty = replace(told, scenario=replace(task.scenario, people=None))
    times = [
        each.time if each.verdict(study.tolerance) is RunVerdict.ARRIVED else None
        for each in (outcome(drive(told)), outcome(drive(empty)))
    ]
    return replace(made, crowd=replace(made.crowd, told_time=times[0], empty_time=times[1]))


def _make_remotely(study: Study, numbers: Sequence[int], code: str) -> list[StudyOutcome]:
    found = digest()
    if found != code:
        raise StudyError(f'a worker has other code: found {found}, wanted {code}')
    with _ONE_AT_A_TIME:
        return [_made(study, number) for number in numbers]


def _solved(
    order: Order,
    progress: Progress,
    part: str,
    numbers: list[int],
    name: str,
    solve: Callable[[RunTask], dict[str, Any]],
) -> dict[int, dict[str, Any]]:
    path = order.folder / name
    found = judging.read_answers(path)
    if not numbers:
        return found
    advance = progress(part, len(numbers))
    for number in numbers:
        if number not in found:
            found[number] = solve(order.study.run(number))
            judging.write_answers(path, found)
        advance(1)
    return found


def _draw(
    order: Order, outcomes: list[StudyOutcome], failed: list[int], progress: Progress
) -> None:
    study, folder = order.study, order.folder
    advance = progress('pictures', 1 + len(failed))
    title = f'{study.name}: {len(outcomes)} runs of seed {study.seed}'
    settings = None if study.kind.has_own_roads else study.setup()[0]
    pictures.draw_study(folder, title, settings, outcomes, study.tolerance)
    advance(1)
    beside = folder / 'failures'
    # Those of fewer runs than this time may be among them.
    for old in beside.glob('run_*.png'):
        with contextlib.suppress(FileNotFoundError):
            old.unlink()
    for number in failed:
        beside.mkdir(exist_ok=True)
        _draw_one(beside, study, drive(study.run(number)))
        advance(1)


def _draw_one(folder: Path, study: Study, driven: DrivenRun) -> Path:
    number = driven.task.scenario.number
    made = outcome(driven)
    title = f'{study.command(number)}\n{made.verdict(study.tolerance).value}, '
    title += f'miss {round(made.miss, 6):.3g} m, clearance {made.clearance:+.3f} m'
    if made.crowd is not None:
        title = '\n'.join([title, *(each.sentence for each in made.crowd.active)])
    return pictures.draw_run(folder / f'run_{number:05d}.png', title, driven)


def _changes(driven: DrivenRun) -> list[str]:
    texts, before = [], None
    for each in driven.decisions:
        if each.level != before:
            time = each.stamp / NANOSECONDS
            texts.append(f'{time:6.2f} s  {each.level.name.lower():8} {each.reason}')
        before = each.level
    return [*texts, driven.exception] if driven.exception else texts
