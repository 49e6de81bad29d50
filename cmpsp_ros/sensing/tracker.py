"""Tracks of what moves, from the scans of all sensors."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from scipy.optimize import linear_sum_assignment

from cmpsp_ros.arrays import Array, IntArray
from cmpsp_ros.sensing.beams import Beams
from cmpsp_ros.sensing.moving_object import MovingObject
from cmpsp_ros.sensing.scan_history import N_DIRECTIONS, Label, ScanHistory, View
from cmpsp_ros.sensing.segments import Segment, keep_within, segments_of
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
_SIGNIFICANT: Final = 4.0
"""Squared speed that is no error, in variances of the velocity."""
_FEW: Final = 3
"""Hits where nothing was, from which that shows motion."""
_DIRECTIONS: Final = 32
"""Beams by which the angle between two is found."""
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
        found = segments_of(origin, points, labels, self._movers(), _step(beams))
        if found is None:
            self._histories, found = {sensor: (history := ScanHistory())}, []
            self._objects = [each for each in self._objects if each.is_moving]
        begun = []
        for known, segment in self._associated(found, origin):
            if known is not None and self._follow(known, segment, origin, view):
                begun.append(known.number)
            owner = known or self._begin(segment, origin, beams.stamp)
            if owner is not None:
                owners[hits[segment.members]] = MOVING if owner.is_moving else owner.number
        on_movers = labels != Label.STATIC
        keep_within(on_movers, points, self._movers(_AROUND))
        owners[hits[on_movers]] = MOVING
        self._drop(view)
        history.add(view)
        return owners, begun

    def tracks(self, stamp: int) -> tuple[Track, ...]:
        """Tracks of all that moves, predicted for a time [ns]."""
        return tuple(each.track(stamp) for each in self._objects if each.is_moving)

    def _movers(self, around: float = 0.0) -> Array:
        """Discs of what moves, with so much around them (x, y, radius), ``(M, 3)`` [m]."""
        movers = [each for each in self._objects if each.is_moving]
        discs = [(each.x, each.y, each.radius + around) for each in movers]
        return np.array(discs).reshape(-1, 3)

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
        elapsed, is_cut = each.stamp - each.seen, any(segment.is_cut)
        radius = each.radius if is_cut else max(segment.radius, _LEGS if segment.legs else _BODY)
        each.correct(*segment.center(origin, each.radius), radius, _variance(segment))
        has_left = view.is_through(*each.origin)
        is_fast = each.speed**2 > _SIGNIFICANT * each.velocity_variance
        moves = segment.has_entered or (is_fast and (has_left or segment.entered >= _FEW))
        if each.is_moving:
            each.origin = segment.front if has_left else each.origin
            each.settle(elapsed, moves=moves or has_left)
            return False
        each.evidence = each.evidence + 1 if moves else max(each.evidence - 1, 0)
        each.sightings += 1
        if each.evidence < _CONFIRMED or each.sightings < _SEEN_ENOUGH:
            return False
        self._name += not each.name
        each.name = each.name or self._name
        each.is_moving, each.still, each.unproved = True, 0, 0
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
    hits = np.flatnonzero(beams.hits & np.isfinite(beams.ends[:, 0] + beams.ends[:, 1]))
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
    known = np.flatnonzero(beams.ends[:, 0] != beams.starts[:, 0])[:_DIRECTIONS]
    along = beams.ends[known] - beams.starts[known]
    turned = np.sort(np.diff(np.arctan2(along[:, 1], along[:, 0])) % math.tau)
    return float(turned[len(turned) // 2]) if len(turned) else math.tau / N_DIRECTIONS


def _variance(segment: Segment) -> float:
    """Variance of the centre of a segment [m^2]."""
    stddev = _NOISE + _NOISE_BY_RANGE * segment.near + _CUT_NOISE * any(segment.is_cut)
    stddev += _LEG_NOISE / len(segment.legs) if segment.legs else 0.0
    return stddev * stddev
