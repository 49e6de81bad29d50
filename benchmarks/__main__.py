"""`make bench`, `cmpsp bench`: time control steps, or verify a QP solver."""

from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Optional

import typer

from cmpsp_ros.cli import console, errors, exit_on, progress_bar
from cmpsp_ros.mpsp import ProblemError
from cmpsp_ros.parameters import ParameterError

app = typer.Typer(add_completion=False, pretty_exceptions_enable=False)


@app.command()
def bench(
    presets: Annotated[
        Optional[list[str]],
        typer.Argument(
            metavar='PRESET', help="Presets, or parameter files; none: all, and the paper's runs."
        ),
    ] = None,
    runs: Annotated[int, typer.Option(min=1, help='Runs of each preset and of each method.')] = 20,
    peers: Annotated[bool, typer.Option('--peers', help='Time solvers of CasADi as well.')] = False,
    latency: Annotated[
        bool, typer.Option('--latency', help='Time the node over DDS, in real time.')
    ] = False,
    tail: Annotated[
        int, typer.Option(min=1, metavar='COUNT', help='Steps of which the longest are shown.')
    ] = 20_000,
    output: Annotated[
        Optional[Path], typer.Option(help='New file ending in .json, or new or empty folder.')
    ] = None,
    verify: Annotated[
        Optional[int],
        typer.Option(min=1, metavar='COUNT', help='Instead, check a QP back end on as many QPs.'),
    ] = None,
    verify_case: Annotated[
        Optional[str], typer.Option(metavar='ID', help='Instead, check it on the one of that name.')
    ] = None,
    qp: Annotated[
        Optional[str],
        typer.Option(metavar='NAME', help="The back end checked; without: guidance's."),
    ] = None,
    workers: Annotated[int, typer.Option(min=1, help='Processes that check.')] = 1,
    obstacles: Annotated[
        bool, typer.Option('--obstacles', help='Instead, time steps past 0 to 64 obstacles.')
    ] = False,
    sensors: Annotated[
        bool, typer.Option('--sensors', help='Instead, time steps with a laser scanner.')
    ] = False,
    robots: Annotated[
        Optional[int],
        typer.Option(min=1, max=50, metavar='COUNT', help='Instead, so many robots at once.'),
    ] = None,
) -> None:
    """Time control steps, alone and beside other solvers."""
    if robots is not None:
        _many_robots(robots)
        return
    if obstacles:
        from benchmarks import crowds  # noqa: PLC0415 (compiles kernels)

        console().print(crowds.obstacles_table(crowds.measure_obstacles(runs)).rich())
        return
    if sensors:
        from benchmarks import crowds, tracking  # noqa: PLC0415 (compiles kernels)

        console().print(crowds.sensors_table(crowds.measure_sensors(runs)).rich())
        console().print(tracking.tracking_table(tracking.measure_tracking()).rich())
        return
    if verify is not None or verify_case is not None:
        from cmpsp_ros.guidance import SolverSettings  # noqa: PLC0415 (loads kernels)

        _verify(verify or verify_case or '', qp or SolverSettings().qp, workers, output)
        return
    from benchmarks.common import BenchError  # noqa: PLC0415 (compiles kernels)
    from benchmarks.results import Order  # noqa: PLC0415
    from benchmarks.run import run  # noqa: PLC0415
    from benchmarks.tables import tables  # noqa: PLC0415

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


def _many_robots(count: int) -> None:
    """Drive that many robots at once; exit code 1 if one was ever late."""
    from benchmarks.common import BenchError  # noqa: PLC0415
    from benchmarks.over_dds import many_robots  # noqa: PLC0415 (needs ROS)

    with exit_on(BenchError, ParameterError, code=1), progress_bar() as bar:
        task = bar.add_task(f'{count} robots', total=None)
        crowd = many_robots.measure(count, lambda seconds: bar.update(task, completed=seconds))
    console().print(many_robots.table(crowd).rich())
    if crowd.skipped or crowd.late or crowd.stops:
        raise typer.Exit(1)


def _verify(what: int | str, qp: str, workers: int, output: Path | None) -> None:
    """Check a QP back end on a number of programs, or on the one of a name."""
    from benchmarks.common import BenchError  # noqa: PLC0415
    from benchmarks.verify import report, run  # noqa: PLC0415 (compiles kernels)

    with exit_on(BenchError, ProblemError, code=1):
        file = None if output is None else report.new_file(output)
        if isinstance(what, str):
            compared = [run.verify_case(what, qp)]
            console().print(report.describe(compared[0]), markup=False, highlight=False)
        else:
            with progress_bar() as bar:
                task = bar.add_task(f'QPs by {qp}', total=what)
                compared = run.verify(what, qp, workers, lambda count: bar.advance(task, count))
            console().print(report.table(compared, qp))
    if file is not None:
        file.write_text(report.to_json(compared, qp), encoding='utf-8')
        console().print(f'{file}: all findings')
    wrong = report.mismatches(compared)
    if wrong and not isinstance(what, str):
        for each in wrong:
            errors().print(report.describe(each), markup=False, highlight=False, soft_wrap=True)
    if wrong:
        raise typer.Exit(1)


if __name__ == '__main__':
    app()
