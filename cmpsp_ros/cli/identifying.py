"""`cmpsp identify`: the parameters of a robot from a drive."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Annotated

import typer

from cmpsp_ros.bags import BagError
from cmpsp_ros.cli.options import CmdVel, Namespace, Odom
from cmpsp_ros.cli.terminal import console, exit_on, say
from cmpsp_ros.parameters import ParameterError


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
    from rich.table import Table  # noqa: PLC0415 (`--help` is quicker without)

    from cmpsp_ros.bags import identify as identifying  # noqa: PLC0415 (plots)

    paths, place = list(bags or []), (namespace or '').rstrip('/')
    first = paths[0].with_name(f'{paths[0].name}_identified') if paths else Path('identified')
    folder = output or first
    with exit_on(BagError, ParameterError, code=2):
        if not paths and not drive:
            raise BagError('BAG...: found none, wanted a bag, or --drive to make one')
        _make(folder, drive=drive, force=force)
        if drive:
            topics = odom or f'{place}/odom', cmd_vel or f'{place}/cmd_vel'
            _drive(folder / 'bag', topics, (max_speed, max_turn), yes=yes)
            paths.append(folder / 'bag')
        sources = identifying.Sources(odom, cmd_vel, None, namespace)
        found = identifying.identify(paths, sources, robot)
        identifying.write_parameters(folder / 'robot.yaml', found)
        identifying.draw(found, folder / 'identify.png')
    table = Table('figure', 'value and 95 %', 'unit', 'remark', title='identified')
    for each in found.estimates.values():
        if each.interval is not None:
            table.add_row(each.name, str(each.interval), each.unit, each.remark)
    console().print(table)
    for each in found.estimates.values():
        if each.interval is None:
            say(f'{each.name}: {each.remark}')
    say(f'{folder}: robot.yaml, identify.png')


def _make(folder: Path, *, drive: bool, force: bool) -> None:
    """Make a folder."""
    names = ('robot.yaml', 'identify.png', *(('bag',) if drive else ()))
    there = [folder / name for name in names if (folder / name).exists()]
    if there and not force:
        raise BagError(f'{there[0]}: exists already; --force replaces it')
    try:
        if folder / 'bag' in there:
            shutil.rmtree(folder / 'bag')
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise BagError(f'{folder}: cannot be made: {error.strerror or error}') from error


def _drive(bag: Path, topics: tuple[str, str], limits: tuple[float, float], *, yes: bool) -> None:
    """Move the robot, if the user agrees."""
    from cmpsp_ros.bags.identify import excitation  # noqa: PLC0415 (starts faster)
    from cmpsp_ros.nodes import excitation as driving  # noqa: PLC0415 (loads ROS)

    commands = excitation(*limits)
    question = (
        f'The robot that hears {topics[1]} will drive for 20 s, up to {limits[0]:g} m/s and'
        f' {limits[1]:g} rad/s. Is it clear for 1 m around it?'
    )
    if not yes and not typer.confirm(question):
        raise BagError('nothing was driven')
    if problem := driving.drive(bag, *topics, commands):
        raise BagError(f'{problem}; {bag} has what was driven')
