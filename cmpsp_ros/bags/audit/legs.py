"""Legs of a recording, in which time does not jump back, with their commands, runs and paths."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import pairwise
from operator import attrgetter

import numpy as np

from cmpsp_ros.arrays import Array, BoolArray, IntArray
from cmpsp_ros.bags.audit.history import OTHER_CLOCK, History
from cmpsp_ros.bags.decision_record import DecisionRecord
from cmpsp_ros.bags.reader import Bag, Window
from cmpsp_ros.bags.runs.odometry import (
    Hole,
    OdometrySeries,
    holes,
    longest_interval,
    path_through,
    pieces,
)
from cmpsp_ros.bags.runs.run import DrivenPath
from cmpsp_ros.guidance import GuidanceSettings, to_nanoseconds
from cmpsp_ros.guidance.messages import Track
from cmpsp_ros.robots.motion import plain, with_side
from cmpsp_ros.sensing import stamp_of

_TWIST, _STAMPED = 'geometry_msgs/msg/Twist', 'geometry_msgs/msg/TwistStamped'

# Difference up to which a command is what a decision says [m/s, rad/s]: it is computed anew.
_SAME = 1e-9

_stamp = attrgetter('stamp')


@dataclass(frozen=True)
class Commands:
    """Velocity commands in the order in which they were received."""

    received: IntArray  # time of reception [ns], shape ``(C,)``
    stamps: IntArray  # stamp of the odometry that each is based on [ns], ``(C,)``; see `timed`
    twists: Array  # shape ``(C, 2)`` or ``(C, 3)``; see `Robot`
    stamped: bool  # true if the messages carried these stamps themselves

    def chosen(self, index: BoolArray) -> Commands:
        """Some of the commands."""
        return replace(
            self,
            received=self.received[index],
            stamps=self.stamps[index],
            twists=self.twists[index],
        )

    @property
    def moving(self) -> BoolArray:
        """True for commands other than a stop, shape ``(C,)``."""
        moving: BoolArray = np.any(self.twists != 0.0, axis=1)
        return moving


@dataclass(frozen=True)
class Pairs:
    """Consecutive commands, and the decisions that they were sent for."""

    commands: slice
    decisions: slice

    @property
    def count(self) -> int:
        """Number of pairs."""
        return int(self.commands.stop - self.commands.start)


def read_commands(bag: Bag, topic: str) -> Commands:
    """Commands of a topic, with the stamps that they carry or else the times of reception."""
    found = bag.topics[topic].msgtype
    if found not in {_TWIST, _STAMPED}:
        raise bag.error(f'found {found} in {topic}, wanted {_TWIST} or {_STAMPED} (--cmd-vel)')
    rows = []
    for received, message in bag.messages(topic):
        stamp, twist = received, message
        if found == _STAMPED:
            stamp, twist = stamp_of(message), message.twist
        rows.append((received, stamp, (twist.linear.x, twist.linear.y, twist.angular.z)))
    if not rows:
        raise bag.error(f'found no message in {topic}, wanted commands (--cmd-vel)')
    received_all, stamps, twists = zip(*rows, strict=True)
    return Commands(
        np.array(received_all, dtype=np.int64),
        np.array(stamps, dtype=np.int64),
        plain(np.array(twists, dtype=np.float64)),
        # Who leaves the stamp empty says nothing by it.
        found == _STAMPED and min(stamps) > 0,
    )


def pair(commands: Commands, decided: Array) -> Pairs:
    """Find for each command the decision ``(D, 2)`` or ``(D, 3)`` that it was sent for.

    If there are more of one kind, the recording missed some of the other at one end: at that
    where more then agree.
    """
    sent, wanted = len(commands.twists), len(decided)
    count = min(sent, wanted)
    ends = [
        Pairs(slice(0, count), slice(0, count)),
        Pairs(slice(sent - count, sent), slice(wanted - count, wanted)),
    ]
    return max(ends, key=lambda each: agreeing(commands, decided, each).sum())


def agreeing(commands: Commands, decided: Array, pairs: Pairs) -> BoolArray:
    """True for commands that equal those of their decisions, shape ``(count,)``."""
    sent = with_side(commands.twists)[pairs.commands]
    wanted = with_side(decided)[pairs.decisions]
    agree: BoolArray = np.all(np.abs(sent - wanted) <= _SAME, axis=1)
    return agree


def timed(
    commands: Commands, odometry: OdometrySeries, pairs: Pairs, decisions: Sequence[DecisionRecord]
) -> Commands:
    """Commands with the stamps of the odometry that they are based on: as stamped, or as decided.

    Any other is based on the latest odometry received by then, or sent as long before the first as
    it was received. Stamps later than that odometry are of another clock.
    """
    latest = np.searchsorted(odometry.received, commands.received, side='right') - 1
    stamps = odometry.stamps[np.maximum(latest, 0)]
    stamps = stamps + np.minimum(commands.received - odometry.received[0], 0)
    if commands.stamped and np.median(commands.stamps - stamps) <= OTHER_CLOCK:
        return commands
    answered = decisions[pairs.decisions]
    stamps[pairs.commands] = [each.stamp for each in answered]
    return replace(commands, stamps=stamps, stamped=False)


@dataclass(frozen=True)
class RunSpan:
    """One run: from its time 0 to that of the next, or to the end of the recording [ns]."""

    start: int
    end: int


@dataclass(frozen=True)
class KnownPath:
    """Driven path by one source, since a leg's first run."""

    by: str  # the source; empty for odometry
    pieces: tuple[DrivenPath, ...]
    holes: tuple[Hole, ...]
    tolerance: float = 0.0  # error of its clearance [m]
    off: float = 0.0  # largest distance from the true path [m]

    def at(self, stamp: int) -> Array | None:
        """Pose ``(3,)`` at an instant [ns]; None in a hole."""
        inside = (each for each in self.pieces if each.stamps[0] <= stamp <= each.stamps[-1])
        return next((each.at(stamp) for each in inside), None)


@dataclass(frozen=True)
class Leg:
    """Part of a recording in which time does not jump back."""

    odometry: OdometrySeries  # in order of time
    truth: OdometrySeries | None  # the true poses, in order of time; None without a simulator
    commands: Commands  # in order of time
    runs: tuple[RunSpan, ...]  # in order of time; none before the first command
    window: Window  # reception of its first odometry, and of that of the next leg [ns]
    history: History  # its parameters
    decisions: tuple[DecisionRecord, ...]  # none in the bag of another program
    tracks: tuple[Track, ...] = ()  # moving obstacles as received, by id and time
    people: tuple[Track, ...] = ()  # people in the simulator as they truly were, by id and time
    # Paths of the other robots to be avoided, by namespace.
    others: Mapping[str, DrivenPath] = field(default_factory=dict)

    @property
    def settings(self) -> GuidanceSettings:
        """In force at first."""
        return self.history.epochs[0].settings

    @cached_property
    def last_used(self) -> dict[tuple[int | str, int], int]:
        """Stamp of the last decision that used a track [ns], by its key."""
        return {key: each.stamp for each in self.decisions for key in each.tracks}

    @cached_property
    def people_stamps(self) -> IntArray:
        """Times at which people are known [ns]."""
        return np.unique(np.array([each.stamp for each in self.people], dtype=np.int64))

    @cached_property
    def moving(self) -> tuple[list[Track], list[Track]]:
        """Moving obstacles and people, in order of time."""
        return sorted(self.tracks, key=_stamp), sorted(self.people, key=_stamp)

    @cached_property
    def path(self) -> DrivenPath:
        """The path through all odometry."""
        return path_through(self.odometry)

    @cached_property
    def guided(self) -> DrivenPath:
        """The path since the beginning of the first run."""
        first = max(self.runs[0].start, int(self.path.stamps[0]))
        return self.path.between(first, int(self.path.stamps[-1]))

    @cached_property
    def arrivals(self) -> IntArray:
        """Times at which commands were received [ns], by the odometry received around them.

        So the recorder's clock may be any.
        """
        first, last = self.odometry.received[[0, -1]]
        return self.odometry.instants(np.clip(self.commands.received, first, last))

    @cached_property
    def by_odometry(self) -> KnownPath:
        """The path by odometry; beside a true path its covariance does not count as contact."""
        off, stamps = 0.0, self.path.stamps
        for part in () if self.true is None else self.true.pieces:
            both = (stamps >= part.stamps[0]) & (stamps <= part.stamps[-1])
            away = (self.path.poses[both] - part.at_all(stamps[both]))[:, :2]
            off = max(off, float(np.hypot(*away.T).max(initial=0.0)))
        spread = 3.0 * float(self.odometry.spreads[:, 0].max())
        return self._known('', self.path, 0.0 if self.true is None else spread, off)

    @cached_property
    def true(self) -> KnownPath | None:
        """The true path; None without a simulator."""
        if self.truth is None:
            return None
        return self._known('the true path', path_through(self.truth))

    @cached_property
    def known(self) -> tuple[KnownPath, ...]:
        """The path by each source, the best first."""
        if self.true is None:
            return (self.by_odometry,)
        # In its holes nothing says how far odometry is off.
        alone = tuple(
            part.between(max(hole.begin, int(part.stamps[0])), min(hole.end, int(part.stamps[-1])))
            for hole in self.true.holes
            for part in self.by_odometry.pieces
            if hole.begin < part.stamps[-1] and part.stamps[0] < hole.end
        )
        return (self.true, self.by_odometry, replace(self.by_odometry, pieces=alone, tolerance=0.0))

    @cached_property
    def holes(self) -> tuple[Hole, ...]:
        """When no source knows the path."""
        if self.truth is None:
            return self.by_odometry.holes
        stamps = np.union1d(self.odometry.stamps, self.truth.stamps)
        longest = longest_interval(self.odometry.stamps, self.settings)
        return holes(stamps, self.runs[0].start, self.runs[-1].end, longest)

    def _known(
        self, by: str, path: DrivenPath, tolerance: float = 0.0, off: float = 0.0
    ) -> KnownPath:
        begin, end = self.runs[0].start, self.runs[-1].end
        longest = longest_interval(path.stamps, self.settings)
        return KnownPath(
            by,
            tuple(pieces(path, begin, end, longest)),
            holes(path.stamps, begin, end, longest),
            tolerance,
            off,
        )


def split(
    odometry: OdometrySeries,
    truth: OdometrySeries | None,
    commands: Commands,
    decisions: Sequence[DecisionRecord],
    history: History,
) -> Iterator[Leg]:
    """The legs of a recording; arguments as of `AuditRecord`."""
    parts = odometry.legs(history.epochs[0].settings.odom_timeout)
    begins = [int(each.received[0]) for each in parts]
    windows = zip([0, *begins[1:]], [*begins[1:], math.inf], strict=True)
    for each, (begin, end) in zip(parts, windows, strict=True):
        some = commands.chosen((commands.received >= begin) & (commands.received < end))
        inside = [one for one in decisions if begin <= one.received < end]
        if len(some.stamps) and each.stamps[-1] > each.stamps[0]:
            true = None if truth is None else truth.received_within(begin, end)
            last = int(max(each.stamps[-1], 0 if true is None else true.stamps[-1]))
            own = history.within((begin, end), each)
            runs = _runs(some, inside, last, own.epochs[0].settings)
            yield Leg(each, true, some, runs, (begin, end), own, tuple(inside))


def _runs(
    commands: Commands, decisions: Sequence[DecisionRecord], end: int, settings: GuidanceSettings
) -> tuple[RunSpan, ...]:
    answers = [each for each in decisions if not each.halted]
    starts = [_begin_of(answers[0], settings)] if answers else [int(commands.stamps[0])]
    for before, after in pairwise(answers):
        if after.run != before.run or after.step < before.step:
            starts.append(after.stamp)
    starts = sorted({min(start, end) for start in starts})
    return tuple(
        RunSpan(start, stop) for start, stop in zip(starts, [*starts[1:], end], strict=True)
    )


def _begin_of(first: DecisionRecord, settings: GuidanceSettings) -> int:
    """Time 0 [ns] of a run whose first decisions may be missing."""
    elapsed: float = first.step * settings.control_period
    goal, left = first.goal, first.time_left
    if first.step and goal is not None and 0.0 < left < math.inf:
        # The time that is left is that to the last goal.
        elapsed = max(goal.time, 0.0 if first.goals_received else settings.final_time) - left
    return max(int(first.stamp) - to_nanoseconds(elapsed), 0)
