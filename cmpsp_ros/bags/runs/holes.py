"""Holes of a recording: times at which nothing is known of the driven path."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cmpsp_ros.arrays import IntArray
from cmpsp_ros.bags.runs.run import Driven
from cmpsp_ros.guidance import NANOSECONDS, GuidanceSettings

Stamps = IntArray

_LOST: Final = 3.0
"""Median intervals between two messages from which on some are missing."""


class Hole(NamedTuple):
    """Time between two poses that are known.

    Attributes:
        begin: Stamp of the pose before [ns].
        end: Stamp of the pose after [ns].
    """

    begin: int
    end: int


def longest_interval(stamps: Stamps, settings: GuidanceSettings) -> int:
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


def holes(stamps: Stamps, begin: int, end: int, longest: int) -> tuple[Hole, ...]:
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


def pieces(path: Driven, begin: int, end: int, longest: int) -> Iterator[Driven]:
    """The parts of a path between two instants [ns] that have no hole."""
    for part in np.split(np.arange(len(path.stamps)), _long(path.stamps, longest) + 1):
        first, last = max(begin, int(path.stamps[part[0]])), min(end, int(path.stamps[part[-1]]))
        if first < last:
            yield Driven(path.stamps[part], path.poses[part], path.twists[part]).between(
                first, last
            )
        elif first == last:
            # A pose alone, as an arc of no length.
            poses, twists = np.repeat(path.at(first)[None], 2, axis=0), np.zeros((2, 2))
            yield Driven(np.array([first, first + 1]), poses, twists)


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


def _long(stamps: Stamps, longest: int) -> NDArray[np.intp]:
    """Indices of the intervals that are too long."""
    return np.flatnonzero(np.diff(stamps) > longest)
