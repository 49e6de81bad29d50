"""`cmpsp bench`, `paper`, `study` and `warmup`: what needs no bag."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from typing import Annotated

import typer

from cmpsp_ros.cli.console import complain, console, errors, exit_on, progress_bar, say
from cmpsp_ros.mpsp.errors import ProblemError
from cmpsp_ros.parameters.errors import ParameterError


def bench(
    presets: Annotated[
        list[str] | None,
        typer.Argument(
            metavar='PRESET', help="Presets, or parameter files; none: all, and the paper's runs."
        ),
    ] = None,
    runs: Annotated[int, typer.Option(min=1, help='Runs of each preset and of each method.')] = 20,
    peers: Annotated[
        bool, typer.Option('--peers', help='Time solvers of CasADi and acados as well.')
    ] = False,
    latency: Annotated[
        bool, typer.Option('--latency', help='Time the node over DDS, in real time.')
    ] = False,
    tail: Annotated[
        int, typer.Option(min=1, metavar='COUNT', help='Steps of which the longest are shown.')
    ] = 20_000,
    output: Annotated[
        Path | None, typer.Option(help='New file ending in .json, or new or empty folder.')
    ] = None,
    verify: Annotated[
        int | None,
        typer.Option(min=1, metavar='COUNT', help='Instead, check a QP back end on as many QPs.'),
    ] = None,
    verify_case: Annotated[
        str | None, typer.Option(metavar='ID', help='Instead, check it on the one of that name.')
    ] = None,
    qp: Annotated[
        str | None, typer.Option(metavar='NAME', help="The back end checked; without: guidance's.")
    ] = None,
    workers: Annotated[int, typer.Option(min=1, help='Processes that check.')] = 1,
    obstacles: Annotated[
        bool, typer.Option('--obstacles', help='Instead, time steps past 0 to 64 obstacles.')
    ] = False,
    robots: Annotated[
        int | None,
        typer.Option(min=1, max=50, metavar='COUNT', help='Instead, so many robots at once.'),
    ] = None,
) -> None:
    """Time control steps, alone and beside other solvers."""
    if robots is not None:
        _many_robots(robots)
        return
    if obstacles:
        from cmpsp_ros.studies.bench import many_obstacles  # noqa: PLC0415 (compiles kernels)

        console().print(many_obstacles.table(many_obstacles.measure(runs)).rich())
        return
    if verify is not None or verify_case is not None:
        from cmpsp_ros.guidance.settings import SolverSettings  # noqa: PLC0415 (loads kernels)

        _verify(verify or verify_case or '', qp or SolverSettings().qp, workers, output)
        return
    from cmpsp_ros.studies.bench import (  # noqa: PLC0415 (compiles kernels)
        BenchError,
        Order,
        run,
        tables,
    )

    order = Order(presets or (), runs, tail, peers=peers, latency=latency, output=output)
    with exit_on(BenchError, ParameterError, code=1), progress_bar() as bar:

        def progress(part: str, pieces: int) -> Callable[[], None]:
            task = bar.add_task(part, total=pieces)
            return lambda: bar.advance(task)

        results = run(order, progress)
    for table in tables(results):
        console().print(table.rich())
    if output is not None:
        console().print(f'{output}: written')


def paper(
    output: Annotated[Path, typer.Option(help='New or empty folder.')] = Path('paper'),
    only: Annotated[
        list[str] | None,
        typer.Option(metavar='NAME', help='One figure or table, such as fig5; may be repeated.'),
    ] = None,
    judge: Annotated[
        bool, typer.Option('--judge', help='Let CasADi and IPOPT find the optima as well.')
    ] = False,
    starts: Annotated[
        bool,
        typer.Option('--starts', help='Instead, drive its starts with the law as it is here.'),
    ] = False,
) -> None:
    """Draw every figure and check every claim of the paper.

    No ROS is needed.
    """
    if starts:
        _starts(judge=judge)
        return
    from cmpsp_ros.studies.paper import ARTEFACTS, PaperError, run  # noqa: PLC0415 (plots, kernels)

    with exit_on(PaperError, ParameterError, code=1), progress_bar() as bar:
        task = bar.add_task('paper', total=len(only or ARTEFACTS))

        def progress(what: str) -> None:
            bar.update(task, advance=what in ARTEFACTS, description=what)

        report = run(output, only or (), progress, judge=judge)
    console().print(f'{report}: every claim, and ours beside it')


def study(
    name: Annotated[str, typer.Argument(metavar='NAME', help='nominal or disturbed.')],
    runs: Annotated[int, typer.Option(min=1, help='How many: those numbered from 0 on.')] = 200,
    seed: Annotated[int, typer.Option(min=0, help='Of all starts, obstacles and noise.')] = 1,
    workers: Annotated[int, typer.Option(min=1, help='Processes that share the runs.')] = 1,
    scheduler: Annotated[
        str,
        typer.Option(metavar='ADDRESS', help='Dask scheduler whose workers share them instead.'),
    ] = '',
    output: Annotated[
        Path | None,
        typer.Option(help='New folder, or one to go on with; without: study_NAME.'),
    ] = None,
    judge: Annotated[
        bool, typer.Option('--judge', help='Ask CasADi and IPOPT about each run that failed.')
    ] = False,
    only: Annotated[
        int | None,
        typer.Option('--run', min=0, metavar='NUMBER', help='Instead, one run again, drawn.'),
    ] = None,
    obstacles: Annotated[int, typer.Option(min=0, max=6, help='Most in one run.')] = 4,
    assignments: Annotated[
        list[str] | None,
        typer.Option('--set', metavar='KEY=VALUE', help='Change a parameter; may be repeated.'),
    ] = None,
) -> None:
    """Drive many random courses and count what happens.

    No ROS is needed. Whatever is interrupted or killed goes on with the same command.
    """
    from cmpsp_ros.studies import monte_carlo as room  # noqa: PLC0415 (plots, kernels)

    chosen = room.Study(name, seed, obstacles, tuple(assignments or ()))
    folder = output or Path(f'study_{name}')
    with exit_on(room.StudyError, ParameterError, code=1):
        if only is not None:
            outcome, changes, picture = room.run_one(chosen, only, folder)
            say('\n'.join(changes))
            verdict = outcome.verdict(chosen.tolerance)
            say(f'{verdict}: miss {outcome.miss:.3g} m, clearance {outcome.clearance:+.3f} m')
            say(f'{picture}: drawn')
            return
        try:
            with progress_bar() as bar:

                def progress(part: str, pieces: int) -> Callable[[int], None]:
                    task = bar.add_task(part, total=pieces)
                    return lambda count: bar.advance(task, count)

                order = room.Order(chosen, runs, folder, workers, scheduler, judge)
                values = room.run(order, progress)
        except KeyboardInterrupt:
            complain(f'{folder}: interrupted; the same command goes on')
            raise typer.Exit(130) from None
    for table in room.tables(values):
        console().print(table)
    say(f'{folder}: summary, every run and pictures')


def warmup(
    presets: Annotated[
        list[str] | None,
        typer.Argument(metavar='PRESET', help='Presets, or parameter files; none: everything.'),
    ] = None,
) -> None:
    """Compile what nodes and commands run, so that each starts at once.

    Exit code 1 only if there is no folder to keep it in.
    """
    from cmpsp_ros.mpsp.jit.watch import ProgressLine  # noqa: PLC0415 (loads numba)
    from cmpsp_ros.studies.warmup import warm_up_all  # noqa: PLC0415 (loads all kernels)
    from cmpsp_ros.studies.work_rate import work_rate  # noqa: PLC0415 (loads kernels)

    with exit_on(ParameterError, code=1), closing(ProgressLine()) as line:
        outcome = warm_up_all(line.show, presets or ())
    for part in outcome.parts:
        done = f'{part.kernels} kernels compiled' if part.kernels else 'all there'
        console().print(f'{part.name}: {done}, {part.seconds:.1f} s', highlight=False)
    if not presets and outcome.folder is not None:
        console().print(f'solver.work_rate: {work_rate():.2g} (default 6e+07)', highlight=False)
    if outcome.removed:
        console().print(f'removed: {len(outcome.removed)} files not used for 30 days')
    if outcome.folder is not None:
        console().print(f'kept in: {outcome.folder}', soft_wrap=True, highlight=False)
    if outcome.hindrance:
        errors().print(outcome.hindrance, style='red', markup=False, soft_wrap=True)
    if outcome.folder is None:
        raise typer.Exit(1)


def _starts(*, judge: bool) -> None:
    """Drive from every guess and heading of the paper's tables, with the defaults."""
    from cmpsp_ros.studies.paper import PaperError  # noqa: PLC0415 (plots, kernels)
    from cmpsp_ros.studies.paper import starts as room  # noqa: PLC0415 (plots, kernels)

    with exit_on(PaperError, code=1), progress_bar() as bar:
        task = bar.add_task('starts')

        def progress(label: str, count: int) -> None:
            bar.update(task, advance=1, total=count, description=label)

        table = room.run(progress, compare=judge)
    console().print(table)


def _many_robots(count: int) -> None:
    """Drive so many robots at once; exit code 1 if one was ever late."""
    from cmpsp_ros.studies.bench import BenchError, many_robots  # noqa: PLC0415 (needs ROS)

    with exit_on(BenchError, ParameterError, code=1), progress_bar() as bar:
        task = bar.add_task(f'{count} robots', total=None)
        crowd = many_robots.measure(count, lambda seconds: bar.update(task, completed=seconds))
    console().print(many_robots.table(crowd).rich())
    if crowd.skipped or crowd.late or crowd.stops:
        raise typer.Exit(1)


def _verify(what: int | str, qp: str, workers: int, output: Path | None) -> None:
    """Check a QP back end on a number of programs, or on the one of a name."""
    from cmpsp_ros.studies import verify as study  # noqa: PLC0415 (compiles kernels)

    with exit_on(study.VerifyError, ProblemError, code=1):
        file = None if output is None else study.new_file(output)
        if isinstance(what, str):
            compared = [study.verify_case(what, qp)]
            console().print(study.describe(compared[0]), markup=False, highlight=False)
        else:
            with progress_bar() as bar:
                task = bar.add_task(f'QPs by {qp}', total=what)
                compared = study.verify(what, qp, workers, lambda count: bar.advance(task, count))
            console().print(study.table(compared, qp))
    if file is not None:
        file.write_text(study.to_json(compared, qp), encoding='utf-8')
        console().print(f'{file}: all findings')
    wrong = study.mismatches(compared)
    if wrong and not isinstance(what, str):
        for each in wrong:
            errors().print(study.describe(each), markup=False, highlight=False, soft_wrap=True)
    if wrong:
        raise typer.Exit(1)
