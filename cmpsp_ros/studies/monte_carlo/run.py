"""A study from its first run to its pictures."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, Final

from cmpsp_ros.guidance import NANOSECONDS
from cmpsp_ros.studies.common import StudyError
from cmpsp_ros.studies.monte_carlo import pictures
from cmpsp_ros.studies.monte_carlo.driving import Driven, drive, outcome
from cmpsp_ros.studies.monte_carlo.judging import costs
from cmpsp_ros.studies.monte_carlo.judging import judge as judges
from cmpsp_ros.studies.monte_carlo.outcome import Outcome
from cmpsp_ros.studies.monte_carlo.results_log import open_results_log
from cmpsp_ros.studies.monte_carlo.study import Study, Task
from cmpsp_ros.studies.monte_carlo.summary import figures, to_json, write_parquet
from cmpsp_ros.studies.monte_carlo.workers import make, make_on

PICTURES: Final = 12
"""Failures of which a picture is drawn."""


@dataclass(frozen=True)
class Order:
    """A request for a study.

    Attributes:
        study: What the runs depend on.
        runs: Number of runs, numbered from 0 on.
        folder: Where everything is written to.
        workers: Processes that share the runs.
        scheduler: Address of a Dask scheduler that distributes them instead, if any.
        judge: Whether IPOPT is run on failed runs.
        costs: Of how many runs that arrived the cost is compared with IPOPT's.
    """

    study: Study
    runs: int
    folder: Path
    workers: int = 1
    scheduler: str = ''
    judge: bool = False
    costs: int = 0


Progress = Callable[[str, int], Callable[[int], None]]
"""Called with a part of the work and its pieces; returns what to call with pieces done."""


def run(order: Order, progress: Progress) -> dict[str, Any]:
    """Make the missing runs, and summarise all of them.

    Returns:
        The figures, which `summary.json` has as well. Beside it lie `runs.jsonl`, `runs.parquet`
        where pyarrow is installed, and the pictures.

    Raises:
        StudyError: The folder holds something else, or cannot be used; a worker died; the cluster
            cannot be used; or CasADi is not installed and wanted.
        ParameterError: A parameter is wrong.
    """
    study, folder = order.study, order.folder
    there = open_results_log(folder, study)
    missing = [number for number in range(order.runs) if number not in there]
    advance = progress('runs', order.runs)
    advance(order.runs - len(missing))
    for made in _made(order, missing, advance):
        there[made.number] = made
    outcomes = [there[number] for number in range(order.runs)]
    failed = [each.number for each in outcomes if each.failed(study.tolerance)]
    arrived = [each.number for each in outcomes if each.miss <= study.tolerance]
    solved = partial(_solved, order, progress)
    judged = solved('judge', failed if order.judge else [], judges.NAME, judges.judged)
    compared = solved('costs', arrived[: order.costs], costs.NAME, costs.compared)
    values = figures(study, outcomes, judged, compared)
    try:
        (folder / 'summary.json').write_text(to_json(values), encoding='utf-8')
        write_parquet(folder / 'runs.parquet', outcomes, study.tolerance, judged)
        _draw(order, outcomes, failed[:PICTURES], progress)
    except OSError as error:
        raise StudyError(f'{folder}: {error.strerror or error}') from error
    return values


def run_one(study: Study, number: int, folder: Path) -> tuple[Outcome, list[str], Path]:
    """Make one run again and draw it.

    Args:
        study: What it depends on.
        number: Which run.
        folder: Where the picture goes; other files there stay.

    Returns:
        Its outcome, the decision at each change of fallback level, and the picture.

    Raises:
        StudyError: The picture cannot be written.
        ParameterError: A parameter is wrong.
    """
    study.values()
    driven = drive(study.run(number))
    try:
        folder.mkdir(parents=True, exist_ok=True)
        picture = _draw_one(folder, study, driven)
    except OSError as error:
        raise StudyError(f'{folder}: {error.strerror or error}') from error
    return outcome(driven), _changes(driven), picture


def _solved(
    order: Order,
    progress: Progress,
    part: str,
    numbers: list[int],
    name: str,
    solve: Callable[[Task], dict[str, Any]],
) -> dict[int, dict[str, Any]]:
    """What IPOPT finds of some runs, and has found of others before."""
    found = judges.kept(order.folder, name)
    if not numbers:
        return found
    advance = progress(part, len(numbers))
    for number in numbers:
        if number not in found:
            found[number] = solve(order.study.run(number))
            judges.keep(order.folder, found, name)
        advance(1)
    return found


def _made(order: Order, numbers: list[int], advance: Callable[[int], None]) -> Iterator[Outcome]:
    if order.scheduler:
        return make_on(order.scheduler, order.study, numbers, order.folder, advance)
    return make(order.study, numbers, order.folder, order.workers, advance)


def _draw(order: Order, outcomes: list[Outcome], failed: list[int], progress: Progress) -> None:
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


def _draw_one(folder: Path, study: Study, driven: Driven) -> Path:
    number = driven.task.scenario.number
    made = outcome(driven)
    title = f'{study.command(number)}\n{made.verdict(study.tolerance).value}, '
    title += f'miss {made.miss:.3g} m, clearance {made.clearance:+.3f} m'
    return pictures.draw_run(folder / f'run_{number:05d}.png', title, driven)


def _changes(driven: Driven) -> list[str]:
    texts, before = [], None
    for each in driven.decisions:
        if each.level != before:
            time = each.stamp / NANOSECONDS
            texts.append(f'{time:6.2f} s  {each.level.name.lower():8} {each.reason}')
        before = each.level
    return [*texts, driven.exception] if driven.exception else texts
