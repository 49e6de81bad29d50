"""`cmpsp bench`, `paper`, `study` and `warmup`: commands without a bag."""

import os
import sys
from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from typing import Annotated, Optional

import typer

from cmpsp_ros.cli.terminal import (
    Assignments,
    complain,
    console,
    exit_on,
    progress_bar,
    say,
    writing_to,
)
from cmpsp_ros.parameters import ParameterError


def bench(context: typer.Context) -> None:
    """Time control steps, alone and beside other solvers; needs a clone of the repository.

    Exit code 2 without a clone, or without the packages of `make setup`.
    """
    root = Path(__file__).parents[2]
    if not (root / 'benchmarks' / '__main__.py').is_file():
        complain('bench: found no benchmarks, which are not installed: run it from a clone')
        raise typer.Exit(2)
    sys.path.insert(0, str(root))
    # For the processes that they start.
    os.environ['PYTHONPATH'] = os.pathsep.join(filter(None, [str(root), os.getenv('PYTHONPATH')]))
    try:
        from benchmarks.__main__ import app  # noqa: PLC0415 (compiles kernels)

        app(context.args, prog_name='cmpsp bench')
    except ModuleNotFoundError as error:
        complain(f'bench: found no module {error.name}: `make setup` installs what benchmarks need')
        raise typer.Exit(2) from None


def paper(
    output: Annotated[Path, typer.Option(help='New or empty folder.')] = Path('paper'),
    only: Annotated[
        Optional[list[str]],
        typer.Option(metavar='NAME', help='One figure or table, such as fig5; may be repeated.'),
    ] = None,
    judge: Annotated[
        bool, typer.Option('--judge', help='Also find the optima with IPOPT (CasADi).')
    ] = False,
    starts: Annotated[
        bool, typer.Option('--starts', help='Instead, drive its starts with the default settings.')
    ] = False,
) -> None:
    """Draw every figure and check every claim of the paper.

    No ROS is needed.
    """
    if starts:
        _starts(judge=judge)
        return
    from cmpsp_ros.studies.paper import ARTEFACTS, StudyError, run  # noqa: PLC0415 (plots, kernels)

    failures = exit_on(StudyError, ParameterError, code=1)
    with writing_to(output), failures, progress_bar() as bar:
        task = bar.add_task('paper', total=len(only or ARTEFACTS))

        def progress(what: str) -> None:
            bar.update(task, advance=what in ARTEFACTS, description=what)

        report = run(output, only or (), progress, judge=judge)
    say(f'{report}: every claim, and ours beside it')


def study(
    name: Annotated[
        str,
        typer.Argument(
            metavar='NAME',
            help='nominal, disturbed, realtime, heavy, told_wrong, corridors, floor, sight, '
            'mapped, mazes, clutter or people.',
        ),
    ],
    runs: Annotated[int, typer.Option(min=1, help='Number of runs, from run 0 on.')] = 200,
    seed: Annotated[int, typer.Option(min=0, help='Seed of all starts, obstacles and noise.')] = 1,
    workers: Annotated[int, typer.Option(min=1, help='Processes that share the runs.')] = 1,
    scheduler: Annotated[
        str,
        typer.Option(metavar='ADDRESS', help='Dask scheduler whose workers share them instead.'),
    ] = '',
    output: Annotated[
        Optional[Path], typer.Option(help='New folder, or one to continue; study_NAME when absent.')
    ] = None,
    judge: Annotated[
        bool, typer.Option('--judge', help='Solve each failed run with IPOPT (CasADi).')
    ] = False,
    costs: Annotated[
        int,
        typer.Option(min=0, help="Of so many runs that arrived, compare the cost with IPOPT's."),
    ] = 0,
    only: Annotated[
        Optional[int],
        typer.Option('--run', min=0, metavar='NUMBER', help='Instead, repeat and draw one run.'),
    ] = None,
    obstacles: Annotated[int, typer.Option(min=0, max=6, help='Maximum number in one run.')] = 4,
    robot: Annotated[
        str, typer.Option(metavar='NAME', help='Robot, or its file, of study nominal or people.')
    ] = '',
    scene: Annotated[
        str,
        typer.Option(
            metavar='NAME', help='Of study people: hall, room, corridor, crossing or door.'
        ),
    ] = '',
    told: Annotated[
        bool, typer.Option('--told', help='In study people: they are known exactly, not seen.')
    ] = False,
    seen: Annotated[
        bool, typer.Option('--seen', help='In study people: skip the comparison runs.')
    ] = False,
    assignments: Assignments = None,
) -> None:
    """Drive many random courses and count the outcomes.

    No ROS is needed. After an interruption the same command continues.
    """
    from cmpsp_ros.studies import monte_carlo  # noqa: PLC0415 (plots, kernels)

    chosen = monte_carlo.Study(
        name, seed, obstacles, tuple(assignments or ()), robot, scene, told, seen
    )
    folder = output or Path(f'study_{name}')
    wrong, failed = (monte_carlo.UsageError, ParameterError), monte_carlo.StudyError
    with writing_to(folder), exit_on(failed, code=1), exit_on(*wrong, code=2):
        if only is not None:
            outcome, changes, picture = monte_carlo.run_one(chosen, only, folder)
            say('\n'.join(changes))
            verdict = outcome.verdict(chosen.tolerance)
            miss = f'miss {round(outcome.miss, 6):.3g} m'
            say(f'{verdict}: {miss}, clearance {outcome.clearance:+.3f} m')
            say(f'{picture}: drawn')
            return
        try:
            with progress_bar() as bar:

                def progress(part: str, pieces: int) -> Callable[[int], None]:
                    task = bar.add_task(part, total=pieces)
                    return lambda count: bar.advance(task, count)

                order = monte_carlo.Order(chosen, runs, folder, workers, scheduler, judge, costs)
                values = monte_carlo.run_study(order, progress)
        except KeyboardInterrupt:
            complain(f'{folder}: interrupted; the same command continues')
            raise typer.Exit(130) from None
    for table in monte_carlo.tables(values):
        console().print(table)
    say(f'{folder}: summary, every run and pictures')


def warmup(
    presets: Annotated[
        Optional[list[str]],
        typer.Argument(metavar='PRESET', help='Presets, or parameter files; none: everything.'),
    ] = None,
    export: Annotated[
        Optional[Path], typer.Option(help='Write all kernels to this file, for equal computers.')
    ] = None,
    import_: Annotated[
        Optional[Path], typer.Option('--import', help='Take kernels from this file instead.')
    ] = None,
) -> None:
    """Compile the kernels of nodes and commands, so that they start at once.

    Exit code 1 if there is no folder for the cache, or a file of kernels cannot be used.
    """
    from cmpsp_ros.mpsp.jit import TransferError, export_kernels, import_kernels  # noqa: PLC0415 (loads numba)

    if import_ is not None:
        with exit_on(TransferError, code=1):
            say(f'{import_}: {import_kernels(import_)} kernels taken')
        return
    from cmpsp_ros.guidance import SolverSettings  # noqa: PLC0415 (loads numba)
    from cmpsp_ros.mpsp.jit import ProgressLine  # noqa: PLC0415 (loads numba)
    from cmpsp_ros.warmup import warm_up_all, work_rate  # noqa: PLC0415 (loads all kernels)

    with exit_on(ParameterError, code=1), closing(ProgressLine()) as line:
        outcome = warm_up_all(line.show, presets or ())
    for part in outcome.parts:
        done = f'{part.kernels} kernels compiled' if part.kernels else 'all there'
        say(f'{part.name}: {done}, {part.seconds:.1f} s')
    if not presets and outcome.folder is not None:
        default = SolverSettings().work_rate
        say(f'solver.work_rate: {work_rate():.2g} (default {default:.2g})')
    if outcome.removed:
        say(f'removed: {len(outcome.removed)} files not used for 30 days')
    if outcome.folder is not None:
        say(f'kept in: {outcome.folder}')
    if outcome.hindrance:
        complain(outcome.hindrance)
    if outcome.folder is None:
        raise typer.Exit(1)
    if export is not None:
        with exit_on(TransferError, code=1):
            say(f'{export}: {export_kernels(export)} kernels written')


def _starts(*, judge: bool) -> None:
    from cmpsp_ros.studies.paper import StudyError, run_starts  # noqa: PLC0415 (plots, kernels)

    with exit_on(StudyError, code=1), progress_bar() as bar:
        task = bar.add_task('starts')

        def progress(label: str, count: int) -> None:
            bar.update(task, advance=1, total=count, description=label)

        table = run_starts(progress, compare=judge)
    console().print(table)
