"""`cmpsp demo`: one run with real nodes."""

from __future__ import annotations

import math
import signal
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Optional

import typer

from cmpsp_ros.bags import BagError
from cmpsp_ros.cli.terminal import (
    Assignments,
    complain,
    console,
    errors,
    exit_on,
    remark,
    say,
    writing_to,
)
from cmpsp_ros.demo import DemoError, make_folder
from cmpsp_ros.parameters import ParameterError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from rich.table import Table

    from cmpsp_ros.demo import Scenario, Summary


def demo(
    preset: Annotated[str, typer.Argument(help='Preset, or path of a parameter file.')] = 'case3',
    robot: Annotated[
        Optional[str],
        typer.Option(metavar='NAME', help='Robot of config/robots, or path of its file.'),
    ] = None,
    lockstep: Annotated[
        bool, typer.Option('--lockstep', help='As fast as the solver, and exactly repeatable.')
    ] = False,
    output: Annotated[
        Optional[Path], typer.Option(help='Folder of the run; runs/<time> when absent.')
    ] = None,
    assignments: Assignments = None,
    view: Annotated[
        bool, typer.Option('--view', help='Show the run live on a page for a browser.')
    ] = False,
    port: Annotated[int, typer.Option(min=1, max=65535, help='Port of that page.')] = 8765,
    force: Annotated[
        bool, typer.Option('--force', help='Replace an earlier run in the output folder.')
    ] = False,
) -> None:
    """Drive one run with real nodes, record it, and draw it.

    A file with sections for several robots drives them all together. Exit code 0 only if every
    robot reached its goal within the tolerance, and the driven path is clear; 1 if not, or if the
    run did not end; 2 if it cannot be started; 3 if the recording is too incomplete to judge it.
    """
    try:
        with exit_on(ParameterError, DemoError, code=2):
            fleet = _loaded(preset, assignments or [], robot, lockstep=lockstep)
            folder = make_folder(output, force=force)
        with writing_to(folder), exit_on(DemoError, code=1), exit_on(BagError, code=3):
            results = _drive(fleet, folder, port if view else None)
    except KeyboardInterrupt:
        complain('interrupted; all nodes were stopped')
        raise typer.Exit(130) from None
    for scenario, each in zip(fleet, results, strict=True):
        if each.failure:
            whose = f'{scenario.namespace}: ' if scenario.namespace else ''
            complain(f'{whose}{each.failure}')
    if any(each.failure for each in results):
        raise typer.Exit(1 if any(each.has_failed for each in results) else 3)


def _loaded(
    preset: str, assignments: list[str], robot: str | None, *, lockstep: bool
) -> tuple[Scenario, ...]:
    from cmpsp_ros.demo import load_fleet, load_scenario  # noqa: PLC0415 (loads kernels)
    from cmpsp_ros.parameters.files import robots_in  # noqa: PLC0415 (starts faster without)

    namespaces = robots_in(preset)
    if len(namespaces) > 1:
        fleet = load_fleet(preset, namespaces, assignments, lockstep=lockstep, robot=robot)
    else:
        fleet = (load_scenario(preset, assignments, lockstep=lockstep, robot=robot),)
    for each in fleet:
        whose = f'{each.namespace}: ' if each.namespace else ''
        for text in each.remarks:
            remark(f'{whose}{text}')
    return fleet


def _drive(fleet: Sequence[Scenario], folder: Path, view_port: int | None) -> Sequence[Summary]:
    from cmpsp_ros.demo import run  # noqa: PLC0415 (a wrong argument needs no ROS)

    total, alone = max(each.settings.final_time for each in fleet), fleet[0]
    with _progress(alone.name, total, view_port) as progress:
        results = run(fleet, folder, progress, view_port)
    several = len(fleet) > 1
    console().print(_fleet_table(fleet, results) if several else _table(results[0], alone))
    more = '' if several else ', wheel_speeds.png'
    say(f'{folder}: bag, summary.json, trajectory.png{more}')
    return results


@contextmanager
def _progress(name: str, total: float, view_port: int | None) -> Iterator[Callable[[float], None]]:
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn  # noqa: PLC0415 (`--help` is quicker without)

    signal.signal(signal.SIGTERM, signal.default_int_handler)
    if view_port is not None:
        remark(f'http://127.0.0.1:{view_port}/ shows the run')
    columns = TextColumn('{task.description}'), BarColumn(), TextColumn('{task.fields[time]}')
    with Progress(*columns, TimeElapsedColumn(), console=errors()) as bar:
        task = bar.add_task(name, total=total, time='starting nodes')

        def progress(seconds: float) -> None:
            bar.update(task, completed=seconds, time=f'{seconds:.1f} of {total:.1f} s')

        yield progress


def _table(summary: Summary, scenario: Scenario) -> Table:
    from rich.table import Table  # noqa: PLC0415 (`--help` is quicker without)

    limit = scenario.settings.robot.max_wheel_speed
    limited = f'limit {limit:g} rad/s' if math.isfinite(limit) else 'no limit'
    times = summary.step_times
    table = Table('figure', 'value', title=f'{summary.preset}: {summary.control_steps} steps')
    for passing in summary.passings:
        table.add_row(f'at {passing.goal.time:g} s', str(passing))
    if summary.speed is not None:
        table.add_row('mean speed along the road', f'{summary.speed:.4f} m/s')
    elif summary.miss is not None and not summary.passings:
        table.add_row('miss at the final time', f'{round(summary.miss, 6):.3g} m')
    for name, value in (
        ('least clearance, between samples too', f'{summary.clearance:+.4f} m'),
        ('largest wheel speed', f'{summary.max_wheel_speed:.2f} rad/s ({limited})'),
        (
            'step time p50 / p99 / max',
            ' / '.join('-' if each is None else f'{each:.2f}' for each in times.values()) + ' ms',
        ),
        ('deadlines missed', str(summary.deadline_misses)),
        (
            'fallback levels',
            ', '.join(f'{count} {name}' for name, count in summary.levels.items() if count),
        ),
    ):
        table.add_row(name, value)
    return table


def _fleet_table(fleet: Sequence[Scenario], results: Sequence[Summary]) -> Table:
    from rich.table import Table  # noqa: PLC0415 (`--help` is quicker without)

    from cmpsp_ros.world.roads import FAR  # noqa: PLC0415 (loads kernels)

    headings = ('robot', 'miss', 'clearance', 'from others', 'late', 'step p50 / max', 'levels')
    table = Table(*headings, title=f'{fleet[0].name}: {len(fleet)} robots')
    for each, summary in zip(fleet, results, strict=True):
        times = summary.step_times['p50'], summary.step_times['max']
        table.add_row(
            each.namespace,
            '-' if summary.miss is None else f'{summary.miss:.2g} m',
            '-' if summary.clearance >= FAR else f'{summary.clearance:+.3f} m',
            f'{summary.apart:+.3f} m',
            str(summary.deadline_misses),
            ' / '.join('-' if time is None else f'{time:.1f}' for time in times) + ' ms',
            ', '.join(f'{count} {name}' for name, count in summary.levels.items() if count),
        )
    return table
