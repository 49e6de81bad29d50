"""`cmpsp audit`, `film`, `report` and `export`: the contents of a bag."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer

from cmpsp_ros.bags import BagError
from cmpsp_ros.cli.options import CmdVel, Namespace, Odom, ParamsFile
from cmpsp_ros.cli.terminal import console, exit_on, say
from cmpsp_ros.parameters import ParameterError


def audit(
    bag: Annotated[Path, typer.Argument(help='Bag, of our nodes or of any robot.')],
    junit: Annotated[
        Path | None, typer.Option(metavar='FILE', help='Also write JUnit XML, for CI.')
    ] = None,
    odom: Odom = None,
    cmd_vel: CmdVel = None,
    namespace: Namespace = None,
    params_file: ParamsFile = None,
) -> None:
    """Check a drive: road, obstacles, limits, goal, timing and fallback levels.

    Judged by all that the bag holds: odometry, the true path, parameters and what sensors saw.

    Exit code 0 without a fault, 1 with one, 2 if the bag cannot be audited, 3 if data are missing
    by which a check could be judged.
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
    for remark in auditing.remarks(findings):
        say(remark)
    outcome = auditing.overall(findings)
    if outcome is not auditing.CheckOutcome.PASSED:
        raise typer.Exit(1 if outcome is auditing.CheckOutcome.FAILED else 3)


def film(
    bag: Annotated[Path, typer.Argument(help='Bag of one run.')],
    output: Annotated[
        Path, typer.Option(metavar='FILE', help='New picture: .png, or an animated .gif.')
    ] = Path('film.gif'),
    at: Annotated[
        list[float] | None,
        typer.Option(metavar='SECONDS', help='Time of a frame; may be repeated.'),
    ] = None,
) -> None:
    """Show a run from a camera behind the robot.

    It is drawn by MuJoCo.

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
    """Make a page of one bag, or of several to compare them.

    It opens from disk, offline.

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
    form: Annotated[
        Literal['csv', 'parquet'], typer.Option('--format', help='Format of the tables.')
    ] = 'csv',
) -> None:
    """Write the contents of a bag as tables with units.

    Odometry, commands, wheel speeds, decisions, plans, goals, roads and moving obstacles.

    Exit code 2 if the bag cannot be used.
    """
    from cmpsp_ros.bags import export as tables  # noqa: PLC0415 (starts faster without)

    with exit_on(BagError, code=2):
        counts = tables.export(bag, output, form)
    for path, count in counts.items():
        say(f'{path}: {count} rows')
