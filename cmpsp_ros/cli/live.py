"""Commands on a running system: `cmpsp record`, `recover`, `play`, `identify` and `view`."""

import shutil
import time
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Optional

import typer

from cmpsp_ros.bags import BagError
from cmpsp_ros.cli.terminal import CmdVel, Namespace, Odom, complain, console, exit_on, remark, say
from cmpsp_ros.parameters import ParameterError

_Storage = StrEnum('_Storage', ['mcap', 'sqlite3'])
_Compression = StrEnum('_Compression', ['none', 'zstd'])


def record(
    output: Annotated[
        Optional[Path], typer.Option(help='New folder of the bag; bags/<time> when absent.')
    ] = None,
    topics: Annotated[
        Optional[list[str]],
        typer.Option('--topic', metavar='NAME', help='Record this topic; may be repeated.'),
    ] = None,
    everything: Annotated[bool, typer.Option('--all', help='Record every topic.')] = False,
    namespace: Annotated[str, typer.Option(help='In which names are meant, as in /r1.')] = '',
    storage: Annotated[_Storage, typer.Option(help='Format of the files.')] = _Storage.mcap,
    compression: Annotated[
        Optional[_Compression],
        typer.Option(help='Compression of the chunks of mcap; zstd when absent.'),
    ] = None,
    split_size: Annotated[
        float, typer.Option(min=0.0, metavar='MB', help='Size at which a new file is begun.')
    ] = 0.0,
    split_duration: Annotated[
        float,
        typer.Option(min=0.0, metavar='SECONDS', help='Duration after which a new file is begun.'),
    ] = 0.0,
    use_sim_time: Annotated[
        bool, typer.Option('--use-sim-time', help='Stamp messages with the simulated time.')
    ] = False,
) -> None:
    """Record a running system until SIGINT or SIGTERM.

    By default it records the topics of guidance and sim. The bag always includes /clock, the
    parameters of guidance and sim with their changes, QoS profiles and software versions. At the
    end it reports messages that came too fast to be recorded. Exit code 2 if recording ended on
    its own.
    """
    folder = output or Path('bags') / time.strftime('%Y-%m-%d_%H-%M-%S')
    if problem := _unrecordable(folder, storage, compression, topics, everything=everything):
        complain(problem)
        raise typer.Exit(2)
    from cmpsp_ros.nodes.recording import recorder  # noqa: PLC0415 (loads ROS)

    parameters = {
        'output': str(folder),
        # ROS does not know the type of an empty list.
        **({'topics': topics} if topics else {}),
        'own_topics': not (topics or everything),
        'storage': storage.value,
        **({'compression': compression.value} if compression else {}),
        'split_size': split_size,
        'split_duration': split_duration,
        'use_sim_time': use_sim_time,
    }
    if recorder.record(parameters, namespace):
        raise typer.Exit(2)


def recover(
    bag: Annotated[Path, typer.Argument(help='Bag that was cut off, or one of its files.')],
    output: Annotated[
        Optional[Path], typer.Option(help='New folder; <BAG>_recovered when absent.')
    ] = None,
) -> None:
    """Recover a valid bag from one whose recorder was killed.

    The damaged bag is not changed.

    Exit code 2 if nothing in it can be read.
    """
    from cmpsp_ros.bags import recover as rescue  # noqa: PLC0415 (starts faster without)

    with exit_on(BagError, code=2):
        found = rescue.recover(bag, output)
    for each in found.remarks:
        remark(each)
    count = f'{found.messages} messages of {found.topics} topics'
    say(f'{found.path}: {count}')


def play(
    bag: Annotated[Path, typer.Argument(help='Any bag.')],
    rate: Annotated[
        float, typer.Option(min=1e-3, max=1e3, help='Factor on the recorded speed.')
    ] = 1.0,
    start_offset: Annotated[
        float, typer.Option(min=0.0, metavar='SECONDS', help='Where to begin in the recording.')
    ] = 0.0,
    duration: Annotated[
        Optional[float],
        typer.Option(min=0.0, metavar='SECONDS', help='Length to play; all when absent.'),
    ] = None,
    loop: Annotated[bool, typer.Option('--loop', help='Repeat it.')] = False,
    paused: Annotated[
        bool, typer.Option('--paused', help='Wait for the space key, or the service ~/resume.')
    ] = False,
    topics: Annotated[
        Optional[list[str]],
        typer.Option('--topics', metavar='TOPIC', help='Only this; repeatable.'),
    ] = None,
    remap: Annotated[
        Optional[list[str]], typer.Option(metavar='OLD:=NEW', help='Another name; repeatable.')
    ] = None,
    namespace: Annotated[str, typer.Option(help='Of the live nodes, as in /r1.')] = '',
    odom: Annotated[
        str, typer.Option(metavar='TOPIC', help='Recorded odometry: played as <namespace>/odom.')
    ] = '',
    cmd_vel: Annotated[
        str, typer.Option(metavar='TOPIC', help='Recorded commands: played as <namespace>/cmd_vel.')
    ] = '',
) -> None:
    """Publish recorded topics to live nodes, with /clock.

    The live nodes need use_sim_time. The space key pauses. To test a guidance node on recorded
    odometry: --topics /odom
    """
    from cmpsp_ros.nodes import playback as player  # noqa: PLC0415 (needs ROS)

    playback = player.Playback(rate, start_offset, duration, loop, paused, tuple(topics or ()))
    with exit_on(BagError, code=2):
        place = namespace.rstrip('/')
        named = [
            f'{old}:={place}/{new}' for old, new in ((odom, 'odom'), (cmd_vel, 'cmd_vel')) if old
        ]
        code = player.play(bag, playback, [*(remap or ()), *named])
    raise typer.Exit(code)


def _unrecordable(
    folder: Path,
    storage: str,
    compression: str | None,
    topics: list[str] | None,
    *,
    everything: bool,
) -> str:
    if folder.exists():
        return f'{folder}: exists already, a new bag needs a path that does not exist'
    if storage != 'mcap' and compression == 'zstd':
        return f'--compression {compression}: only mcap can be compressed, not {storage}'
    if topics and everything:
        return '--all and --topic: wanted one or the other'
    return ''


def identify(
    bags: Annotated[
        Optional[list[Path]], typer.Argument(metavar='BAG...', help='Bags of one robot.')
    ] = None,
    drive: Annotated[
        bool, typer.Option('--drive', help='Drive the robot for 20 s first, and record it.')
    ] = False,
    yes: Annotated[bool, typer.Option('--yes', help='Drive without asking.')] = False,
    max_speed: Annotated[float, typer.Option(min=0.01, help='Limit of that drive [m/s].')] = 0.2,
    max_turn: Annotated[float, typer.Option(min=0.05, help='Limit of that drive [rad/s].')] = 1.0,
    robot: Annotated[
        Optional[str],
        typer.Option(metavar='NAME', help='What is known: of config/robots, or path of a file.'),
    ] = None,
    output: Annotated[
        Optional[Path],
        typer.Option(help='New folder; <BAG>_identified, or identified, when absent.'),
    ] = None,
    odom: Odom = None,
    cmd_vel: CmdVel = None,
    namespace: Namespace = None,
    force: Annotated[
        bool, typer.Option('--force', help='Replace an earlier identification.')
    ] = False,
) -> None:
    """Measure delay, lag, scales, limits and odometry of a robot.

    The bags may come from any program: odometry and commands suffice. With --drive it moves the
    robot itself, within 1 m of its position. It writes a parameter file and a picture.

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


def view(
    namespace: Annotated[str, typer.Option(help='Namespace of the nodes, as in /r1.')] = '',
    port: Annotated[int, typer.Option(min=0, max=65535, help='Port of the page; 0: any.')] = 8765,
    host: Annotated[
        str, typer.Option(help='Address to listen on; any other requires a token.')
    ] = '127.0.0.1',
) -> None:
    """Show a running system on a page for a browser.

    The page is live and works offline. Ends with SIGINT or SIGTERM.

    Exit code 2 if the page cannot be served.
    """
    from cmpsp_ros.nodes import viewer  # noqa: PLC0415 (loads ROS)

    if viewer.view(host, port, namespace):
        raise typer.Exit(2)
