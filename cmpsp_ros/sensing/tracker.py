"""Tracks of what moves, from the scans of all sensors."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from scipy.optimize import linear_sum_assignment

from cmpsp_ros.arrays import Array, BoolArray, IntArray
from cmpsp_ros.sensing.beams import Beams
from cmpsp_ros.sensing.moving_object import MovingObject
from cmpsp_ros.sensing.scan_history import N_DIRECTIONS, Label, ScanHistory, View
from cmpsp_ros.sensing.segments import Segment, segments_of
from cmpsp_ros.sensing.track import Track

MOVING: Final = -1
"""Owner of beams that have hit something that moves: they mark no cell."""

_NS: Final = 1_000_000_000
_BODY, _LEGS = 0.25, 0.3
"""Radius of a person, whose body or whose legs are seen; part of it may not be [m]."""
_NOISE, _NOISE_BY_RANGE = 0.02, 0.004
"""Standard deviation of a centre that is seen [m], and more by its distance."""
_CUT_NOISE, _LEG_NOISE = 0.1, 0.12
_GATE: Final = 11.8
"""Squared Mahalanobis distance of a pair (two coordinates, 99.7 %)."""
_NEVER: Final = 1e3
_AROUND: Final = 0.1
"""Distance from the disc of a mover at which hits are on it [m]."""
_LOST: Final = 2 * _NS
_FORGOTTEN: Final = _NS * 35 // 100
"""Time after which a mover, and another object, is dropped without being seen [ns]."""
_CONFIRMED, _SEEN_ENOUGH, _GONE = 2, 3, 3
_FAR: Final = 0.3
"""Distance that shows a motion where the place left behind is seen to be empty [m]."""
_SIGNIFICANT: Final = 16.0
_FEW: Final = 3
_SAME: Final = 0.2
"""Distance of two tracks of the same object [m]."""
_LONG: Final = 2.5
_ODOMETRY: Final = 0.1, 20
"""Fraction and number of hits, in long walls that seem to have moved, from which odometry has."""


class Tracker:
    """Objects in sight, and which of them move."""

    def __init__(self) -> None:
        """Start with nothing seen."""
        self._histories: dict[str, ScanHistory] = {}
        self._objects: list[MovingObject] = []
        self._number, self._name = 0, 0

    def update(self, sensor: str, beams: Beams) -> tuple[IntArray, list[int]]:
        """Follow all objects through a scan.

        Returns:
            The owner of each beam, shape ``(B,)``: `MOVING`, the number of an object that stands
            still so far, or 0; and the numbers of those that have begun to move.
        """
        owners = np.zeros(len(beams.ends), np.int64)
        history = self._histories.setdefault(sensor, ScanHistory())
        hits = _hits(beams)
        if not len(hits):
            return owners, []
        origin, points = beams.starts.mean(axis=0), beams.ends[hits]
        shown = hits if not beams.is_sweep else slice(None)
        view = View.of(beams.stamp, origin, beams.ends[shown], beams.hits[shown])
        labels = history.labels(points, beams.stamp)
        for each in self._objects:
            each.predict(beams.stamp)
        movers = np.array(
            [(each.x, each.y, each.radius) for each in self._objects if each.is_moving]
        ).reshape(-1, 3)
        found = segments_of(origin, points, labels, movers, _step(beams))
        if found is None:
            self._histories, found = {sensor: (history := ScanHistory())}, []
        begun = []
        for known, segment in self._associated(found, origin):
            if known is not None and self._follow(known, segment, origin, view):
                begun.append(known.number)
            owner = known or self._begin(segment, origin, beams.stamp)
            if owner is not None:
                owners[hits[segment.members]] = MOVING if owner.is_moving else owner.number
        owners[hits[self._on_movers(points) & (labels != Label.STATIC)]] = MOVING
        self._drop(view)
        history.add(view)
        return owners, begun

    def tracks(self, stamp: int) -> tuple[Track, ...]:
        """Tracks of all that moves, predicted for a time [ns]."""
        return tuple(each.track(stamp) for each in self._objects if each.is_moving)

    def _on_movers(self, points: Array) -> BoolArray:
        """True for each of some points that is on something that moves."""
        movers = [each for each in self._objects if each.is_moving]
        places = np.array([(each.x, each.y, each.radius) for each in movers]).reshape(-1, 3)
        away = points[:, None] - places[:, :2]
        found: BoolArray = (np.square(away).sum(axis=2) < np.square(places[:, 2] + _AROUND)).any(
            axis=1
        )
        return found

    def _associated(
        self, found: list[Segment], origin: Array
    ) -> list[tuple[MovingObject | None, Segment]]:
        """Each segment with the object that it shows, or None."""
        objects: list[MovingObject | None] = [None] * len(found)
        if found and self._objects:
            known = np.array([(each.x, each.y, each.position_variance) for each in self._objects])
            seen = np.array([each.center(origin, max(each.radius, _BODY)) for each in found])
            noise = np.array([_variance(each) for each in found])
            away = np.square(known[:, None, :2] - seen).sum(axis=2)
            costs = away / (known[:, 2:] + noise)
            costs[costs > _GATE] = _NEVER
            for i, j in zip(*linear_sum_assignment(costs), strict=True):
                if costs[i, j] < _NEVER:
                    objects[j] = self._objects[i]
        return list(zip(objects, found, strict=True))

    def _begin(self, segment: Segment, origin: Array, stamp: int) -> MovingObject | None:
        """New object, or the one that moves there already; None for what has long stood there."""
        radius = max(segment.radius, _LEGS if segment.legs else _BODY)
        x, y = segment.center(origin, radius)
        for each in self._objects:
            if each.is_moving and math.hypot(x - each.x, y - each.y) < each.radius:
                return each
        if segment.is_static:
            return None
        self._number += 1
        variance = _variance(segment)
        new = MovingObject(self._number, stamp, x, y, radius, variance, stamp, segment.front)
        new.evidence = int(segment.has_entered)
        self._objects.append(new)
        return new

    def _follow(self, each: MovingObject, segment: Segment, origin: Array, view: View) -> bool:
        """Take in what is seen of an object; True if it has begun to move."""
        is_cut = any(segment.is_cut)
        radius = each.radius if is_cut else max(segment.radius, _LEGS if segment.legs else _BODY)
        each.correct(*segment.center(origin, each.radius), radius, _variance(segment))
        if each.is_moving:
            each.settle()
            return False
        left = math.hypot(each.x - each.origin[0], each.y - each.origin[1]) > _FAR
        is_fast = each.speed**2 > _SIGNIFICANT * each.velocity_variance
        moves = left and view.is_through(*each.origin)
        if segment.has_entered or (is_fast and (moves or segment.entered >= _FEW)):
            each.evidence += 1
        else:
            each.evidence = max(each.evidence - 1, 0)
        each.sightings += 1
        if each.evidence < _CONFIRMED or each.sightings < _SEEN_ENOUGH:
            return False
        self._name += not each.name
        each.name = each.name or self._name
        each.is_moving, each.moved = True, each.stamp
        return True

    def _drop(self, view: View) -> None:
        """Drop what is gone, was not seen for too long, or is there twice."""
        kept: list[MovingObject] = []
        for each in self._objects:
            if each.seen < view.stamp and view.is_through(each.x, each.y):
                each.gone += 1
            age = view.stamp - each.seen
            if each.gone >= _GONE or age > (_LOST if each.is_moving else _FORGOTTEN):
                continue
            if each.is_moving and any(
                other.is_moving and math.hypot(each.x - other.x, each.y - other.y) < _SAME
                for other in kept
            ):
                continue
            kept.append(each)
        self._objects = kept


def _hits(beams: Beams) -> IntArray:
    """Indices of hits; of a cloud the nearest in each direction."""
    hits = np.flatnonzero(beams.hits & np.isfinite(beams.ends).all(axis=1))
    if beams.is_sweep or not len(hits):
        return hits
    away = beams.ends[hits] - beams.starts.mean(axis=0)
    place = np.floor(np.arctan2(away[:, 1], away[:, 0]) / math.tau * N_DIRECTIONS)
    order = np.lexsort((np.hypot(away[:, 0], away[:, 1]), place))
    first = np.unique(place[order], return_index=True)[1]
    nearest: IntArray = np.sort(hits[order[first]])
    return nearest


def _step(beams: Beams) -> float:
    """Angle between neighbouring beams [rad]."""
    if not beams.is_sweep:
        return math.tau / N_DIRECTIONS
    along = beams.ends - beams.starts
    along = along[np.hypot(along[:, 0], along[:, 1]) > 0.0]
    turned = np.diff(np.arctan2(along[:, 1], along[:, 0])) % math.tau
    return float(np.median(turned)) if len(turned) else math.tau / N_DIRECTIONS


def _variance(segment: Segment) -> float:
    """Variance of the centre of a segment [m^2]."""
    stddev = _NOISE + _NOISE_BY_RANGE * segment.near + _CUT_NOISE * any(segment.is_cut)
    stddev += _LEG_NOISE / len(segment.legs) if segment.legs else 0.0
    return stddev * stddev
