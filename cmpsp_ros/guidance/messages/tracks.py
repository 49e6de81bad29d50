"""Moving obstacles and other robots as messages report them.

Obstacles are points of a `sensor_msgs/PointCloud2`, see ``doc/user/obstacles.md``; the plan of
another robot is a `nav_msgs/Path`, each pose with its time.
"""

from __future__ import annotations

import math
import re
from bisect import bisect_right, insort
from collections.abc import Iterable
from dataclasses import dataclass
from itertools import pairwise
from operator import attrgetter
from typing import Any, Final, Generic, TypeVar

import numpy as np

from cmpsp_ros.arrays import Array
from cmpsp_ros.guidance.messages.poses import check_age, check_frame
from cmpsp_ros.guidance.times import NANOSECONDS
from cmpsp_ros.sensing import FARTHEST, ScanError, Track, is_place, points_of, stamp_of

MAX_TRACKS: Final = 1000  # points in a message; more are not obstacles but a scan
_MAX_POSES: Final = 10_000  # poses of a plan; nobody makes a longer one every control period
_FASTEST: Final = 1e4
_KEY: Final = re.compile(r'(-?\d{1,10}|(?:/\w+)+)@(\d{1,19})', re.ASCII)


class TrackError(ValueError):
    """Unusable message on moving obstacles; it says why."""


@dataclass(frozen=True, order=True)
class PeerTrajectory:
    """Plan of another robot."""

    id: str  # its namespace, as in `/r2`
    stamp: int  # time at which the plan was made [ns]
    stamps: tuple[int, ...]  # increasing times [ns]
    # positions then (x, y) [m], at least one; it stays at the last
    places: tuple[tuple[float, float], ...]

    @classmethod
    def of(cls, message: Any, namespace: str, frame_id: str) -> PeerTrajectory:
        """The plan in a `nav_msgs/Path` of the robot with this namespace, or TrackError."""
        whose = f'The plan of {namespace}'
        check_frame(f'{whose} is', message.header.frame_id, frame_id, TrackError)
        if not 1 <= len(message.poses) <= _MAX_POSES:
            raise TrackError(
                f'{whose} has {len(message.poses)} poses, wanted from 1 to {_MAX_POSES}.'
            )
        positions = [each.pose.position for each in message.poses]
        places = [(float(each.x), float(each.y)) for each in positions]
        for number, (x, y) in enumerate(places):
            if not is_place(x, y):
                raise TrackError(
                    f'{whose} has pose {number} at {x:.3g}, {y:.3g} m, wanted one on Earth.'
                )
        stamp, stamps = stamp_of(message), [stamp_of(each) for each in message.poses]
        if any(after <= before for before, after in pairwise(stamps)) or stamps[0] < stamp:
            raise TrackError(f'{whose} has times that do not increase.')
        if stamps[0] > stamp and len(stamps) > 1:
            # It begins when its command takes effect; until then the motion is extrapolated.
            part = (stamps[0] - stamp) / (stamps[1] - stamps[0])
            (x, y), (next_x, next_y) = places[:2]
            stamps.insert(0, stamp)
            places.insert(0, (x - part * (next_x - x), y - part * (next_y - y)))
        return cls(namespace, stamp, tuple(stamps), tuple(places))

    @staticmethod
    def topic(namespace: str) -> str:
        """Topic on which a robot publishes its plans."""
        return f'{namespace}/guidance/predicted_path'

    @property
    def name(self) -> str:
        """Name in messages."""
        return f'robot {self.id}'

    @property
    def key(self) -> tuple[str, int]:
        """Namespace and stamp, by which a decision refers to it."""
        return self.id, self.stamp

    @property
    def at_rest(self) -> bool:
        """True if the robot reports that it is at rest."""
        return len(self.places) == 1

    def is_older(self, stamp: int) -> bool:
        """True if it was made before a time [ns]; a robot at rest stays so until it reports."""
        return not self.at_rest and self.stamp < stamp

    def path(self, stamp: int) -> Array:
        """Times since an instant [ns] and positions (t, x, y), shape ``(J, 3)`` [s, m, m]."""
        seconds = np.array([each - stamp for each in self.stamps]) / NANOSECONDS
        return np.column_stack([seconds, np.array(self.places)])

    def position(self, stamp: int) -> tuple[float, float]:
        """Position at an instant [ns] by its plan [m]."""
        seconds, *places = self.path(stamp).T
        x, y = (float(np.interp(0.0, seconds, each)) for each in places)
        return x, y


MovingObject = Track | PeerTrajectory  # a report on something that moves

Report = TypeVar('Report', Track, PeerTrajectory)


class Tracks(Generic[Report]):
    """Reports on moving objects, ordered by their stamps, not by their arrival."""

    def __init__(self) -> None:
        self._known: dict[Any, list[Report]] = {}

    def add(self, reports: Iterable[Report]) -> None:
        """Add the reports of a message."""
        for each in reports:
            insort(self._known.setdefault(each.id, []), each)

    def at(self, stamp: int, timeout: float) -> tuple[Report, ...]:
        """The latest report on each object at a time [ns], by id; none beyond the time-out [s]."""
        self.forget_before(stamp, timeout)
        first = (known[0] for _, known in sorted(self._known.items()))
        return tuple(each for each in first if each.stamp <= stamp)

    def forget_before(self, stamp: int, timeout: float) -> None:
        """Forget reports that are not the latest ones at this time [ns] or at any later one."""
        oldest = stamp - round(timeout * NANOSECONDS)
        for number, known in [*self._known.items()]:
            seen = bisect_right(known, stamp, key=attrgetter('stamp'))
            del known[: max(seen - 1, 0)]
            if known[0].is_older(oldest):
                del known[0]
            if not known:
                del self._known[number]

    def forget_after(self, stamp: int) -> None:
        """Forget reports later than an instant [ns], to which time has jumped back."""
        kept = {
            number: [each for each in known if each.stamp <= stamp]
            for number, known in self._known.items()
        }
        self._known = {number: known for number, known in kept.items() if known}


def tracks_of(message: Any, frame_id: str) -> list[Track]:
    """The obstacles in a `sensor_msgs/PointCloud2`, or TrackError and no obstacle."""
    check_frame('Obstacles are', message.header.frame_id, frame_id, TrackError)
    count, stamp = int(message.width) * int(message.height), stamp_of(message)
    if count > MAX_TRACKS:
        raise TrackError(f'There are {count} obstacles, wanted {MAX_TRACKS} at most.')
    try:
        present = {each.name for each in message.fields}
        doubts = tuple(each for each in Track.DOUBTS if each in present)
        rows = points_of(message, (*Track.FIELDS, *doubts), ('id',), 'moving_obstacles')
    except ScanError as error:
        raise TrackError(f'Obstacles cannot be read: {error}.') from error
    tracks: list[Track] = []
    for place, (x, y, vx, vy, radius, *stddevs, number) in enumerate(rows.tolist()):
        known = dict(zip(doubts, stddevs, strict=True))
        track = Track(number, stamp, radius, x, y, vx, vy, **known)
        if problem := problem_of(track):
            raise TrackError(f'Obstacle {number} (point {place}) has {problem}.')
        tracks.append(track)
    numbers = [each.id for each in tracks]
    if len(set(numbers)) < len(numbers):
        twice = next(each for each in numbers if numbers.count(each) > 1)
        raise TrackError(f'Obstacle {twice} is there twice, wanted a number of its own for each.')
    return tracks


def told_tracks_of(message: Any, frame_id: str) -> list[Track]:
    """The obstacles in a message of `moving_obstacles`, or TrackError and no obstacle."""
    tracks = tracks_of(message, frame_id)
    for each in tracks:
        if each.id >= Track.SEEN:
            raise TrackError(f'Obstacle {each.id} has a number too large, wanted < {Track.SEEN}.')
    return tracks


def check_track_age(message: Any, now: int, timeout: float, subject: str) -> None:
    """Raise `TrackError` for a message whose stamp does not fit the clock [ns, s].

    `now` is 0 before the first /clock.
    """
    key, stamp = 'moving_obstacles.timeout', stamp_of(message)
    check_age(subject, key, stamp, now or stamp, timeout, TrackError)


def track_keys(tracks: Iterable[MovingObject]) -> str:
    """Keys of tracks as text."""
    return ' '.join(f'{each.id}@{each.stamp}' for each in tracks)


def read_keys(text: str) -> list[tuple[int | str, int]]:
    """Keys (number or namespace, stamp) written by `track_keys`; ValueError for any other text."""
    found = [_KEY.fullmatch(each) for each in text.split()]
    if None in found:
        raise ValueError(f'found {text[:40]!r}, wanted obstacles as id@stamp')
    return [
        (each[1] if each[1].startswith('/') else int(each[1]), int(each[2]))
        for each in found
        if each is not None
    ]


def problem_of(track: Track) -> str:
    """The reason why a track cannot be used, as the object of a sentence; empty if it can."""
    stddevs = track.position_stddev, track.velocity_stddev
    numbers = (track.x, track.y, track.vx, track.vy, track.radius, *stddevs)
    if not all(map(math.isfinite, numbers)):
        return f'a number that is not finite: {list(numbers)}'
    if track.radius < 0.0:
        return f'a radius of {track.radius:.3g} m, wanted 0 or more'
    if min(stddevs) < 0.0:
        return f'a standard deviation of {min(stddevs):.3g}, wanted 0 or more'
    if max(stddevs) > FARTHEST:
        return f'a standard deviation of {max(stddevs):.3g}, wanted one on Earth'
    if max(abs(track.x), abs(track.y), track.radius) > FARTHEST:
        return f'a position of {track.x:.3g}, {track.y:.3g} m, wanted one on Earth'
    if max(abs(track.vx), abs(track.vy)) > _FASTEST:
        return f'a velocity of {track.vx:.3g}, {track.vy:.3g} m/s, wanted one of an obstacle'
    return ''
