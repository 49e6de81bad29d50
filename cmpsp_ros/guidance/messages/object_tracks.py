"""Tracks from the objects of other trackers, and of several sources each object once."""

import copy
import math
from collections.abc import Hashable, Sequence
from dataclasses import replace
from typing import Any, Final

import numpy as np

from cmpsp_ros.arrays import Array
from cmpsp_ros.guidance.messages.objects import TrackedObject, objects_of
from cmpsp_ros.guidance.messages.poses import compose
from cmpsp_ros.guidance.messages.tracks import PeerTrajectory, TrackError, problem_of
from cmpsp_ros.guidance.times import NANOSECONDS
from cmpsp_ros.sensing import MotionFilter, Track, TrackSource, stamp_of

_GATE: Final = 9.21  # squared Mahalanobis distance that 99 % of true pairs in a plane have at most
_AGILITY: Final = 0.1  # power spectral density of accelerations of a detection [m^2/s^3]
_SPEED: Final = 1.0  # standard deviation of its velocity at first, along each axis [m/s]
_EXACT: Final = 0.01  # smallest standard deviation of a place that is filtered [m]
_SAME: Final = 13.28  # as `_GATE`, of place and velocity
_CENTER: Final = 0.5  # part of its radius by which two sources see its centre apart (sigma)
_VELOCITY: Final = 0.3  # as much for its velocity [m/s]
_ACCELERATION: Final = 1.0  # acceleration of an object since it was seen (one sigma) [m/s^2]
_HYSTERESIS: Final = 2.0  # factor on distances that keeps pairs, and on doubts the chosen track
_TINY: Final = 1e-9


class ObjectTracks:
    """Tracks of one source: objects without a name are matched, those without velocity filtered."""

    def __init__(self, source: TrackSource, number: int) -> None:
        """Start with nothing seen; the number of the source is at least 1."""
        self._source, self._next = source, number * Track.SEEN
        self._named: dict[Hashable, int] = {}
        self._motions: dict[int, MotionFilter] = {}

    def tracks_of(self, message: Any, there: Array, motion: Array, timeout: float) -> list[Track]:
        """Tracks in a message, in the frame of the course, or TrackError and no track.

        `there` ``(3,)`` is the pose of the message's frame in that of the course [m, m, rad],
        `motion` ``(3,)`` its velocity; an object not seen for `timeout` [s] is forgotten.
        """
        objects, stamp = objects_of(message, self._source.type), stamp_of(message)
        seen = [self._placed(each, stamp, there, motion) for each in objects]
        self._forget(stamp - round(timeout * NANOSECONDS))
        found = []
        numbers = self._numbers(objects, seen, stamp)
        for number, each, track in zip(numbers, objects, seen, strict=True):
            before = self._motions.get(number)
            if before is not None and before.stamp >= stamp:
                continue
            if before is None or each.velocity is not None:
                self._motions[number], shown = _filter_of(track), track
            else:
                before.predict(stamp)
                before.correct(track.x, track.y, _variance(track))
                shown = _with_state(track, before)
            found.append(replace(shown, id=number))
        return found

    def _placed(self, each: TrackedObject, stamp: int, there: Array, motion: Array) -> Track:
        """An object in the frame of the course; one without a velocity may be at rest."""
        x, y, _ = compose(there, np.array([each.x, each.y, 0.0])).tolist()
        vx, vy, turn = motion.tolist()
        dx, dy = x - there[0], y - there[1]
        velocity, doubt = (0.0, 0.0), _SPEED
        if each.velocity is not None:
            along = compose(np.array([0.0, 0.0, there[2]]), np.array([*each.velocity, 0.0]))
            velocity = float(along[0] + vx - turn * dy), float(along[1] + vy + turn * dx)
            doubt = each.velocity_stddev
        radius = each.radius or self._source.radius
        stddev = each.position_stddev or self._source.position_stddev
        track = Track(0, stamp, radius, x, y, *velocity, stddev, doubt)
        if problem := problem_of(track):
            raise TrackError(f'Object {each.name!r} has {problem}.')
        return track

    def _forget(self, oldest: int) -> None:
        """Forget objects that were last seen before a time [ns]."""
        self._motions = {k: each for k, each in self._motions.items() if each.stamp >= oldest}
        self._named = {k: number for k, number in self._named.items() if number in self._motions}

    def _numbers(
        self, objects: Sequence[TrackedObject], seen: Sequence[Track], stamp: int
    ) -> list[int]:
        """Number of each object at a time [ns]: by its name, or by its place."""
        numbers = [self._named.get(each.name, 0) for each in objects]
        free = sorted(self._motions.keys() - self._named.values())
        nameless = [k for k, each in enumerate(objects) if each.name is None]
        known = [copy.copy(self._motions[each]) for each in free]
        for estimate in known:
            estimate.predict(stamp)
        distances = [
            [at.surprise(seen[k].x, seen[k].y, _variance(seen[k])) for at in known]
            for k in nameless
        ]
        for row, column in pairs(np.array(distances).reshape(len(nameless), len(known)), _GATE):
            numbers[nameless[row]] = free[column]
        for k, each in enumerate(objects):
            if not numbers[k]:
                numbers[k], self._next = self._next, self._next + 1
                self._named |= {} if each.name is None else {each.name: numbers[k]}
        return numbers


def pairs(distances: Array, gate: float) -> list[tuple[int, int]]:
    """Rows and columns of squared distances ``(R, C)`` that belong together, the nearest first."""
    near = zip(*(each.tolist() for each in np.nonzero(distances <= gate)), strict=True)
    found: dict[int, int] = {}
    for row, column in sorted(near, key=lambda pair: (float(distances[pair]), pair)):
        if row not in found and column not in found.values():
            found[row] = column
    return sorted(found.items())


def _filter_of(track: Track) -> MotionFilter:
    variances = track.position_stddev**2, track.velocity_stddev**2
    state = track.stamp, track.x, track.y, variances[0], track.vx, track.vy
    return MotionFilter(*state, velocity_variance=variances[1], agility=_AGILITY)


def _variance(track: Track) -> float:
    """Variance of the place of a track [m^2]."""
    return max(track.position_stddev, _EXACT) ** 2


def _with_state(track: Track, estimate: MotionFilter) -> Track:
    """A track with an estimated state."""
    x, y, vx, vy = estimate.x, estimate.y, estimate.vx, estimate.vy
    position, velocity = estimate.stddevs
    return replace(
        track, x=x, y=y, vx=vx, vy=vy, position_stddev=position, velocity_stddev=velocity
    )


class TrackFusion:
    """Association of tracks of one object, of which the surest is kept until another is surer.

    So is one that covers more: one source may see a part of a vehicle, or somebody beside it.
    """

    def __init__(self) -> None:
        self._paired: set[frozenset[int]] = set()
        self._chosen: set[int] = set()

    def update(self, stamp: int, sources: Sequence[Sequence[Track]]) -> list[Track]:
        """The tracks at a time [ns]; within a source each is another object."""
        objects: list[list[Track]] = []
        for tracks in sources:
            rows = [[self._distance(one[0], each, stamp) for each in tracks] for one in objects]
            found = pairs(np.array(rows).reshape(len(objects), len(tracks)), _SAME)
            for row, column in found:
                objects[row].append(tracks[column])
            taken = {column for _, column in found}
            objects += [[each] for k, each in enumerate(tracks) if k not in taken]
        surest = [min(each, key=lambda track: self._doubt(track, stamp)) for each in objects]
        self._paired = {frozenset({one.id, a.id}) for one, *rest in objects for a in rest}
        self._chosen = {each.id for each in surest}
        return [
            each
            for best, tracks in zip(surest, objects, strict=True)
            for each in (best, *(one for one in tracks if _sticks_out(one, best, stamp)))
        ]

    def _distance(self, one: Track, other: Track, stamp: int) -> float:
        """Squared Mahalanobis distance; infinite where neither centre is in the other's disc."""
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


def _sticks_out(one: Track, other: Track, stamp: int) -> bool:
    """True if a disc is not within another one, by more than the doubt about their places."""
    (place, stddev), (place_, stddev_) = _place(one, stamp), _place(other, stamp)
    doubt = math.hypot(stddev, stddev_, _CENTER * min(one.radius, other.radius))
    return math.dist(place, place_) + one.radius - other.radius > 3.0 * doubt


def _place(track: Track, stamp: int) -> tuple[tuple[float, float], float]:
    """Predicted place at a time [ns], and its standard deviation [m]."""
    age = (stamp - track.stamp) / NANOSECONDS
    stddev = math.hypot(track.position_stddev, track.velocity_stddev * age)
    place = track.x + age * track.vx, track.y + age * track.vy
    return place, stddev + _ACCELERATION * age**2 / 2.0
