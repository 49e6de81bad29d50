"""Tracks of moving obstacles, from the scans of all sensors."""

import math
from typing import Final

import numpy as np

from cmpsp_ros.arrays import Array, BoolArray, IntArray
from cmpsp_ros.sensing.beams import Beams
from cmpsp_ros.sensing.moving_object import MovingObject
from cmpsp_ros.sensing.scan_history import N_DIRECTIONS, Label, ScanHistory, View
from cmpsp_ros.sensing.scan_parts import keep_within
from cmpsp_ros.sensing.segments import Scenery, Segment, segments_of
from cmpsp_ros.sensing.track import Track

MOVING: Final = -1
"""Owner of beams that have hit something that moves: they mark no cell."""

_NS: Final = 1_000_000_000
_BODY, _LEGS = 0.25, 0.3
"""Radius of a person, whose body or whose legs are seen; part of it may not be [m]."""
_NOISE, _NOISE_BY_RANGE = 0.015, 0.004
"""Standard deviation of a centre that is seen [m], and more by its distance."""
_CUT_NOISE, _LEG_NOISE = (0.0, 0.07, 0.25), 0.12
_GATE: Final = 11.8
"""Squared Mahalanobis distance of a pair (two coordinates, 99.7 %)."""
_CLOSE: Final = 0.35
"""Distance from where somebody is expected that is no other's [m]."""
_NEVER: Final = 1e3
_AROUND: Final = 0.1
"""Distance from the disc of a mover at which hits are on it [m]."""
_LOST, _FORGOTTEN = 2 * _NS, 6 * _NS
"""Time without being seen after which a mover is no longer expected where beams are, and where none
are, which is when it is forgotten [ns]."""
_BRIEF: Final = _NS * 35 // 100
"""Time without being seen after which what has never moved is forgotten [ns]."""
_CONFIRMED, _SEEN_ENOUGH, _GONE = 2, 3, 3
_SIGNIFICANT: Final = 4.0
"""Squared speed that is no error, in variances of the velocity."""
_FEW: Final = 3
"""Hits where nothing was, from which that shows motion."""
_DIRECTIONS: Final = 16
"""Beams by which the angle between two is found."""
_EDGE: Final = 10.0
"""Angle that a view all around may lack, in steps."""
_SAME: Final = 0.2
"""Distance of two tracks of the same object [m]."""
_BESIDE: Final = 0.1
"""Distance from the robot at which who stands still does not count as static [m]."""
_DOUBT: Final = (0.5 / 3.0) ** 2
"""Variance up to which a mover is where it is expected [m^2]."""


class Tracker:
    """Objects in sight, and which of them move."""

    def __init__(self) -> None:
        """Start with nothing seen."""
        from scipy.optimize import linear_sum_assignment  # noqa: PLC0415 (slow; few have people)

        self._assign = linear_sum_assignment
        self._histories: dict[str, ScanHistory] = {}
        self._objects: list[MovingObject] = []
        self._scenery = Scenery()
        self._number, self._name = 0, 0

    def update(self, sensor: str, beams: Beams, robot: Array) -> tuple[IntArray, list[int]]:
        """Follow all objects through a scan by a robot of discs (x, y, radius), ``(D, 3)`` [m].

        Returns:
            The owner of each beam, shape ``(B,)``: `MOVING`, the number of an object that stands
            still so far, or 0; and the numbers of those that have begun to move.
        """
        owners = np.zeros(len(beams.ends), np.int64)
        history = self._histories.setdefault(sensor, ScanHistory())
        hits = _hits(beams)
        origin, points = beams.origin, beams.ends[hits]
        shown = hits if not beams.is_sweep else slice(None)
        view = View.of(beams.stamp, origin, beams.ends[shown], beams.hits[shown])
        labels = history.labels(points, beams.stamp)
        for each in self._objects:
            each.predict(beams.stamp)
            if each.is_moving:
                each.stop_before(robot)
        found = segments_of(origin, points, labels, self._movers(doubt=_DOUBT), _view(beams))
        if found is None:
            self._histories, found = {sensor: (history := ScanHistory())}, []
            self._scenery = Scenery()
            self._objects = [each for each in self._objects if each.is_moving]
        begun, associated = [], self._associated(found, origin)
        for known, segment in associated:
            if known is not None and self._follow(known, segment, origin, view):
                begun.append(known.number)
            if known is not None and known.is_moving and _is_beside(robot, known):
                known.still = known.unproved = 0
        for known, segment in associated:
            owner = known or self._begin(segment, origin, beams.stamp)
            if owner is not None:
                owners[hits[segment.members]] = MOVING if owner.is_moving else owner.number
        on_movers = labels != Label.STATIC
        keep_within(on_movers, points, self._movers(_AROUND))
        owners[hits[on_movers]] = MOVING
        self._scenery.add(beams.stamp, self._scenery_in(associated, origin, beams.stamp))
        self._drop(view)
        if len(beams.ends):  # an empty cloud shows no place
            history.add(view)
        return owners, begun

    def tracks(self, stamp: int) -> tuple[Track, ...]:
        """Tracks of all that moves, predicted for a time [ns]."""
        return tuple(each.track(stamp) for each in self._expected if each.is_moving)

    @property
    def _expected(self) -> list[MovingObject]:
        """Objects that are where they are predicted; the others may come back anywhere."""
        return [each for each in self._objects if not each.is_lost]

    def _movers(self, around: float = 0.0, doubt: float = math.inf) -> Array:
        """Discs of moving obstacles, enlarged (x, y, radius) [m], and 1 if settled, ``(M, 4)``.

        Those in more `doubt` [m^2] are left out: a wall that comes into view is no part of them.
        """
        movers = [
            each for each in self._expected if each.is_moving and each.position_variance <= doubt
        ]
        discs = [(each.x, each.y, each.radius + around, each.has_settled) for each in movers]
        return np.array(discs, dtype=float).reshape(-1, 4)

    def _associated(
        self, found: list[Segment], origin: Array
    ) -> list[tuple[MovingObject | None, Segment]]:
        """Each segment with the object that it shows, or None."""
        objects: list[MovingObject | None] = [None] * len(found)
        if found and (expected := self._expected):
            known = np.array([(each.x, each.y, each.position_variance) for each in expected])
            seen = np.array([each.center(origin, max(each.radius, _BODY)) for each in found])
            away = np.square(known[:, None, :2] - seen).sum(axis=2)
            variances = known[:, 2:] + _variances(found, expected)
            costs = away / variances
            # Minus twice the logarithm of the likelihood: who is in doubt claims nothing.
            is_close = away <= _CLOSE * _CLOSE
            is_near = is_close | (costs <= _GATE)
            is_near &= ~_stands_there(expected, found, is_close, self._scenery.has(seen))
            costs = np.where(is_near, costs + 2.0 * np.log(variances), _NEVER)
            for i, j in zip(*self._assign(costs), strict=True):
                if costs[i, j] < _NEVER:
                    objects[j] = expected[i]
        return list(zip(objects, found, strict=True))

    def _scenery_in(
        self, associated: list[tuple[MovingObject | None, Segment]], origin: Array, stamp: int
    ) -> Array:
        """Centres of what looks static and is no mover, and where none is expected, ``(S, 2)``."""
        unseen = [each for each in self._expected if each.is_moving and each.seen < stamp]
        places = [
            segment.center(origin, max(segment.radius, _BODY))
            for known, segment in associated
            if segment.is_static and not (known and known.is_moving)
        ]
        away = [min((math.dist(p, (e.x, e.y)) for e in unseen), default=math.inf) for p in places]
        return np.array(places).reshape(-1, 2)[np.array(away) > _CLOSE]

    def _begin(self, segment: Segment, origin: Array, stamp: int) -> MovingObject | None:
        """New object, or the one that moves there already; None for what has long stood there.

        Who walked close to a mover may have been taken for a part of it until now.
        """
        radius = max(segment.radius, _LEGS if segment.legs else _BODY)
        x, y = segment.center(origin, radius)
        parted = None
        for each in self._expected:
            away = math.hypot(x - each.x, y - each.y) - each.radius
            if not each.is_moving or away >= radius:
                continue
            if away < 0.0 and not (segment.is_body and each.seen == stamp):
                return each
            parted = each
        if segment.is_static:
            return None
        self._number += 1
        variance = _variance(segment, radius)
        new = MovingObject(
            stamp,
            x,
            y,
            variance,
            number=self._number,
            radius=radius,
            begun=stamp,
            seen=stamp,
            origin=segment.front,
            evidence=int(segment.has_entered),
            sightings=1 + (parted is not None),
        )
        if parted is not None and segment.is_body and segment.has_entered:
            new.part_from(parted)
            new.name = self._name_of(new)
        self._objects.append(new)
        return new

    def _follow(self, each: MovingObject, segment: Segment, origin: Array, view: View) -> bool:
        """Take in what is seen of an object; True if it has begun to move."""
        elapsed, is_cut = each.stamp - each.seen, any(segment.is_cut)
        radius = each.radius if is_cut else max(segment.radius, _LEGS if segment.legs else _BODY)
        each.see(*segment.center(origin, each.radius), radius, _variance(segment, each.radius))
        has_left = view.is_through(*each.origin)
        is_fast = each.speed**2 > _SIGNIFICANT * each.velocity_variance
        moves = segment.has_entered or (is_fast and (has_left or segment.entered >= _FEW))
        if each.is_moving:
            each.origin = segment.front if moves or has_left else each.origin
            each.settle(elapsed, moves=moves or has_left)
            return False
        each.evidence = each.evidence + 1 if moves else max(each.evidence - 1, 0)
        each.sightings += 1
        if each.evidence < _CONFIRMED or each.sightings < _SEEN_ENOUGH:
            return False
        each.name = each.name or self._name_of(each)
        each.is_moving, each.still, each.unproved = True, 0, 0
        return True

    def _name_of(self, new: MovingObject) -> int:
        """Name of one out of sight who may have come to where another is, or a new name."""
        hidden = [each for each in self._objects if each.name and each.seen < new.begun]
        away = [each.distance(new) for each in hidden]
        if away and min(away) <= _GATE:
            known = hidden[int(np.argmin(away))]
            self._objects.remove(known)
            return known.name
        self._name += 1
        return self._name

    def _drop(self, view: View) -> None:
        """Drop what is gone, was not seen for too long, or is there twice."""
        kept, movers = list[MovingObject](), list[MovingObject]()
        # Of two at one place the one in more doubt is dropped.
        for each in sorted(self._objects, key=lambda each: each.position_variance):
            age = view.stamp - each.seen
            each.gone += age > 0 and view.is_through(each.x, each.y)
            is_late = age > (_FORGOTTEN if view.is_blind(each.x, each.y) else _LOST)
            is_double = each.is_moving and any(
                math.hypot(each.x - other.x, each.y - other.y) < _SAME and each.moves_like(other)
                for other in movers
                if max(each.begun, other.begun) < view.stamp  # else they have just parted
            )
            each.is_lost = each.is_lost or is_late or is_double or each.gone >= _GONE
            if each.is_moving and not each.is_lost:
                movers.append(each)
            if age <= (_FORGOTTEN if each.name else _BRIEF) and (each.name or not each.is_lost):
                kept.append(each)
        self._objects = sorted(kept, key=lambda each: each.number)


def _stands_there(
    objects: list[MovingObject], segments: list[Segment], is_close: BoolArray, is_known: BoolArray
) -> BoolArray:
    """True where a segment shows something that stands rather than an object, ``(O, S)``.

    Part of a wall is no object in doubt, unless it ends on one side, close to where that is
    expected. What has long stood is none in doubt that is expected elsewhere, and none that has
    just come if it is cut, or `is_known` as scenery.
    """
    is_in_doubt = np.array([[each.position_variance > _DOUBT] for each in objects])
    has_come = np.array([[not each.has_settled] for each in objects])
    looks = [
        (any(each.is_cut), all(each.is_cut), each.has_entered, each.is_static) for each in segments
    ]
    is_cut, has_no_end, has_entered, is_static = np.array(looks).T
    is_part = is_in_doubt & ~has_entered & np.where(is_close, has_no_end, is_cut)
    is_other = (has_come & (is_cut | is_known)) | (is_in_doubt & ~is_close)
    return np.asarray(is_part | (is_other & is_static))


def _is_beside(robot: Array, each: MovingObject) -> bool:
    """True if an object is so near the robot that it may push it, too slowly to be seen moving."""
    return any(
        math.hypot(x - each.x, y - each.y) - radius - each.radius <= _BESIDE
        for x, y, radius in robot.tolist()
    )


def _hits(beams: Beams) -> IntArray:
    """Indices of hits; of a cloud the nearest in each direction."""
    hits = np.flatnonzero(beams.hits & np.isfinite(beams.ends[:, 0] + beams.ends[:, 1]))
    if beams.is_sweep or not len(hits):
        return hits
    away = beams.ends[hits] - beams.origin
    place = np.floor(np.arctan2(away[:, 1], away[:, 0]) / math.tau * N_DIRECTIONS)
    order = np.lexsort((np.hypot(away[:, 0], away[:, 1]), place))
    first = np.unique(place[order], return_index=True)[1]
    nearest: IntArray = np.sort(hits[order[first]])
    return nearest


def _view(beams: Beams) -> tuple[float, float, float]:
    """Angle between neighbouring beams, and directions of the first and last one of a sector."""
    step, nowhere = math.tau / N_DIRECTIONS, (math.nan, math.nan)
    known = np.flatnonzero(beams.ends[:, 0] != beams.starts[:, 0])
    if not beams.is_sweep or len(known) < _FEW:
        return step, *nowhere
    some = known[[*range(min(len(known), _DIRECTIONS)), -1]]
    along = beams.ends[some] - beams.starts[some]
    angles = np.arctan2(along[:, 1], along[:, 0])
    turned = np.sort((angles[1:-1] - angles[:-2]) % math.tau)
    step, (right, left) = float(turned[len(turned) // 2]), angles[[0, -1]].tolist()
    is_sector = (left - right) % math.tau < math.tau - _EDGE * step
    return step, *((right, left) if is_sector else nowhere)


def _variances(segments: list[Segment], objects: list[MovingObject]) -> Array:
    """Variances of the centres of objects in segments, ``(O, S)`` [m^2]."""
    radii = np.array([[max(each.radius, _BODY)] for each in objects])
    more = np.maximum(np.array([each.radius for each in segments]) - radii, 0.0)
    return np.asarray(np.square(np.array([_stddev(each) for each in segments]) + more))


def _variance(segment: Segment, radius: float) -> float:
    """Variance of the centre of an object of some radius [m] in a segment [m^2].

    A larger one shows more than the object.
    """
    stddev = _stddev(segment) + max(segment.radius - max(radius, _BODY), 0.0)
    return stddev * stddev


def _stddev(segment: Segment) -> float:
    """Standard deviation of the centre of a segment that shows no more than an object [m]."""
    legs = _LEG_NOISE / len(segment.legs) if segment.legs else 0.0
    return _NOISE + _NOISE_BY_RANGE * segment.near + _CUT_NOISE[sum(segment.is_cut)] + legs
