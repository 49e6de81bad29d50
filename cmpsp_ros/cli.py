"""The `cmpsp` command: arguments in, exit code out."""

from __future__ import annotations

import gc
import math
import signal
import time
from collections.abc import Callable
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING, Annotated, Final, Literal, NoReturn

import typer
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn
from rich.table import Table

from cmpsp_ros.bags.errors import BagError
from cmpsp_ros.demo.errors import DemoError
from cmpsp_ros.demo.folder import make_folder
from cmpsp_ros.mpsp.errors import ProblemError
from cmpsp_ros.parameters.errors import ParameterError
from cmpsp_ros.parameters.presets import load_parameter_file, parse_assignment

if TYPE_CHECKING:
    from cmpsp_ros.bags.recording import Names
    from cmpsp_ros.demo.scenario import Scenario
    from cmpsp_ros.demo.summary import Summary

app = typer.Typer(
    help='Guidance of a differential-drive robot by C-MPSP.',
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
)
_OBJECTS_BEFORE_COLLECTION: Final = 100_000

_console = Console()
_errors = Console(stderr=True)


@app.command()
def demo(
    preset: Annotated[str, typer.Argument(help='Preset, or path of a parameter file.')] = 'case3',
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
    force: Annotated[
        bool, typer.Option('--force', help='Replace an earlier run in the output folder.')
    ] = False,
) -> None:
    """Drive one run with real nodes, record it, and draw it.

    Exit code 0 only if the goal was reached within its tolerance and the path driven is clear.
    """
    from cmpsp_ros.demo.scenario import load_scenario  # noqa: PLC0415 (loads kernels)

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
def audit(
    bag: Annotated[Path, typer.Argument(help='Bag, of our nodes or of any robot.')],
    junit: Annotated[
        Path | None, typer.Option(metavar='FILE', help='Write JUnit XML, for CI, as well.')
    ] = None,
    odom: Annotated[
        str | None, typer.Option(metavar='TOPIC', help='Odometry; <namespace>/odom when absent.')
    ] = None,
    cmd_vel: Annotated[
        str | None, typer.Option(metavar='TOPIC', help='Commands; <namespace>/cmd_vel when absent.')
    ] = None,
    params_file: Annotated[
        str | None,
        typer.Option(metavar='FILE', help='Judge by these parameters, not by those in the bag.'),
    ] = None,
) -> None:
    """Check a drive by its odometry and the parameters alone: road, limits, goal, timing, ladder.

    Exit code 0 if nothing is wrong, 1 if something is, 2 if the bag cannot be audited.
    """
    from cmpsp_ros.bags import audit as auditing  # noqa: PLC0415 (starts faster without)

    try:
        evidence = auditing.read_record(bag, auditing.Sources(odom, cmd_vel, params_file))
        findings = auditing.audit_record(evidence)
        if junit is not None:
            auditing.write_junit(junit, findings, evidence)
    except (BagError, ParameterError) as error:
        _errors.print(str(error), style='red', markup=False, highlight=False, soft_wrap=True)
        raise typer.Exit(2) from None
    _console.print(auditing.table(findings, f'audit of {bag}'))
    for remark in auditing.remarks(findings):
        _console.print(remark, soft_wrap=True)
    if any(each.outcome is auditing.Outcome.FAILED for each in findings):
        raise typer.Exit(1)


@app.command()
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
) -> None:
    """Time control steps, alone and beside other solvers, over horizons and over DDS."""
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
    try:
        with Progress(console=_errors) as bar:

            def progress(part: str, pieces: int) -> Callable[[], None]:
                task = bar.add_task(part, total=pieces)
                return lambda: bar.advance(task)

            results = run(order, progress)
    except (BenchError, ParameterError) as error:
        _errors.print(str(error), style='red', markup=False, highlight=False, soft_wrap=True)
        raise typer.Exit(1) from None
    for table in tables(results):
        _console.print(table.rich())
    if output is not None:
        _console.print(f'{output}: written')


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


@app.command()
def export(
    bag: Annotated[Path, typer.Argument(help='Bag, of any robot.')],
    output: Annotated[Path, typer.Option(help='New folder of the tables.')],
    form: Annotated[
        Literal['csv', 'parquet'], typer.Option('--format', help='Format of the tables.')
    ] = 'csv',
) -> None:
    """Write odometry, commands, wheel speeds, decisions and plans as tables with units.

    Exit code 2 if the bag cannot be used.
    """
    from cmpsp_ros.bags import export as tables  # noqa: PLC0415 (starts faster without)

    try:
        counts = tables.export(bag, output, form)
    except BagError as error:
        _errors.print(str(error), style='red', markup=False, highlight=False, soft_wrap=True)
        raise typer.Exit(2) from None
    for path, count in counts.items():
        _console.print(f'{path}: {count} rows', markup=False, highlight=False, soft_wrap=True)


@app.command()
def record(
    output: Annotated[
        Path | None, typer.Option(help='New folder of the bag; bags/<time> when absent.')
    ] = None,
    topics: Annotated[
        list[str] | None,
        typer.Option('--topic', metavar='NAME', help='Record this topic; may be repeated.'),
    ] = None,
    everything: Annotated[bool, typer.Option('--all', help='Record every topic.')] = False,
    namespace: Annotated[str, typer.Option(help='In which names are meant, as in /r1.')] = '',
    storage: Annotated[
        Literal['mcap', 'sqlite3'], typer.Option(help='Format of the files.')
    ] = 'mcap',
    compression: Annotated[
        Literal['none', 'zstd'], typer.Option(help='Compression of the chunks of mcap.')
    ] = 'none',
    split_size: Annotated[
        float, typer.Option(min=0.0, metavar='MB', help='Size at which a new file is begun.')
    ] = 0.0,
    split_duration: Annotated[
        float, typer.Option(min=0.0, metavar='SECONDS', help='Time after which one is begun.')
    ] = 0.0,
    use_sim_time: Annotated[
        bool, typer.Option('--use-sim-time', help='Stamp messages with the simulated time.')
    ] = False,
) -> None:
    """Record a running system until SIGINT or SIGTERM: the topics of guidance and sim, or others.

    Parameters of all nodes, QoS profiles and software versions go into the bag as well, and
    /clock and /parameter_events in any case. Exit code 2 if recording ended by itself.
    """
    folder = output or Path('bags') / time.strftime('%Y-%m-%d_%H-%M-%S')
    if problem := _unrecordable(folder, storage, compression, topics, everything=everything):
        _errors.print(problem, style='red', markup=False, highlight=False, soft_wrap=True)
        raise typer.Exit(2)
    from cmpsp_ros.nodes import recorder  # noqa: PLC0415 (loads ROS)

    parameters = {
        'output': str(folder),
        # ROS cannot tell of what an empty list is one.
        **({'topics': topics} if topics else {}),
        'own_topics': not (topics or everything),
        'storage': storage,
        'compression': compression,
        'split_size': split_size,
        'split_duration': split_duration,
        'use_sim_time': use_sim_time,
    }
    if recorder.record(parameters, namespace):
        raise typer.Exit(2)


@app.command()
def recover(
    bag: Annotated[Path, typer.Argument(help='Bag that was cut off, or one of its files.')],
    output: Annotated[
        Path | None, typer.Option(help='New folder; <BAG>_recovered when absent.')
    ] = None,
) -> None:
    """Make a whole bag of one whose recorder was killed; the other stays as it is.

    Exit code 2 if nothing in it can be read.
    """
    from cmpsp_ros.bags import recover as rescue  # noqa: PLC0415 (starts faster without)

    try:
        found = rescue.recover(bag, output)
    except BagError as error:
        _errors.print(str(error), style='red', markup=False, highlight=False, soft_wrap=True)
        raise typer.Exit(2) from None
    for each in found.remarks:
        _errors.print(each, markup=False, highlight=False, soft_wrap=True)
    count = f'{found.messages} messages of {found.topics} topics'
    _console.print(f'{found.path}: {count}', markup=False, highlight=False, soft_wrap=True)


@app.command()
def replay(
    bag: Annotated[Path, typer.Argument(help='Bag of a guidance node.')],
    tolerance: Annotated[
        float | None,
        typer.Option(
            min=0.0, metavar='REL', help='For bags of another machine: how far floats may differ.'
        ),
    ] = None,
    assignments: Annotated[
        list[str] | None,
        typer.Option('--set', metavar='KEY=VALUE', help='What if: change a parameter; repeatable.'),
    ] = None,
    params_file: Annotated[
        str | None, typer.Option(metavar='FILE', help='What if: other parameters, or a preset.')
    ] = None,
    output: Annotated[
        Path | None, typer.Option(help='What if: new folder; <BAG>_what_if when absent.')
    ] = None,
    namespace: Annotated[str, typer.Option(help='Namespace of the node, as in /r1.')] = '',
    odom: Annotated[
        str, typer.Option(help='Topic of odometry; <namespace>/odom when absent.')
    ] = '',
    cmd_vel: Annotated[
        str, typer.Option(help='Topic of commands; <namespace>/cmd_vel when absent.')
    ] = '',
) -> None:
    """Decide again on recorded odometry, and compare every decision with the recorded one.

    Exit code 0 if all are identical, 1 if any differs, 2 if the bag cannot be used. With --set or
    --params-file it shows what a changed guidance law would have said instead.
    """
    from cmpsp_ros.bags.recording import Names  # noqa: PLC0415 (starts faster without)

    names = Names.under(namespace, odom, cmd_vel)
    try:
        if assignments or params_file:
            _what_if(bag, names, assignments or [], params_file, output)
            return
        from cmpsp_ros.bags import replay as again  # noqa: PLC0415 (loads kernels)

        outcome = again.replay(bag, names, tolerance)
    except (BagError, ParameterError) as error:
        _errors.print(str(error), style='red', markup=False, highlight=False, soft_wrap=True)
        raise typer.Exit(2) from None
    _console.print(str(outcome), markup=False, highlight=False, soft_wrap=True)
    if outcome.first is not None:
        raise typer.Exit(1)


@app.command()
def report(
    bags: Annotated[list[Path], typer.Argument(metavar='BAG...', help='Bags to show together.')],
    output: Annotated[
        Path, typer.Option(metavar='FILE.html', help='New page; a PNG is put beside it.')
    ] = Path('report.html'),
    odom: Annotated[
        str | None, typer.Option(metavar='TOPIC', help='Odometry; <namespace>/odom when absent.')
    ] = None,
    cmd_vel: Annotated[
        str | None, typer.Option(metavar='TOPIC', help='Commands; <namespace>/cmd_vel when absent.')
    ] = None,
    params_file: Annotated[
        str | None,
        typer.Option(metavar='FILE', help='Show these parameters, not those in the bags.'),
    ] = None,
    force: Annotated[bool, typer.Option('--force', help='Replace an earlier report.')] = False,
) -> None:
    """Make a page of one bag, or of several to compare them; it opens from disk, offline.

    Exit code 2 if a bag cannot be used.
    """
    from cmpsp_ros.bags import report as reporting  # noqa: PLC0415 (plots)
    from cmpsp_ros.bags.audit import Sources  # noqa: PLC0415 (starts faster without)

    try:
        sources = Sources(odom, cmd_vel, params_file)
        written = reporting.write_report(bags, output, sources, force=force)
    except (BagError, ParameterError) as error:
        _errors.print(str(error), style='red', markup=False, highlight=False, soft_wrap=True)
        raise typer.Exit(2) from None
    for path in written:
        _console.print(f'{path}: written', markup=False, highlight=False, soft_wrap=True)


@app.command()
def play(
    bag: Annotated[Path, typer.Argument(help='Any bag.')],
    rate: Annotated[
        float, typer.Option(min=1e-3, max=1e3, help='How fast, 1 being as it was.')
    ] = 1.0,
    start_offset: Annotated[
        float, typer.Option(min=0.0, metavar='SECONDS', help='Where to begin in the recording.')
    ] = 0.0,
    duration: Annotated[
        float | None,
        typer.Option(min=0.0, metavar='SECONDS', help='How much of it; all when absent.'),
    ] = None,
    loop: Annotated[bool, typer.Option('--loop', help='Begin again at the end.')] = False,
    paused: Annotated[
        bool, typer.Option('--paused', help='Wait for the space key, or the service ~/resume.')
    ] = False,
    topics: Annotated[
        list[str] | None, typer.Option('--topics', metavar='TOPIC', help='Only this; repeatable.')
    ] = None,
    remap: Annotated[
        list[str] | None, typer.Option(metavar='OLD:=NEW', help='Another name; repeatable.')
    ] = None,
) -> None:
    """Publish recorded topics to live nodes, with /clock; the space key pauses.

    For live nodes with use_sim_time. To try a guidance node on recorded odometry: --topics /odom
    """
    from cmpsp_ros.nodes import player  # noqa: PLC0415 (needs ROS)

    playback = player.Playback(rate, start_offset, duration, loop, paused, tuple(topics or ()))
    try:
        code = player.play(bag, playback, remap or ())
    except BagError as error:
        _errors.print(str(error), style='red', markup=False, highlight=False, soft_wrap=True)
        raise typer.Exit(2) from None
    raise typer.Exit(code)


@app.command()
def warmup() -> None:
    """Compile whatever nodes and commands run, so that each of them starts at once.

    Exit code 1 only if there is no folder to keep it in.
    """
    from cmpsp_ros.studies.warmup import warm_up_all  # noqa: PLC0415 (loads all kernels)

    try:
        with _console.status('') as status:
            outcome = warm_up_all(status.update)
    except ParameterError as error:
        _errors.print(str(error), style='red', markup=False, highlight=False, soft_wrap=True)
        raise typer.Exit(1) from None
    for part in outcome.parts:
        done = f'{part.kernels} kernels compiled' if part.kernels else 'all there'
        _console.print(f'{part.name}: {done}, {part.seconds:.1f} s', highlight=False)
    if outcome.removed:
        _console.print(f'removed: machine code of {len(outcome.removed)} other version(s)')
    if outcome.folder is not None:
        _console.print(f'kept in: {outcome.folder}', soft_wrap=True, highlight=False)
    if outcome.hindrance:
        _errors.print(outcome.hindrance, style='red', markup=False, soft_wrap=True)
    if outcome.folder is None:
        raise typer.Exit(1)


def _what_if(
    bag: Path, names: Names, assignments: list[str], params_file: str | None, output: Path | None
) -> None:
    """Show what a changed guidance law would have said."""
    from cmpsp_ros.bags.what_if import Change, what_if  # noqa: PLC0415 (loads kernels)
    from cmpsp_ros.bags.what_if_picture import draw_what_if  # noqa: PLC0415 (plots)

    base = None if params_file is None else load_parameter_file(params_file)
    change = Change(base, dict(parse_assignment(each) for each in assignments))
    folder = output or bag.with_name(f'{bag.name}_what_if')
    result = what_if(bag, names, change, folder / 'bag')
    title = ', '.join([params_file or 'recorded parameters', *assignments])
    draw_what_if(result, f'What if: {title}', folder / 'what_if.png')
    _console.print(str(result), markup=False, highlight=False)
    _console.print(f'{folder}: bag, what_if.png', soft_wrap=True, highlight=False)
    _console.print('open loop: the robot followed the recorded commands, not the changed ones')
    for each in result.left_out:
        _errors.print(f'left out: {each}: its type is not known here', markup=False)


def _unrecordable(
    folder: Path, storage: str, compression: str, topics: list[str] | None, *, everything: bool
) -> str:
    """Why an order cannot be recorded; empty when it can."""
    if folder.exists():
        return f'{folder}: exists already, a new bag needs a path that does not exist'
    if storage != 'mcap' and compression != 'none':
        return f'--compression {compression}: only mcap can be compressed, not {storage}'
    if topics and everything:
        return '--all and --topic: wanted one or the other'
    return ''


def _verify(what: int | str, qp: str, workers: int, output: Path | None) -> None:
    """Check a QP back end on a number of programs, or on the one of a name."""
    from cmpsp_ros.studies import verify as study  # noqa: PLC0415 (compiles kernels)

    try:
        file = None if output is None else study.new_file(output)
        if isinstance(what, str):
            compared = [study.verify_case(what, qp)]
            _console.print(study.describe(compared[0]), markup=False, highlight=False)
        else:
            with Progress(console=_errors) as bar:
                task = bar.add_task(f'QPs by {qp}', total=what)
                compared = study.verify(what, qp, workers, lambda count: bar.advance(task, count))
            _console.print(study.table(compared, qp))
    except (study.VerifyError, ProblemError) as error:
        _errors.print(str(error), style='red', markup=False, highlight=False, soft_wrap=True)
        raise typer.Exit(1) from None
    if file is not None:
        file.write_text(study.to_json(compared, qp), encoding='utf-8')
        _console.print(f'{file}: all findings')
    wrong = study.mismatches(compared)
    if wrong and not isinstance(what, str):
        for each in wrong:
            _errors.print(study.describe(each), markup=False, highlight=False, soft_wrap=True)
    if wrong:
        raise typer.Exit(1)


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
    # Importing makes many objects that stay: looking through them again and again takes a tenth of
    # the time that a short command needs.
    gc.set_threshold(_OBJECTS_BEFORE_COLLECTION)
    app()


if __name__ == '__main__':
    main()
