"""Commands and odometry of a recorded drive, whoever recorded it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from cmpsp_ros.bags.audit.commands import Commands, read_commands
from cmpsp_ros.bags.audit.odometry import OdometrySeries, read_odometry
from cmpsp_ros.bags.audit.sources import Sources
from cmpsp_ros.bags.decision_record import read_decisions
from cmpsp_ros.bags.errors import BagError
from cmpsp_ros.bags.names import Names
from cmpsp_ros.bags.reader import Bag
from cmpsp_ros.guidance.horizon import NANOSECONDS
from cmpsp_ros.robots.arcs import with_side

Array = NDArray[np.float64]

_ODOMETRY: Final = frozenset({'nav_msgs/msg/Odometry'})
_STAMPED: Final = 'geometry_msgs/msg/TwistStamped'
_COMMANDS: Final = frozenset({'geometry_msgs/msg/Twist', _STAMPED})

_SHORTEST: Final = 3.0
"""Shortest drive that is used [s]."""

_BACKWARDS: Final = 1.0
"""Smallest step back of odometry's clock that begins another drive [s]."""


@dataclass(frozen=True)
class Drive:
    """A drive without a jump in time; all times are odometry's stamps since its first one.

    Attributes:
        label: Bag and topics.
        stamps: Of odometry, ``(N + 1,)`` [s].
        steps: From one message to the next: distance ahead and turn, ``(N, 2)`` [m, rad].
        times: When commands were received, ``(C,)`` [s]; see `age`.
        commands: Speed and turn rate, ``(C, 2)`` [m/s, rad/s].
        ages: Time of reception of each odometry message minus its stamp, ``(N + 1,)`` [s].
        age: Their median, by which `times` are mapped to odometry's clock [s].
        answer: Mean time from the stamp of the odometry that a command answers to its reception,
            by odometry's clock [s]; None where the bag does not say what commands answer.
        stamped: Whether commands were TwistStamped.
    """

    label: str
    stamps: Array
    steps: Array
    times: Array
    commands: Array
    ages: Array
    age: float
    answer: float | None
    stamped: bool

    def changes(self, axis: int, timeout: float) -> tuple[Array, Array]:
        """Times and values of the changes of a command, of a robot that stops after a timeout [s].

        The first one, at the first command, is the steady speed at which odometry begins.
        """
        ends = np.append(self.times[1:], np.inf)
        expired = self.times + timeout < ends
        times = np.concatenate([self.times, self.times[expired] + timeout])
        values = np.append(self.commands[:, axis], np.zeros(expired.sum()))
        order = np.argsort(times, kind='stable')
        times, values = times[order], values[order]
        differs = np.append(True, np.diff(values) != 0.0)
        begin = times[0] - 1e-3
        return np.append(begin, times[differs]), np.append(self._first[axis], values[differs])

    @property
    def _first(self) -> Array:
        """Speeds before the first command, if there was odometry then; else 0, ``(2,)``."""
        before = self.stamps[1:] < self.times[0]
        if not before.any():
            return np.zeros(2)
        speeds: Array = self.steps[before].sum(axis=0) / self.stamps[1:][before][-1]
        return np.where(np.abs(speeds) > _MOVING, speeds, 0.0)


_MOVING: Final = np.array([0.05, 0.1])
"""Speeds above which a robot counts as moving before its first command [m/s, rad/s]."""


def read_drives(path: Path, sources: Sources) -> tuple[list[Drive], dict[str, Any]]:
    """Read all drives of a bag, and the parameters of a guidance node if it has them.

    Raises:
        BagError: Not a bag, no odometry or no commands, those of several robots, or too short.
    """
    with Bag(path) as bag:
        odom, cmd_vel = topics_in(bag, sources)
        odometry = read_odometry(bag, odom, None)
        commands = read_commands(bag, cmd_vel)
        names = Names.under(cmd_vel.rpartition('/')[0])
        answered = _answered(bag, names, commands, odometry)
        parameters = bag.parameters.get(names.node, {})
        stamped = bag.topics[cmd_vel].msgtype == _STAMPED
    label = f'{path}: {odom}, {cmd_vel}'
    legs = odometry.legs(_BACKWARDS)
    drives = list(_drives(label, legs, commands, stamped, answered))
    if not drives:
        longest = max(float(np.ptp(each.stamps)) for each in legs) / NANOSECONDS
        raise BagError(
            f'{path}: found {longest:.1f} s of {odom} with {len(commands.stamps)} commands of'
            f' {cmd_vel}, wanted {_SHORTEST:g} s or more with two or more commands'
        )
    return drives, parameters


def topics_in(bag: Bag, sources: Sources) -> tuple[str, str]:
    """Odometry and commands of a bag: those that are named, or the only ones there are."""
    odom = _topic(bag, sources.odom, _ODOMETRY, 'odom', '--odom', sources.namespace)
    space = odom.rpartition('/')[0] if sources.namespace is None else sources.namespace
    return odom, _topic(bag, sources.cmd_vel, _COMMANDS, 'cmd_vel', '--cmd-vel', space)


def _topic(
    bag: Bag, name: str | None, types: frozenset[str], usual: str, option: str, space: str | None
) -> str:
    there = {
        topic: each.msgtype
        for topic, each in bag.topics.items()
        # The truth of a simulator is what no robot knows.
        if each.count and each.msgtype in types and not topic.endswith('/sim/truth')
    }
    if name is not None and name in there:
        return name
    listed = ', '.join(sorted(there)) or 'none in it'
    kinds = ' or '.join(sorted(types))
    if name is not None or not there:
        found = f'no message of {kinds}' + (f' in {name}' if name else '')
        raise BagError(
            f'{bag.path}: found {found}, wanted a topic of that type: {listed} ({option})'
        )
    for candidates in (
        [each for each in there if space is not None and each == f'{space.rstrip("/")}/{usual}'],
        [each for each in there if each.rpartition('/')[2] == usual],
        list(there),
    ):
        if len(candidates) == 1:
            return candidates[0]
    raise BagError(
        f'{bag.path}: found {listed}, wanted one robot: choose it by its topic ({option})'
    )


def _answered(
    bag: Bag, names: Names, commands: Commands, odometry: OdometrySeries
) -> NDArray[np.int64] | None:
    """Stamp of the odometry that each command answers [ns]; None if the bag does not say."""
    if commands.stamped and np.isin(commands.stamps, odometry.stamps).mean() > 0.9:
        return commands.stamps
    decisions = [each for each in read_decisions(bag, names.decision) if not each.late]
    if not decisions:
        return None
    received = np.array([each.received for each in decisions], dtype=np.int64)
    middles = received[:-1] + np.diff(received) // 2
    nearest = np.searchsorted(middles, commands.received)
    return np.array([each.stamp for each in decisions], dtype=np.int64)[nearest]


def _drives(
    label: str,
    legs: Sequence[OdometrySeries],
    commands: Commands,
    stamped: bool,
    answered: NDArray[np.int64] | None,
) -> Iterator[Drive]:
    begins = [int(leg.received[0]) for leg in legs]
    for leg, begin, end in zip(legs, begins, [*begins[1:], None], strict=True):
        inside = commands.received >= (begin if begin != begins[0] else 0)
        if end is not None:
            inside &= commands.received < end
        kept = np.append(True, np.diff(leg.stamps) > 0)
        stamps, poses = leg.stamps[kept], leg.poses[kept]
        if inside.sum() < 2 or np.ptp(stamps) < _SHORTEST * NANOSECONDS:
            continue
        ages = leg.received - leg.stamps
        age = int(np.median(ages))
        times = (commands.received[inside] - age - stamps[0]) / NANOSECONDS
        twists = with_side(commands.twists[inside])
        answer = None
        if answered is not None:
            answer = float((commands.received - answered)[inside].mean() - age) / NANOSECONDS
        yield Drive(
            label,
            (stamps - stamps[0]) / NANOSECONDS,
            _steps(poses),
            times,
            twists[:, [0, 2]],
            ages / NANOSECONDS,
            age / NANOSECONDS,
            answer,
            stamped,
        )


def _steps(poses: Array) -> Array:
    """Distance ahead and turn between poses, along arcs, ``(N, 2)`` [m, rad]."""
    (dx, dy, turn) = np.diff(poses, axis=0).T
    turn = np.remainder(turn + np.pi, 2.0 * np.pi) - np.pi
    along = poses[:-1, 2] + turn / 2.0
    chord = dx * np.cos(along) + dy * np.sin(along)
    return np.column_stack([chord / np.sinc(turn / (2.0 * np.pi)), turn])
