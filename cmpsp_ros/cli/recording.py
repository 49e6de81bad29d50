"""`cmpsp record`, `recover` and `play`: from a running system into a bag, and back."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Annotated, Literal

import typer

from cmpsp_ros.bags import BagError
from cmpsp_ros.cli.terminal import complain, errors, exit_on, say


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
        Literal['none', 'zstd'] | None,
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
    end it says which messages came too fast to be recorded. Exit code 2 if recording ended by
    itself.
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
        'storage': storage,
        **({'compression': compression} if compression else {}),
        'split_size': split_size,
        'split_duration': split_duration,
        'use_sim_time': use_sim_time,
    }
    if recorder.record(parameters, namespace):
        raise typer.Exit(2)


def recover(
    bag: Annotated[Path, typer.Argument(help='Bag that was cut off, or one of its files.')],
    output: Annotated[
        Path | None, typer.Option(help='New folder; <BAG>_recovered when absent.')
    ] = None,
) -> None:
    """Make a valid bag from one whose recorder was killed.

    The damaged bag is not changed.

    Exit code 2 if nothing in it can be read.
    """
    from cmpsp_ros.bags import recover as rescue  # noqa: PLC0415 (starts faster without)

    with exit_on(BagError, code=2):
        found = rescue.recover(bag, output)
    for each in found.remarks:
        errors().print(each, markup=False, highlight=False, soft_wrap=True)
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
        float | None,
        typer.Option(min=0.0, metavar='SECONDS', help='Length to play; all when absent.'),
    ] = None,
    loop: Annotated[bool, typer.Option('--loop', help='Repeat it.')] = False,
    paused: Annotated[
        bool, typer.Option('--paused', help='Wait for the space key, or the service ~/resume.')
    ] = False,
    topics: Annotated[
        list[str] | None, typer.Option('--topics', metavar='TOPIC', help='Only this; repeatable.')
    ] = None,
    remap: Annotated[
        list[str] | None, typer.Option(metavar='OLD:=NEW', help='Another name; repeatable.')
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
    """Why this cannot be recorded; empty if it can."""
    if folder.exists():
        return f'{folder}: exists already, a new bag needs a path that does not exist'
    if storage != 'mcap' and compression == 'zstd':
        return f'--compression {compression}: only mcap can be compressed, not {storage}'
    if topics and everything:
        return '--all and --topic: wanted one or the other'
    return ''
