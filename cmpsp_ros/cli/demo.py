"""`cmpsp demo`: one run with real nodes."""

from __future__ import annotations

import math
import signal
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING, Annotated, NoReturn

import typer
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn
from rich.table import Table

from cmpsp_ros.bags.errors import BagError
from cmpsp_ros.cli.console import complain, console, errors, exit_on, say
from cmpsp_ros.demo.errors import DemoError
from cmpsp_ros.demo.folder import make_folder
from cmpsp_ros.parameters.errors import ParameterError

if TYPE_CHECKING:
    from cmpsp_ros.demo.scenario import Scenario
    from cmpsp_ros.demo.summary import Summary


def demo(
    preset: Annotated[str, typer.Argument(help='Preset, or path of a parameter file.')] = 'case3',
    robot: Annotated[
        str | None,
        typer.Option(metavar='NAME', help='Robot of config/robots, or path of its file.'),
    ] = None,
    lockstep: Annotated[
        bool, typer.Option('--lockstep', help='As fast as the solver, and exactly repeatable.')
    ] = False,
    output: Annotated[
        Path | None, typer.Option(help='Folder of the run; runs/<time> when absent.')
    ] = None,
    assignments: Annotated[
        list[str] | None,
        typer.Option('--set', metavar='KEY=VALUE', help='Change a parameter; may be repeated.'),
    ] = None,
    view: Annotated[
        bool, typer.Option('--view', help='Show the run on a page for a browser, while it lasts.')
    ] = False,
    port: Annotated[int, typer.Option(min=1, max=65535, help='Of that page.')] = 8765,
    force: Annotated[
        bool, typer.Option('--force', help='Replace an earlier run in the output folder.')
    ] = False,
) -> None:
    """Drive one run with real nodes, record it, and draw it.

    Exit code 0 only if the goal was reached within its tolerance and the path driven is clear.
    """
    from cmpsp_ros.demo.scenario import load_scenario  # noqa: PLC0415 (loads kernels)

    try:
        with exit_on(ParameterError, DemoError, BagError, code=1):
            scenario = load_scenario(preset, assignments or [], lockstep=lockstep, robot=robot)
            for remark in scenario.remarks:
                errors.print(remark, markup=False, highlight=False, soft_wrap=True)
            folder = make_folder(output, force=force)
            summary = _run(scenario, folder, port if view else None)
    except KeyboardInterrupt:
        errors.print('interrupted; all nodes were stopped', style='red')
        raise typer.Exit(130) from None
    console.print(_table(summary, scenario))
    say(f'{folder}: bag, summary.json, trajectory.png, wheel_speeds.png')
    if summary.failure:
        complain(summary.failure)
        raise typer.Exit(1)


def _run(scenario: Scenario, folder: Path, view_port: int | None) -> Summary:
    from cmpsp_ros.demo.run import run  # noqa: PLC0415 (a wrong argument needs no ROS)

    signal.signal(signal.SIGTERM, _interrupt)
    if view_port is not None:
        errors.print(f'http://127.0.0.1:{view_port}/ shows the run', soft_wrap=True)
    columns = TextColumn('{task.description}'), BarColumn(), TextColumn('{task.fields[time]}')
    with Progress(*columns, TimeElapsedColumn(), console=errors) as bar:
        total = scenario.settings.final_time
        task = bar.add_task(scenario.name, total=total, time='starting nodes')

        def progress(seconds: float) -> None:
            bar.update(task, completed=seconds, time=f'{seconds:.1f} of {total:.1f} s')

        return run(scenario, folder, progress, view_port)


def _interrupt(_number: int, _frame: FrameType | None) -> NoReturn:
    raise KeyboardInterrupt


def _table(summary: Summary, scenario: Scenario) -> Table:
    limit = scenario.settings.robot.max_wheel_speed
    limited = f'limit {limit:g} rad/s' if math.isfinite(limit) else 'no limit'
    times = summary.step_times
    table = Table('figure', 'value', title=f'{summary.preset}: {summary.control_steps} steps')
    for passing in summary.passings:
        table.add_row(f'at {passing.goal.time:g} s', str(passing))
    if summary.speed is not None:
        table.add_row('mean speed along the road', f'{summary.speed:.4f} m/s')
    elif not summary.passings:
        table.add_row('miss at the final time', f'{summary.miss:.3g} m')
    for name, value in (
        ('least clearance, between samples too', f'{summary.clearance:+.4f} m'),
        ('largest wheel speed', f'{summary.max_wheel_speed:.2f} rad/s ({limited})'),
        (
            'step time p50 / p99 / max',
            ' / '.join('-' if each is None else f'{each:.2f}' for each in times.values()) + ' ms',
        ),
        ('deadlines missed', str(summary.deadline_misses)),
        ('rungs', ', '.join(f'{count} {name}' for name, count in summary.rungs.items() if count)),
    ):
        table.add_row(name, value)
    return table
