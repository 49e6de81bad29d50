"""Moving obstacles as messages: one message, one instant, any number.

They come as `sensor_msgs/PointCloud2`, a point each, as trackers and radars publish them: fields
``x`` and ``y`` [m], ``vx`` and ``vy`` [m/s], ``radius`` [m] and ``id``, a whole number.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, Final, Generic, Protocol, TypeVar

from cmpsp_ros.guidance.horizon import NANOSECONDS
from cmpsp_ros.guidance.messages import checks
from cmpsp_ros.guidance.messages.checks import FARTHEST, check_frame
from cmpsp_ros.guidance.messages.odometry import stamp_of
from cmpsp_ros.sensing import ScanError, points_of

FLOATS: Final = ('x', 'y', 'vx', 'vy', 'radius')
"""Fields of a message that are floats of either length; `id` is an integer of any."""

MOST: Final = 1000
"""Points in a message; more are not obstacles but a scan."""

_FASTEST: Final = 1e4
_KEY: Final = re.compile(r'(-?\d{1,10}|(?:/\w+)+)@(\d{1,19})', re.ASCII)


class TrackError(ValueError):
    """A message on obstacles that is unusable; the message says why."""


@dataclass(frozen=True, order=True)
class Track:
    """One moving obstacle, as it was seen; of two at one time the greater counts.

    Attributes:
        id: Its number, the same in each message.
        stamp: When it was seen [ns].
        radius: Its radius [m].
        x: Where its centre was [m].
        y: See `x`.
        vx: Its velocity [m/s].
        vy: See `vx`.
    """

    id: int
    stamp: int
    radius: float
    x: float
    y: float
    vx: float
    vy: float

    @property
    def name(self) -> str:
        """What messages call it."""
        return f'moving obstacle {self.id}'

    @property
    def key(self) -> tuple[int, int]:
        """What of it a decision says: it was seen then."""
        return self.id, self.stamp

    def is_older(self, stamp: int) -> bool:
        """Whether it was seen before an instant [ns]."""
        return self.stamp < stamp


class TimedRecord(Protocol):
    """What is known of something that moves; of two at one time the greater counts."""

    @property
    def id(self) -> Any:
        """Which one: of a type that can be sorted."""

    @property
    def stamp(self) -> int:
        """When this was so [ns]."""

    def is_older(self, stamp: int) -> bool:
        """Whether it is to be forgotten when all is that was seen before an instant [ns]."""

    def __lt__(self, other: Any, /) -> bool:
        """Whether it counts less than another at the same time."""


Item = TypeVar('Item', bound=TimedRecord)


def tracks_of(message: Any, frame_id: str) -> list[Track]:
    """The obstacles in a message.

    Args:
        message: A `sensor_msgs/PointCloud2`.
        frame_id: Frame in which positions and velocities are wanted.

    Raises:
        TrackError: It is in another frame, lacks a field, does not fit its own sizes, has two
            obstacles of one number, or one that is not finite, farther or faster than anything on
            Earth, or of negative radius; nothing of it is used then.
    """
    check_frame('Obstacles are', message, frame_id, TrackError)
    rows, stamp = _rows(message), stamp_of(message)
    tracks = []
    for number, row in enumerate(rows.tolist()):
        track = Track(row[5], stamp, row[4], row[0], row[1], row[2], row[3])
        if problem := _problem(track):
            raise TrackError(f'Obstacle {track.id} (point {number}) has {problem}.')
        tracks.append(track)
    numbers = [each.id for each in tracks]
    if len(set(numbers)) < len(numbers):
        twice = next(each for each in numbers if numbers.count(each) > 1)
        raise TrackError(f'Obstacle {twice} is there twice, wanted a number of its own for each.')
    return tracks


def check_age(stamp: int, now: int, timeout: float, what: str = 'Obstacles are') -> None:
    """Refuse a message that does not fit the clock.

    Args:
        stamp: Its time stamp [ns].
        now: Present time [ns].
        timeout: `moving_obstacles.timeout` [s].
        what: What it is about, and the verb.

    Raises:
        TrackError: It is too old, or as far ahead.
    """
    checks.check_age(what, 'moving_obstacles.timeout', stamp, now, timeout, TrackError)


class Tracks(Generic[Item]):
    """The reports on moving obstacles, ordered by their stamps, not by their arrival."""

    def __init__(self) -> None:
        """Know of none."""
        self._known: dict[Any, list[Item]] = {}

    def hear(self, tracks: Iterable[Item]) -> None:
        """Take a message in."""
        for each in tracks:
            known = self._known.setdefault(each.id, [])
            known.append(each)
            known.sort()

    def at(self, stamp: int, timeout: float) -> tuple[Item, ...]:
        """The latest on each obstacle at a time, in the order of their numbers.

        Args:
            stamp: The time [ns]; what was seen later does not count yet.
            timeout: Age at which one that was not seen again is forgotten [s].
        """
        oldest, latest = stamp - round(timeout * NANOSECONDS), []
        for number, known in sorted(self._known.items()):
            seen = sum(each.stamp <= stamp for each in known)
            del known[: max(seen - 1, 0)]
            if known[0].is_older(oldest):
                del known[0]
            elif seen:
                latest.append(known[0])
            if not known:
                del self._known[number]
        return tuple(latest)

    def forget_after(self, stamp: int) -> None:
        """Forget what was seen later than an instant [ns], to which time has jumped back."""
        kept = {
            number: [each for each in known if each.stamp <= stamp]
            for number, known in self._known.items()
        }
        self._known = {number: known for number, known in kept.items() if known}


def track_keys(tracks: Iterable[TimedRecord]) -> str:
    """Which tracks, as text."""
    return ' '.join(f'{each.id}@{each.stamp}' for each in tracks)


def read_keys(text: str) -> list[tuple[int | str, int]]:
    """Numbers or namespaces, and stamps, of what `track_keys` wrote.

    Raises:
        ValueError: It did not write this.
    """
    found = [_KEY.fullmatch(each) for each in text.split()]
    if None in found:
        raise ValueError(f'found {text[:40]!r}, wanted obstacles as id@stamp')
    return [
        (each[1] if each[1].startswith('/') else int(each[1]), int(each[2]))
        for each in found
        if each is not None
    ]


def _rows(message: Any) -> Any:
    """The points, with the fields in the order of `FLOATS`, then the number."""
    count = int(message.width) * int(message.height)
    if count > MOST:
        raise TrackError(f'There are {count} obstacles, wanted {MOST} at most.')
    try:
        return points_of(message, FLOATS, ('id',), 'moving_obstacles')
    except ScanError as error:
        raise TrackError(f'Obstacles cannot be read: {error}.') from error


def _problem(track: Track) -> str:
    numbers = (track.x, track.y, track.vx, track.vy, track.radius)
    if not all(map(math.isfinite, numbers)):
        return f'a number that is not finite: {list(numbers)}'
    if track.radius < 0.0:
        return f'a radius of {track.radius:.3g} m, wanted 0 or more'
    if max(abs(track.x), abs(track.y), track.radius) > FARTHEST:
        return f'a position of {track.x:.3g}, {track.y:.3g} m, wanted one on Earth'
    if max(abs(track.vx), abs(track.vy)) > _FASTEST:
        return f'a velocity of {track.vx:.3g}, {track.vy:.3g} m/s, wanted one of an obstacle'
    return ''
