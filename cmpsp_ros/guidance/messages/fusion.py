"""Tracks of several sources as one list, in which each object is once."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import numpy as np

from cmpsp_ros.guidance.messages.object_tracks import pairs
from cmpsp_ros.guidance.messages.tracks import PeerTrajectory
from cmpsp_ros.guidance.times import NANOSECONDS
from cmpsp_ros.sensing import Track

_GATE: Final = 13.28
"""Squared Mahalanobis distance of place and velocity that 99 % of true pairs have at most."""
_CENTER: Final = 0.5
"""Part of its radius by which two sources may see the centre of an object apart (one sigma)."""
_VELOCITY: Final = 0.3
"""As much for its velocity [m/s]."""
_ACCELERATION: Final = 1.0
"""Acceleration of an object since it was seen (one sigma) [m/s^2]."""
_HYSTERESIS: Final = 2.0
"""Factor on distances that keeps pairs together, and on doubts that keeps the chosen track."""
_TINY: Final = 1e-9


class TrackFusion:
    """Association of tracks that are of the same object.

    The surest track of an object is kept until another is clearly surer, so that its number stays.
    The order of messages makes no difference.
    """

    def __init__(self) -> None:
        """Start without pairs."""
        self._paired: set[frozenset[int]] = set()
        self._chosen: set[int] = set()

    def update(self, stamp: int, sources: Sequence[Sequence[Track]]) -> list[Track]:
        """The tracks at a time [ns]; within a source each is another object."""
        objects: list[list[Track]] = []
        for tracks in sources:
            rows = [[self._distance(one[0], each, stamp) for each in tracks] for one in objects]
            found = pairs(np.array(rows).reshape(len(objects), len(tracks)), _GATE)
            for row, column in found:
                objects[row].append(tracks[column])
            taken = {column for _, column in found}
            objects += [[each] for k, each in enumerate(tracks) if k not in taken]
        kept = [min(each, key=lambda track: self._doubt(track, stamp)) for each in objects]
        self._paired = {frozenset({one.id, a.id}) for one, *rest in objects for a in rest}
        self._chosen = {each.id for each in kept}
        return kept

    def _distance(self, one: Track, other: Track, stamp: int) -> float:
        """Squared Mahalanobis distance of place and velocity.

        Infinite where neither has its centre in the other's disc: to take two for one is the worse
        error.
        """
        (place, stddev), (place_, stddev_) = _place(one, stamp), _place(other, stamp)
        apart = math.dist(place, place_)
        is_paired = frozenset({one.id, other.id}) in self._paired
        if apart > (one.radius + other.radius if is_paired else max(one.radius, other.radius)):
            return math.inf
        off = math.dist((one.vx, one.vy), (other.vx, other.vy))
        size = _CENTER * max(one.radius, other.radius)
        distance = apart**2 / max(size**2 + stddev**2 + stddev_**2, _TINY)
        doubt = one.velocity_stddev**2 + other.velocity_stddev**2
        distance += off**2 / (_VELOCITY**2 + doubt)
        return distance / (_HYSTERESIS**2 if is_paired else 1.0)

    def _doubt(self, track: Track, stamp: int) -> float:
        """Doubt about the place a second later; less of the track that was chosen before."""
        _, stddev = _place(track, stamp)
        return (stddev + track.velocity_stddev) / (_HYSTERESIS if track.id in self._chosen else 1.0)


def without_robots(
    tracks: Sequence[Track], robots: Sequence[PeerTrajectory], radius: float, stamp: int
) -> list[Track]:
    """Tracks but for those that are of a robot of a radius [m] whose own plan is known."""
    places = [each.position(stamp) for each in robots]
    return [
        each
        for each in tracks
        if all(math.dist(_place(each, stamp)[0], place) > radius for place in places)
    ]


def _place(track: Track, stamp: int) -> tuple[tuple[float, float], float]:
    """Predicted place at a time [ns], and its standard deviation [m]."""
    age = (stamp - track.stamp) / NANOSECONDS
    stddev = math.hypot(track.position_stddev, track.velocity_stddev * age)
    place = track.x + age * track.vx, track.y + age * track.vy
    return place, stddev + _ACCELERATION * age**2 / 2.0
