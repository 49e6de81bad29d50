"""The `cmpsp` command: arguments in, exit code out."""

from __future__ import annotations

import math
import signal
from pathlib import Path
from types import FrameType
from typing import Annotated, NoReturn

import typer
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn
from rich.table import Table

from cmpsp_ros.bags.errors import BagError
from cmpsp_ros.demo.errors import DemoError
from cmpsp_ros.demo.folder import make_folder
from cmpsp_ros.demo.scenario import Scenario, load_scenario
from cmpsp_ros.demo.summary import Summary
from cmpsp_ros.parameters.errors import ParameterError
from cmpsp_ros.parameters.presets import preset_names

app = typer.Typer(
    help='Guidance of a differential-drive robot by C-MPSP.',
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
)
_console = Console()
_errors = Console(stderr=True)


@app.command()
def demo(
    preset: Annotated[str, typer.Argument(help='Preset, or path of a parameter file.')] = 'case3',
    lockstep: Annotated[
        bool, typer.Option('--lockstep', help='As fast as the solver, and exactly repeatable.')
    ] = False,
    output: Annotated[
        Path | None, typer.Option(help='Folder of the run [default: runs/<time>].')
    ] = None,
    assignments: Annotated[
        list[str] | None,
        typer.Option('--set', metavar='KEY=VALUE', help='Change a parameter; may be repeated.'),
    ] = None,
    force: Annotated[
        bool, typer.Option('--force', help='Replace an earlier run in the output folder.')
    ] = False,
) -> None:
    """Drive one run with real nodes, record it, and draw it.

    Exit code 0 only if the goal was reached within its tolerance and the path driven is clear.
    """
    try:
        scenario = load_scenario(preset, assignments or [], lockstep=lockstep)
        folder = make_folder(output, force=force)
        summary = _run(scenario, folder)
    except (ParameterError, DemoError, BagError) as error:
        _errors.print(str(error), style='red', markup=False, highlight=False, soft_wrap=True)
        raise typer.Exit(1) from None
    except KeyboardInterrupt:
        _errors.print('interrupted; all nodes were stopped', style='red')
        raise typer.Exit(130) from None
    _console.print(_table(summary, scenario))
    _console.print(f'{folder}: bag, summary.json, trajectory.png, wheel_speeds.png')
    if summary.failure:
        _errors.print(summary.failure, style='red', markup=False, highlight=False, soft_wrap=True)
        raise typer.Exit(1)


@app.command()
def bench(
    runs: Annotated[int, typer.Option(min=1, help='Closed-loop runs of each preset.')] = 20,
) -> None:
    """Time the control steps of all presets in this process, without ROS."""
    from cmpsp_ros.studies.bench import measure  # noqa: PLC0415 (compiles kernels)

    presets = preset_names()
    with Progress(console=_errors) as bar:
        task = bar.add_task('closed loops', total=runs * len(presets))
        timings = measure(presets, runs, lambda: bar.advance(task))
    table = Table('preset', 'first step', 'median', 'p99', 'max', title='control step [ms]')
    for each in timings:
        times = (each.first, each.median, each.p99, each.largest)
        table.add_row(each.preset, *(f'{time:.2f}' for time in times))
    _console.print(table)


@app.command()
def paper(
    output: Annotated[Path, typer.Option(help='New or empty folder.')] = Path('paper'),
    only: Annotated[
        list[str] | None,
        typer.Option(metavar='NAME', help='One figure or table, such as fig5; may be repeated.'),
    ] = None,
    judge: Annotated[
        bool, typer.Option('--judge', help='Let CasADi and IPOPT find the optima as well.')
    ] = False,
) -> None:
    """Draw every figure and check every claim of the paper; no ROS is needed."""
    from cmpsp_ros.studies.paper import ARTEFACTS, PaperError, run  # noqa: PLC0415 (plots, kernels)

    try:
        with Progress(console=_errors) as bar:
            task = bar.add_task('paper', total=len(only or ARTEFACTS))

            def progress(what: str) -> None:
                bar.update(task, advance=what in ARTEFACTS, description=what)

            report = run(output, only or (), progress, judge=judge)
    except (PaperError, ParameterError) as error:
        _errors.print(str(error), style='red', markup=False, highlight=False, soft_wrap=True)
        raise typer.Exit(1) from None
    _console.print(f'{report}: every claim, and ours beside it')


def _run(scenario: Scenario, folder: Path) -> Summary:
    from cmpsp_ros.demo.run import run  # noqa: PLC0415 (a wrong argument needs no ROS)

    signal.signal(signal.SIGTERM, _interrupt)
    columns = TextColumn('{task.description}'), BarColumn(), TextColumn('{task.fields[time]}')
    with Progress(*columns, TimeElapsedColumn(), console=_errors) as bar:
        total = scenario.settings.final_time
        task = bar.add_task(scenario.name, total=total, time='starting nodes')

        def progress(seconds: float) -> None:
            bar.update(task, completed=seconds, time=f'{seconds:.1f} of {total:.1f} s')

        return run(scenario, folder, progress)


def _interrupt(_number: int, _frame: FrameType | None) -> NoReturn:
    raise KeyboardInterrupt


def _table(summary: Summary, scenario: Scenario) -> Table:
    limit = scenario.settings.robot.max_wheel_speed
    limited = f'limit {limit:g} rad/s' if math.isfinite(limit) else 'no limit'
    times = summary.step_times
    table = Table('figure', 'value', title=f'{summary.preset}: {summary.control_steps} steps')
    for name, value in (
        ('miss at the final time', f'{summary.miss:.3g} m'),
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


def main() -> None:
    """Entry point of the command."""
    app()


if __name__ == '__main__':
    main()
