"""The data of an audit: odometry, commands, parameters and decisions of a recording."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from pathlib import Path

from cmpsp_ros.bags.audit.clearance import Sweep, sweep
from cmpsp_ros.bags.audit.commands import Commands, Pairs, pair, read_commands, timed
from cmpsp_ros.bags.audit.history import History, read_history
from cmpsp_ros.bags.audit.odometry import OdometrySeries, path_through, read_odometry
from cmpsp_ros.bags.audit.sources import Sources, find
from cmpsp_ros.bags.decision_record import DecisionRecord, read_decisions, wheel_speeds
from cmpsp_ros.bags.errors import BagError
from cmpsp_ros.bags.names import Names
from cmpsp_ros.bags.reader import Bag
from cmpsp_ros.bags.runs.encounters import Encounter, encounters, read_others, robot_encounters
from cmpsp_ros.bags.runs.run import Driven
from cmpsp_ros.bags.runs.tracks import read_tracks
from cmpsp_ros.guidance.horizon import NANOSECONDS
from cmpsp_ros.guidance.messages.tracks import Track


@dataclass(frozen=True)
class RunSpan:
    """One run: from a time 0 to the next.

    Attributes:
        start: Time 0 [ns].
        end: Beginning of the next run, or end of the recording [ns].
    """

    start: int
    end: int


@dataclass(frozen=True)
class Leg:
    """Part of a recording in which time does not jump back.

    Attributes:
        odometry: In order of time.
        commands: In order of time.
        runs: In order of time; none before the first command.
    """

    odometry: OdometrySeries
    commands: Commands
    runs: tuple[RunSpan, ...]

    @cached_property
    def path(self) -> Driven:
        """The path through all odometry."""
        return path_through(self.odometry)

    @cached_property
    def guided(self) -> Driven:
        """The path since the beginning of the first run."""
        first = max(self.runs[0].start, int(self.path.stamps[0]))
        return self.path.between(first, int(self.path.stamps[-1]))


@dataclass(frozen=True)
class AuditRecord:
    """The data of an audit.

    Attributes:
        path: The bag.
        places: Names of the topics read.
        history: Parameters over time.
        odometry: All odometry.
        commands: All commands.
        decisions: All decisions; none in the bag of another program.
        tracks: Moving obstacles as received, by id and time.
        others: Paths of the other robots to be avoided, by namespace.
        pairs: Pairs of commands and decisions.
        legs: Parts in which time does not jump back and commands were sent.
    """

    path: Path
    places: Names
    history: History
    odometry: OdometrySeries
    commands: Commands
    decisions: tuple[DecisionRecord, ...]
    tracks: tuple[Track, ...]
    others: Mapping[str, Driven]
    pairs: Pairs
    legs: tuple[Leg, ...]

    @cached_property
    def sweeps(self) -> tuple[Sweep, ...]:
        """The path driven since the beginning of each leg's first run, with its clearance."""
        return tuple(each for leg in self.legs for each in sweep(leg.guided, self.history))

    @cached_property
    def encounters(self) -> tuple[Encounter, ...]:
        """The same path, with the moving obstacles at their predicted positions."""
        settings = self.history.epochs[0].settings
        around = settings.bodies, settings.moving_obstacles.timeout
        paths = (leg.guided for leg in self.legs)
        return tuple(each for path in paths for each in encounters(path, self.tracks, *around))

    @cached_property
    def robot_encounters(self) -> tuple[Encounter, ...]:
        """The same path, with the positions of the other robots at that time."""
        settings = self.history.epochs[0].settings
        known = settings.moving_obstacles
        around = known.others_radius, settings.bodies, known.timeout
        paths = (leg.guided for leg in self.legs)
        return tuple(
            each for path in paths for each in robot_encounters(path, self.others, *around)
        )

    @property
    def start(self) -> int:
        """Time 0 of the first run [ns]."""
        return self.legs[0].runs[0].start

    @property
    def end(self) -> float:
        """Time of the last odometry since then [s]."""
        return self.seconds(int(self.legs[-1].odometry.stamps[-1]))

    def seconds(self, stamp: int) -> float:
        """Time since then [s]."""
        return (stamp - self.start) / NANOSECONDS


def read_record(path: Path, sources: Sources | None = None) -> AuditRecord:
    """Read what is audited.

    Raises:
        BagError: Not a bag, a topic is missing, or what is in it cannot be used.
        ParameterError: The parameters cannot be used.
    """
    sources = sources or Sources()
    with Bag(path) as bag:
        try:
            return _record(bag, sources)
        except OverflowError as error:
            raise BagError(f'{path}: found times that no clock can have: {error}') from error


def _record(bag: Bag, sources: Sources) -> AuditRecord:
    places = find(bag, sources)
    history = read_history(bag, places, sources)
    settings = history.epochs[0].settings
    frame_id = settings.frame_id if 'frame_id' in history.given else None
    odometry = read_odometry(bag, places.odom, frame_id)
    commands = read_commands(bag, places.cmd_vel)
    # Of those that came too late no command was sent.
    decisions = tuple(each for each in read_decisions(bag, places.decision) if not each.late)
    decided = settings.robot.twist_of_wheels(wheel_speeds(decisions))
    pairs = pair(commands, decided)
    commands = timed(commands, odometry, pairs, decisions)
    legs = tuple(_legs(odometry.legs(settings.odom_timeout), commands, decisions))
    if not legs:
        raise BagError(
            f'{bag.path}: found no two messages of {places.odom} around any of {places.cmd_vel},'
            ' wanted a drive'
        )
    moving = bag.as_decided_on(places.node, 'moving_obstacles')
    tracks = read_tracks(bag, moving, frame_id)
    own = places.node.rpartition('/')[0]
    others = read_others(bag, settings.moving_obstacles.others, own)
    return AuditRecord(
        bag.path, places, history, odometry, commands, decisions, tracks, others, pairs, legs
    )


def _legs(
    odometry: Sequence[OdometrySeries], commands: Commands, decisions: Sequence[DecisionRecord]
) -> list[Leg]:
    begins = [int(each.received[0]) for each in odometry]
    legs = []
    for each, begin, end in zip(odometry, [0, *begins[1:]], [*begins[1:], None], strict=True):
        inside = commands.received >= begin
        if end is not None:
            inside &= commands.received < end
        some = commands.chosen(inside)
        inside_leg = [one for one in decisions if one.received >= begin]
        inside_leg = [one for one in inside_leg if end is None or one.received < end]
        if len(some.stamps) and each.stamps[-1] > each.stamps[0]:
            legs.append(Leg(each, some, _runs(some, inside_leg, int(each.stamps[-1]))))
    return legs


def _runs(commands: Commands, decisions: Sequence[DecisionRecord], end: int) -> tuple[RunSpan, ...]:
    """Time 0 of a run is the stamp of its first odometry, which is decided on at once."""
    answers = [each for each in decisions if not each.halted]
    starts = [answers[0].stamp] if answers else [int(commands.stamps[0])]
    for before, after in pairwise(answers):
        if after.run != before.run or after.step < before.step:
            starts.append(after.stamp)
    starts = sorted({min(start, end) for start in starts})
    return tuple(
        RunSpan(start, stop) for start, stop in zip(starts, [*starts[1:], end], strict=True)
    )
