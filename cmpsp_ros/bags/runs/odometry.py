"""Recorded odometry: the path through it, and the holes in it."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cmpsp_ros.arrays import Array, IntArray
from cmpsp_ros.bags.reader import Bag
from cmpsp_ros.bags.runs.run import DrivenPath
from cmpsp_ros.guidance import NANOSECONDS, GuidanceSettings
from cmpsp_ros.guidance.messages import OdometryError, OdometryReading
from cmpsp_ros.sensing import stamp_of

_LOST: Final = 3.0  # median intervals between two messages from which on some are missing


class Hole(NamedTuple):
    """Time between two poses that are known, by their stamps [ns]."""

    begin: int
    end: int


def longest_interval(stamps: IntArray, settings: GuidanceSettings) -> int:
    """Longest time between two messages that is no hole [ns].

    Three median intervals, or a control period (`odom_timeout` where that is shorter) if that is
    longer: the robot then follows at most two commands, and an arc between the two poses is near.
    """
    intervals = np.diff(stamps)
    later = intervals[intervals > 0]
    median = float(np.median(later)) if len(later) else 0.0
    held = min(settings.control_period, settings.odom_timeout) * NANOSECONDS
    # Half a message interval more: a stamp may lie a little beside the grid of control instants.
    return round(max(_LOST * median, held + 0.5 * min(median, held)))


def holes(stamps: IntArray, begin: int, end: int, longest: float) -> tuple[Hole, ...]:
    """Holes between two instants [ns], by ascending stamps of a path."""
    inside = stamps[(stamps > begin) & (stamps < end)]
    edges = np.concatenate([[begin], inside, [end]])
    return tuple(Hole(int(edges[k]), int(edges[k + 1])) for k in _long(edges, longest))


def is_within(stamp: int, found: Iterable[Hole]) -> bool:
    """True if nothing is known at an instant [ns]."""
    return any(each.begin < stamp < each.end for each in found)


def overlaps(span: tuple[int, int], found: Iterable[Hole]) -> bool:
    """True if a time between two instants [ns] has a part in a hole."""
    return any(span[0] < each.end and each.begin < span[1] for each in found)


def pieces(path: DrivenPath, begin: int, end: int, longest: int) -> Iterator[DrivenPath]:
    """The parts of a path between two instants [ns] that have no hole."""
    for part in np.split(np.arange(len(path.stamps)), _long(path.stamps, longest) + 1):
        first, last = max(begin, int(path.stamps[part[0]])), min(end, int(path.stamps[part[-1]]))
        if first < last:
            yield path.chosen(part).between(first, last)
        elif first == last:
            # A pose alone, as an arc of no length.
            poses, twists = np.repeat(path.at(first)[None], 2, axis=0), np.zeros((2, 2))
            yield DrivenPath(np.array([first, first + 1]), poses, twists)


def in_words(found: Sequence[Hole], start: int) -> str:
    """When each is, in seconds since a time [ns]."""
    times = [
        f'from {(each.begin - start) / NANOSECONDS:.2f} to'
        f' {(each.end - start) / NANOSECONDS:.2f} s ({(each.end - each.begin) / NANOSECONDS:.2f} s)'
        for each in found[:_MOST_NAMED]
    ]
    more = len(found) - len(times)
    return ', '.join(times) + (f' and {more} times more' if more else '')


_MOST_NAMED: Final = 3


def _long(stamps: IntArray, longest: float) -> NDArray[np.intp]:
    return np.flatnonzero(np.diff(stamps) > longest)


_TYPE = 'nav_msgs/msg/Odometry'


@dataclass(frozen=True)
class OdometrySeries:
    """Odometry in the order in which it was received."""

    received: IntArray  # time of reception [ns], shape ``(K,)``
    stamps: IntArray  # time stamps [ns], shape ``(K,)``
    poses: Array  # shape ``(K, 3)`` [m, m, rad]
    spreads: Array  # stated standard deviations of position and heading, ``(K, 2)`` [m, rad]

    def legs(self, backwards: float) -> list[OdometrySeries]:
        """Parts in which time does not jump back by more than so much [s], or is out of order."""
        jumps = np.flatnonzero(np.diff(self.stamps) < -backwards * NANOSECONDS) + 1
        legs = []
        for leg in np.split(np.arange(len(self.stamps)), jumps):
            stamps = self.stamps[leg]
            legs.append(self._part(leg[stamps >= np.maximum.accumulate(stamps)]))
        return legs

    def received_within(self, begin: float, end: float) -> OdometrySeries | None:
        """Messages received between two times [ns], by ascending stamps; None for nothing."""
        inside = np.flatnonzero((self.received >= begin) & (self.received < end))
        return self._part(inside).by_stamp if len(inside) else None

    def instants(self, received: IntArray) -> IntArray:
        """Stamps ``(M,)`` of times of reception [ns], by the messages received around them.

        So the recorder's clock may be any; before the first message and after the last it counts.
        """
        since = np.interp(received, self.received, self.stamps - self.stamps[0])
        beyond = received - np.clip(received, self.received[0], self.received[-1])
        return np.asarray(self.stamps[0] + since.astype(np.int64) + beyond)

    @property
    def by_stamp(self) -> OdometrySeries:
        """The same by ascending stamps."""
        return self._part(np.argsort(self.stamps, kind='stable'))

    def _part(self, chosen: NDArray[np.intp]) -> OdometrySeries:
        return OdometrySeries(
            self.received[chosen], self.stamps[chosen], self.poses[chosen], self.spreads[chosen]
        )


def read_odometry(bag: Bag, topic: str, frame_id: str | None) -> OdometrySeries:
    """Odometry of a topic, in a frame or in any."""
    found = bag.topics[topic].msgtype
    if found != _TYPE:
        raise bag.error(f'found {found} in {topic}, wanted {_TYPE} (--odom)')
    rows = list(_rows(bag, topic, frame_id))
    if not rows:
        raise bag.error(f'found no message in {topic}, wanted odometry (--odom)')
    received, stamps, figures = zip(*rows, strict=True)
    table = np.array(figures)
    return OdometrySeries(
        np.array(received, dtype=np.int64),
        np.array(stamps, dtype=np.int64),
        table[:, :3],
        table[:, 3:],
    )


def path_through(odometry: OdometrySeries) -> DrivenPath:
    """The driven path, as the arcs from each sample to the next.

    Only the poses are used: an arc turns by the change of heading between two samples, and its
    chord is their distance. It starts along the measured heading if the wheels did not slip and no
    command changed in between.
    """
    # Of two at one instant the later counts: the robot was set back there.
    last = np.append(np.diff(odometry.stamps) > 0, True)
    stamps, poses = odometry.stamps[last], odometry.poses[last].copy()
    durations = np.diff(stamps) / NANOSECONDS
    chords, turns = np.diff(poses[:, :2], axis=0), wrapped(np.diff(poses[:, 2]))
    lengths = np.hypot(*chords.T) / np.sinc(turns / (2.0 * np.pi))
    courses = np.arctan2(chords[:, 1], chords[:, 0])
    middles = poses[:-1, 2] + turns / 2.0
    backwards = np.cos(courses - middles) < 0.0
    moved = lengths > 0.0
    starts = np.where(backwards, courses + np.pi, courses) - turns / 2.0
    poses[:-1, 2] = np.where(moved, starts, poses[:-1, 2])
    lengths = np.where(backwards, -lengths, lengths)
    twists = np.zeros((len(stamps), 2))
    twists[:-1] = np.column_stack([lengths, turns]) / durations[:, None]
    return DrivenPath(stamps, poses, twists)


def interpolated(odometry: OdometrySeries, stamps: IntArray) -> Array:
    """Poses ``(M, 3)`` at instants ``(M,)`` [ns], on straight lines between samples."""
    # IntArray count from 1970, and floats have no nanoseconds left there.
    times, wanted = odometry.stamps - odometry.stamps[0], stamps - odometry.stamps[0]
    columns = odometry.poses[:, 0], odometry.poses[:, 1], np.unwrap(odometry.poses[:, 2])
    return np.column_stack([np.interp(wanted, times, each) for each in columns])


def mean_twists(odometry: OdometrySeries, begins: IntArray, ends: IntArray) -> Array:
    """Twists ``(M, 3)`` of arcs from the poses at `begins` to those at `ends` ``(M,)`` [ns]."""
    steps = arc_steps(interpolated(odometry, begins), interpolated(odometry, ends))
    return np.asarray(steps * NANOSECONDS / (ends - begins)[:, None])


def arc_steps(first: Array, last: Array) -> Array:
    """Ways ahead and to the left, and turns, ``(M, 3)`` [m, m, rad], of arcs between poses."""
    chords, turns = last[:, :2] - first[:, :2], wrapped(last[:, 2] - first[:, 2])
    middles = first[:, 2] + turns / 2.0
    cosines, sines, curved = np.cos(middles), np.sin(middles), np.sinc(turns / (2.0 * np.pi))
    ahead = (chords[:, 0] * cosines + chords[:, 1] * sines) / curved
    aside = (chords[:, 1] * cosines - chords[:, 0] * sines) / curved
    return np.column_stack([ahead, aside, turns])


def wrapped(angles: Array) -> Array:
    """Angles [rad] between -pi and pi."""
    return np.asarray(np.mod(angles + np.pi, 2.0 * np.pi) - np.pi)


def _rows(bag: Bag, topic: str, frame_id: str | None) -> Iterator[tuple[int, int, list[float]]]:
    for received, message in bag.messages(topic):
        frame = message.header.frame_id
        try:
            pose = OdometryReading.of(message).pose_in(frame if frame_id is None else frame_id)
        except OdometryError as error:
            raise bag.error(f'{topic}, received at {received} ns: {error}') from error
        variances = np.nan_to_num(message.pose.covariance[[0, 7, 35]]).clip(min=0.0)
        spread = np.sqrt([variances[:2].max(), variances[2]])
        yield received, stamp_of(message), [*pose.tolist(), *spread.tolist()]
