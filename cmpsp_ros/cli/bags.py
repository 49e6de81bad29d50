"""Commands on a bag: `cmpsp audit`, `film`, `report`, `export` and `replay`."""

from __future__ import annotations

import math
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Optional

import typer

from cmpsp_ros.bags import BagError
from cmpsp_ros.cli.terminal import (
    Assignments,
    CmdVel,
    Namespace,
    Odom,
    ParamsFile,
    console,
    exit_on,
    remark,
    say,
)
from cmpsp_ros.parameters import ParameterError, Problem

if TYPE_CHECKING:
    from cmpsp_ros.bags import Names

_Format = StrEnum('_Format', ['csv', 'parquet'])


def audit(
    bag: Annotated[Path, typer.Argument(help='Bag, of our nodes or of any robot.')],
    junit: Annotated[
        Optional[Path], typer.Option(metavar='FILE', help='Also write JUnit XML, for CI.')
    ] = None,
    odom: Odom = None,
    cmd_vel: CmdVel = None,
    namespace: Namespace = None,
    params_file: ParamsFile = None,
) -> None:
    """Check a drive: road, obstacles, limits, goal, timing and fallback levels.

    Uses all data of the bag: odometry, the true path, parameters and sensor data.

    Exit code 0 without a fault, 1 with one, 2 if the bag cannot be audited, 3 if data needed for a
    check are missing.
    """
    from cmpsp_ros.bags import audit as auditing  # noqa: PLC0415 (starts faster without)

    with exit_on(BagError, ParameterError, code=2):
        evidence = auditing.read_record(
            bag, auditing.Sources(odom, cmd_vel, params_file, namespace)
        )
        findings = auditing.audit_record(evidence)
        if junit is not None:
            auditing.write_junit(junit, findings, evidence)
    console().print(auditing.table(findings, f'audit of {bag}'))
    for each in auditing.remarks(findings):
        say(each)
    outcome = auditing.overall(findings)
    if outcome is not auditing.CheckOutcome.PASSED:
        raise typer.Exit(1 if outcome is auditing.CheckOutcome.FAILED else 3)


def film(
    bag: Annotated[Path, typer.Argument(help='Bag of one run.')],
    output: Annotated[
        Path, typer.Option(metavar='FILE', help='New picture: .png, or an animated .gif.')
    ] = Path('film.gif'),
    at: Annotated[
        Optional[list[float]],
        typer.Option(metavar='SECONDS', help='Time of a frame; may be repeated.'),
    ] = None,
) -> None:
    """Show a run from a camera behind the robot, rendered by MuJoCo.

    Exit code 2 if the bag cannot be used, or nothing can be drawn.
    """
    from cmpsp_ros.bags import film as filming  # noqa: PLC0415 (an option of its own to install)

    with exit_on(BagError, ParameterError, code=2):
        count = filming.film(bag, output, at or [])
    say(f'{output}: {count} frames')


def report(
    bags: Annotated[list[Path], typer.Argument(metavar='BAG...', help='Bags to show together.')],
    output: Annotated[
        Path, typer.Option(metavar='FILE.html', help='New page; a PNG is written beside it.')
    ] = Path('report.html'),
    odom: Odom = None,
    cmd_vel: CmdVel = None,
    namespace: Namespace = None,
    params_file: ParamsFile = None,
    force: Annotated[bool, typer.Option('--force', help='Replace an earlier report.')] = False,
) -> None:
    """Write an HTML report of one bag, or of several to compare them.

    The page opens from disk, offline.

    Exit code 2 if a bag cannot be used.
    """
    from cmpsp_ros.bags import report as reporting  # noqa: PLC0415 (plots)
    from cmpsp_ros.bags.audit import Sources  # noqa: PLC0415 (starts faster without)

    with exit_on(BagError, ParameterError, code=2):
        sources = Sources(odom, cmd_vel, params_file, namespace)
        written = reporting.write_report(bags, output, sources, force=force)
    for path in written:
        say(f'{path}: written')


def export(
    bag: Annotated[Path, typer.Argument(help='Bag, of any robot.')],
    output: Annotated[Path, typer.Option(help='New folder of the tables.')],
    form: Annotated[_Format, typer.Option('--format', help='Format of the tables.')] = _Format.csv,
) -> None:
    """Write the contents of a bag as tables with units.

    Odometry, commands, wheel speeds, decisions, plans, goals, roads and moving obstacles.

    Exit code 2 if the bag cannot be used.
    """
    from cmpsp_ros.bags import export as tables  # noqa: PLC0415 (starts faster without)

    with exit_on(BagError, code=2):
        counts = tables.export(bag, output, 'parquet' if form is _Format.parquet else 'csv')
    for path, count in counts.items():
        say(f'{path}: {count} rows')


def replay(
    bag: Annotated[Path, typer.Argument(help='Bag of a guidance node.')],
    tolerance: Annotated[
        Optional[float],
        typer.Option(metavar='REL', help='Tolerance of floats, for bags of another machine.'),
    ] = None,
    assignments: Assignments = None,
    params_file: ParamsFile = None,
    output: Annotated[
        Optional[Path], typer.Option(help='What if: new folder; <BAG>_what_if when absent.')
    ] = None,
    namespace: Namespace = None,
    odom: Odom = None,
    cmd_vel: CmdVel = None,
) -> None:
    """Recompute the decisions from recorded odometry, and compare them.

    Exit code 0 if all are identical or within the tolerance, 1 if any differs, 2 if the bag cannot
    be used. With --set or --params-file it shows the decisions of a changed guidance law.
    """
    from cmpsp_ros.bags import Names  # noqa: PLC0415 (starts faster without)

    names = Names.under(namespace or '', odom or '', cmd_vel or '')
    with exit_on(BagError, ParameterError, code=2):
        if tolerance is not None and not 0.0 <= tolerance < math.inf:
            raise ParameterError(Problem('--tolerance', str(tolerance), 'a finite number >= 0'))
        if assignments or params_file:
            _what_if(bag, names, assignments or [], params_file, output)
            return
        from cmpsp_ros.bags.replay import replay as again  # noqa: PLC0415 (loads kernels)

        outcome = again.replay(bag, names, tolerance)
    say(outcome)
    if outcome.first is not None:
        raise typer.Exit(1)


def _what_if(
    bag: Path, names: Names, assignments: list[str], params_file: str | None, output: Path | None
) -> None:
    from cmpsp_ros.bags.replay import Change, draw_what_if, what_if  # noqa: PLC0415 (loads kernels)
    from cmpsp_ros.parameters import load_parameter_file  # noqa: PLC0415 (starts faster without)
    from cmpsp_ros.parameters.files import parse_assignment  # noqa: PLC0415 (starts faster without)

    robot = names.namespace
    base = None if params_file is None else load_parameter_file(params_file, namespace=robot)
    change = Change(base, dict(parse_assignment(each) for each in assignments))
    folder = output or bag.with_name(f'{bag.name}_what_if')
    result = what_if(bag, names, change, folder / 'bag')
    title = ', '.join([params_file or 'recorded parameters', *assignments])
    draw_what_if(result, f'What if: {title}', folder / 'what_if.png')
    say(result)
    say(f'{folder}: bag, what_if.png')
    say('open loop: the robot followed the recorded commands, not the changed ones')
    for each in result.left_out:
        remark(f'left out: {each}: its type is not known here')
