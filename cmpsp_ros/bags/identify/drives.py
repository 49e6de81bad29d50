"""Commands and odometry of a recorded drive, whoever recorded it."""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from cmpsp_ros.arrays import Array, BoolArray, IntArray
from cmpsp_ros.bags.audit.legs import Commands, read_commands
from cmpsp_ros.bags.audit.sources import Sources
from cmpsp_ros.bags.decision_record import read_decisions
from cmpsp_ros.bags.names import Names
from cmpsp_ros.bags.reader import Bag
from cmpsp_ros.bags.runs.odometry import OdometrySeries, arc_steps, read_odometry
from cmpsp_ros.guidance import NANOSECONDS
from cmpsp_ros.robots.motion import with_side

# Usual times after which robots stop without a command [s].
TIMEOUTS: Final = (math.inf, 0.2, 0.25, 0.5, 0.6, 1.0)
_ODOMETRY: Final = 'nav_msgs/msg/Odometry'
_TWIST: Final = 'geometry_msgs/msg/Twist'
_STAMPED: Final = 'geometry_msgs/msg/TwistStamped'

_SHORTEST: Final = 3.0  # shortest drive that is used [s]
_BACKWARDS: Final = 1.0  # smallest step back of odometry's clock that begins another drive [s]
_FASTEST: Final = 1e3  # commands above it are ignored, as NaN is [m/s] or [rad/s]
# Speeds above which a robot counts as moving before its first command [m/s, rad/s].
_MOVING: Final = (0.05, 0.1)


@dataclass(frozen=True)
class Series:
    """Steps of a drive along one axis, 0 ahead or 1 turning, and the command there."""

    axis: int
    stamps: Array  # of odometry, ``(N + 1,)`` [s]
    steps: Array  # change between messages, ``(N,)`` [m] or [rad]
    changes: Array  # times of the changes of the command, ``(C,)`` [s]
    commands: Array  # from then on, ``(C,)`` [m/s] or [rad/s]

    @property
    def command(self) -> tuple[Array, Array]:
        """Changes and commands."""
        return self.changes, self.commands

    @property
    def leaps(self) -> BoolArray:
        """Steps that no command explains: odometry has jumped."""
        fastest = np.abs(self.commands).max()
        return np.asarray(np.abs(self.steps) > 5.0 * fastest * np.diff(self.stamps) + 0.1)


@dataclass(frozen=True)
class Drive:
    """A drive without a jump in time; all times are odometry's stamps since its first one."""

    label: str  # bag and topics
    stamped: bool  # true if commands were TwistStamped
    stamps: Array  # of odometry, ``(N + 1,)`` [s]
    steps: Array  # change between messages: distance ahead and turn, ``(N, 2)`` [m, rad]
    ages: Array  # time of reception of each odometry message minus its stamp, ``(N + 1,)`` [s]
    times: Array  # when commands were received, less the median of `ages`, ``(C,)`` [s]
    commands: Array  # speed and turn rate, ``(C, 2)`` [m/s, rad/s]
    # Median of `times` minus the stamp of the odometry that the command answers [s]; None if the
    # bag does not have it.
    answer: float | None

    @property
    def age(self) -> float:
        """Median age of odometry [s]."""
        return float(np.median(self.ages))

    @property
    def pauses(self) -> bool:
        """True if a robot may have stopped on its own between two commands."""
        return bool((self.commands[:-1].any(axis=1) & (np.diff(self.times) > TIMEOUTS[1])).any())

    def series(self, axis: int, timeout: float) -> Series:
        """Steps along an axis, of a robot that stops so long after a command [s]."""
        expired = self.times + timeout < np.append(self.times[1:], np.inf)
        times = np.append(self.times, self.times[expired] + timeout)
        values = np.append(self.commands[:, axis], np.zeros(expired.sum()))
        order = np.argsort(times, kind='stable')
        # The first change is to the speed at which odometry begins.
        before = self.stamps[1:] < times.min()
        speed = self.steps[before, axis].sum() / max(self.stamps[1:][before], default=1.0)
        first = speed if abs(speed) > _MOVING[axis] else 0.0
        times = np.append(times.min() - 1e-3, times[order])
        values = np.append(first, values[order])
        differs = np.append(True, np.diff(values) != 0.0)
        return Series(axis, self.stamps, self.steps[:, axis], times[differs], values[differs])


def read_drives(path: Path, sources: Sources) -> tuple[list[Drive], dict[str, Any]]:
    """Read all drives of a bag, and the parameters of a guidance node if it has them."""
    with Bag(path) as bag:
        odom = _topic(bag, sources.odom, (_ODOMETRY,), 'odom', sources.namespace)
        space = odom.rpartition('/')[0] if sources.namespace is None else sources.namespace
        cmd_vel = _topic(bag, sources.cmd_vel, (_TWIST, _STAMPED), 'cmd_vel', space)
        odometry, commands = read_odometry(bag, odom, None), read_commands(bag, cmd_vel)
        names = Names.under(cmd_vel.rpartition('/')[0])
        answered = _answered(bag, names, commands, odometry)
        label = f'{path}: {odom}, {cmd_vel}'
        stamped = bag.topics[cmd_vel].msgtype == _STAMPED
        drives = list(_drives(label, stamped, odometry, commands, answered))
        if not drives:
            raise bag.error(
                f'found {np.ptp(odometry.stamps) / NANOSECONDS:.1f} s of {odom} and'
                f' {len(commands.stamps)} commands of {cmd_vel}, wanted {_SHORTEST:g} s or more,'
                ' with two commands or more'
            )
        return drives, bag.parameters.get(names.node, {})


def _topic(
    bag: Bag, name: str | None, types: tuple[str, ...], usual: str, space: str | None
) -> str:
    """The topic that is named, or the only one of these types, or the one of the usual name."""
    # No robot knows the truth of a simulator.
    there = [
        topic
        for topic, each in sorted(bag.topics.items())
        if each.count and each.msgtype in types and not topic.endswith('/sim/truth')
    ]
    option, kinds = f'--{usual.replace("_", "-")}', ' or '.join(types)
    if name is not None or not there:
        if name in there:
            return str(name)
        found = f'in {name}' if name else 'in any topic'
        wanted = f'wanted one of {", ".join(there)}' if there else 'wanted a drive'
        raise bag.error(f'found no {kinds} {found}, {wanted} ({option})')
    exact = [each for each in there if space is not None and each == f'{space.rstrip("/")}/{usual}']
    alike = [each for each in there if each.rpartition('/')[2] == usual]
    for candidates in (exact, alike, there):
        if len(candidates) == 1:
            return candidates[0]
    raise bag.error(f'found {", ".join(there)}, wanted those of one robot ({option})')


def _answered(
    bag: Bag, names: Names, commands: Commands, odometry: OdometrySeries
) -> IntArray | None:
    """Stamp of the odometry that each command answers [ns]; None if the bag does not have it."""
    if commands.stamped and np.isin(commands.stamps, odometry.stamps).mean() > 0.9:
        return commands.stamps
    decisions = [each for each in read_decisions(bag, names.decision) if not each.late]
    if not decisions:
        return None
    received = np.array([each.received for each in decisions], dtype=np.int64)
    nearest = np.searchsorted(received[:-1] + np.diff(received) // 2, commands.received)
    return np.array([each.stamp for each in decisions], dtype=np.int64)[nearest]


def _drives(
    label: str,
    stamped: bool,
    odometry: OdometrySeries,
    commands: Commands,
    answered: IntArray | None,
) -> Iterator[Drive]:
    legs = odometry.legs(_BACKWARDS)
    begins = [0, *(int(leg.received[0]) for leg in legs[1:])]
    possible = (np.abs(commands.twists) < _FASTEST).all(axis=1)
    for leg, begin, end in zip(legs, begins, [*begins[1:], 1 << 62], strict=True):
        inside = possible & (commands.received >= begin) & (commands.received < end)
        kept = np.append(True, np.diff(leg.stamps) > 0)
        stamps, poses, ages = leg.stamps[kept], leg.poses[kept], leg.received - leg.stamps
        if inside.sum() < 2 or np.ptp(stamps) < _SHORTEST * NANOSECONDS:
            continue
        received = commands.received[inside] - int(np.median(ages))
        answer = None if answered is None else float(np.median(received - answered[inside]))
        yield Drive(
            label,
            stamped,
            (stamps - stamps[0]) / NANOSECONDS,
            arc_steps(poses[:-1], poses[1:])[:, [0, 2]],
            ages / NANOSECONDS,
            (received - stamps[0]) / NANOSECONDS,
            with_side(commands.twists[inside])[:, [0, 2]],
            None if answer is None else answer / NANOSECONDS,
        )
