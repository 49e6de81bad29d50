"""`cmpsp identify`: the parameters of a robot from a drive."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from cmpsp_ros.bags.errors import BagError
from cmpsp_ros.cli.console import complain, console, exit_on, say
from cmpsp_ros.cli.options import CmdVel, Namespace, Odom
from cmpsp_ros.parameters.errors import ParameterError

if TYPE_CHECKING:
    from rich.table import Table

    from cmpsp_ros.bags.identify import Identification

_CONTENT = 'robot.yaml', 'identify.png'


def identify(
    bags: Annotated[
        list[Path] | None, typer.Argument(metavar='BAG...', help='Bags of one robot.')
    ] = None,
    drive: Annotated[
        bool, typer.Option('--drive', help='Drive the robot for 20 s first, and record it.')
    ] = False,
    yes: Annotated[bool, typer.Option('--yes', help='Drive without asking.')] = False,
    max_speed: Annotated[float, typer.Option(min=0.01, help='Limit of that drive [m/s].')] = 0.2,
    max_turn: Annotated[float, typer.Option(min=0.05, help='Limit of that drive [rad/s].')] = 1.0,
    robot: Annotated[
        str | None,
        typer.Option(metavar='NAME', help='What is known: of config/robots, or path of a file.'),
    ] = None,
    output: Annotated[
        Path | None, typer.Option(help='New folder; <BAG>_identified, or identified, when absent.')
    ] = None,
    odom: Odom = None,
    cmd_vel: CmdVel = None,
    namespace: Namespace = None,
    force: Annotated[
        bool, typer.Option('--force', help='Replace an earlier identification.')
    ] = False,
) -> None:
    """Measure delay, lag, scales, limits and odometry of a robot.

    The bags may be of any program: odometry and commands suffice. With --drive it moves the robot
    itself, within 1 m of where it stands. It writes a parameter file and a picture.

    Exit code 2 if a bag cannot be used, or the drive was cut short.
    """
    paths = list(bags or [])
    folder = output or (
        paths[0].with_name(f'{paths[0].name}_identified') if paths else Path('identified')
    )
    if not paths and not drive:
        complain('BAG...: found none, wanted a bag, or --drive to make one')
        raise typer.Exit(2)
    from cmpsp_ros.bags.audit import Sources  # noqa: PLC0415 (starts faster without)
    from cmpsp_ros.bags.identify import identify as identified  # noqa: PLC0415 (the same)
    from cmpsp_ros.bags.identify.parameter_file import write_parameters  # noqa: PLC0415 (the same)
    from cmpsp_ros.bags.identify.picture import draw  # noqa: PLC0415 (plots)

    with exit_on(BagError, ParameterError, code=2):
        _make(folder, ('bag', *_CONTENT) if drive else _CONTENT, force=force)
        if drive:
            names = odom or f'{namespace or ""}/odom', cmd_vel or f'{namespace or ""}/cmd_vel'
            _drive(folder / 'bag', *names, (max_speed, max_turn), yes=yes)
            paths.append(folder / 'bag')
        found = identified(paths, Sources(odom, cmd_vel, None, namespace), robot)
        write_parameters(folder / 'robot.yaml', found)
        draw(found, folder / 'identify.png')
    console().print(_table(found))
    for each in found.estimates.values():
        if each.interval is None:
            say(f'{each.name}: {each.remark}')
    say(f'{folder}: robot.yaml, identify.png')


def _make(folder: Path, content: tuple[str, ...], *, force: bool) -> None:
    """Make a folder for some content.

    Raises:
        BagError: It is there already, or cannot be made.
    """
    there = [folder / name for name in content if (folder / name).exists()]
    if there and not force:
        raise BagError(f'{there[0]}: exists already; --force replaces it')
    try:
        for each in there:
            if each.is_dir():
                shutil.rmtree(each)
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise BagError(f'{folder}: cannot be made: {error.strerror or error}') from error


def _drive(bag: Path, odom: str, cmd_vel: str, limits: tuple[float, float], *, yes: bool) -> None:
    """Move the robot, if the user agrees."""
    from cmpsp_ros.bags.identify.excitation import DURATION, RADIUS, excitation  # noqa: PLC0415
    from cmpsp_ros.nodes import excitation as driving  # noqa: PLC0415 (loads ROS)

    try:
        commands = excitation(*limits)
    except ValueError as error:
        complain(f'--max-speed, --max-turn: {error}')
        raise typer.Exit(2) from None
    question = (
        f'The robot of {cmd_vel} will drive for {DURATION:.0f} s, up to {limits[0]:g} m/s and'
        f' {limits[1]:g} rad/s. Is it clear for {RADIUS:g} m around it?'
    )
    if not yes and not typer.confirm(question):
        raise typer.Exit(2)
    if problem := driving.drive(bag, odom, cmd_vel, commands):
        complain(problem)
        raise typer.Exit(2)


def _table(found: Identification) -> Table:
    from rich.table import Table  # noqa: PLC0415 (`--help` is quicker without)

    table = Table('figure', 'value', '95 %', 'unit', 'remark', title='identified')
    for each in found.estimates.values():
        if each.interval is not None:
            value, low, high = each.interval.figures
            table.add_row(each.name, value, f'{low} to {high}', each.unit, each.remark)
    return table
