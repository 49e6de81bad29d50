"""Segments of a scan: neighbouring hits on one object."""

import math
from typing import Final, NamedTuple

import numpy as np

from cmpsp_ros.arrays import Array, IntArray
from cmpsp_ros.mpsp.jit import allocation_free

_GAP: Final = 0.1  # distance of neighbours on one object [m]
_GAP_BY_STEP: Final = 1.5  # the same, by that of two beams at their range
_HOLE: Final = 5.5  # angle between neighbours on one object, in steps of the scanner
_SLIT: Final = 0.04  # width up to which a hole is no gap between two objects [m]
_DEEP: Final = 0.1  # depth of the notch between two round objects that touch [m]
_WIDE: Final = 0.8  # width of more than one person, and of each part then [m]
_PERSON: Final = 0.6
_LONG: Final = 2.5  # width from which it is a wall, which does not move [m]
_ONE: Final = 0.35  # radius from which it may be two people [m]
_LARGEST: Final = 0.6  # radius of the largest object [m]; walls and what has parts are larger
_FEWEST: Final = 3
_LEG: Final = 0.15  # radius up to which a segment may be a leg [m]
_STRIDE: Final = 0.6  # distance of the legs of one person [m]
_AROUND: Final = 0.15  # distance from where a mover is expected at which a hit may be on it [m]
_BESIDE: Final = 0.05  # distance from a mover up to which the nearest hit of a segment is on it [m]
_STATIC, _ENTERED = 1, 2


class Segment(NamedTuple):
    """Hits on one object, or on one part of it."""

    members: IntArray  # indices of its points, shape ``(P,)``
    right: float  # direction of its right edge, seen from the sensor [rad]
    left: float  # direction of its left edge, not less [rad]
    near: float  # distance of its nearest point [m]
    front: tuple[float, float]  # that point [m]
    is_cut: tuple[bool, bool]  # whether its left and its right side are hidden or out of view
    entered: int  # number of points in places that were just seen free
    static: int  # number of points where something has long stood
    radius: float  # radius of a disc that looks as wide from there [m]
    legs: tuple[float, ...] = ()  # distances of the middles of its legs [m]; none for a body

    @property
    def has_entered(self) -> bool:
        """True if it is where nothing was."""
        return self.entered >= max(_FEWEST, 0.4 * len(self.members))

    @property
    def is_static(self) -> bool:
        """True if it has long stood there."""
        return 2 * self.static >= len(self.members)

    @property
    def is_body(self) -> bool:
        """True if it is all that can be seen of a body."""
        return self.radius > _LEG and not self.legs and not any(self.is_cut)

    @property
    def is_background(self) -> bool:
        """True if it is what is seen of something that stands, between those before it."""
        return not self.has_entered and sum(self.is_cut) + self.is_static >= 2

    def center(self, origin: Array, radius: float) -> tuple[float, float]:
        """Centre of a disc of some radius [m]; from a cut edge it may reach farther."""
        middle, half = (self.left + self.right) / 2.0, (self.left - self.right) / 2.0
        ahead = sum(self.legs) / len(self.legs) if self.legs else self.near + radius
        hidden = 0.0 if self.legs else max(radius - ahead * math.sin(half), 0.0)
        across = hidden * (self.is_cut[0] - self.is_cut[1])
        cosine, sine = math.cos(middle), math.sin(middle)
        x, y = origin.tolist()
        return x + ahead * cosine - across * sine, y + ahead * sine + across * cosine


def segments_of(
    origin: Array, points: Array, labels: IntArray, movers: Array, view: tuple[float, float, float]
) -> list[Segment] | None:
    """Segments that may be people, or parts of something larger that moves; no walls.

    None stands for a scan in which walls seem to have moved: odometry has jumped. Hits ``(P, 2)``
    are seen from `origin` ``(2,)``; `movers` are discs where they are expected (x, y, radius) [m],
    and 1 for those that have been there for so long that they may look static, ``(M, 4)``; the
    `view` has the angle between two beams, and directions of its edges, NaN if all around [rad].
    """
    if len(points) < _FEWEST:
        return []
    away = points - origin
    seen = np.column_stack([np.hypot(away[:, 0], away[:, 1]), np.arctan2(away[:, 1], away[:, 0])])
    order = np.argsort(seen[:, 1], kind='stable')
    # Begin between two objects far away: nobody is cut in two where angles begin anew.
    begin = after_farthest_gap(seen[order], points[order], view[0])
    order = np.concatenate([order[begin:], order[:begin]])
    polar, places = seen[order], points[order]
    polar[len(order) - begin :, 1] += math.tau
    bounds, parts, keys = (np.zeros(len(points) + 1, np.int64) for _ in range(3))
    count = split(bounds, polar, places, view[0])
    sorted_labels = labels[order]
    bounds = bounds[: count + 1]
    count = divide(parts, keys, bounds, polar, places, sorted_labels, movers, view[0])
    if count < 0:
        return None
    table = np.empty((count, 11))
    describe(table, parts, polar, sorted_labels, *view)
    found: list[Segment] = []
    is_object = (table[:, 1] - table[:, 0] >= 2.0) & (table[:, 10] <= _LARGEST)
    for first, last, right, left, near, *numbers, radius in table[is_object].tolist():
        cut_left, cut_right, entered, static, front = (int(each) for each in numbers)
        members = order[int(first) : int(last)]
        nearest, is_cut = tuple(places[front].tolist()), (bool(cut_left), bool(cut_right))
        each = Segment(members, right, left, near, nearest, is_cut, entered, static, radius)
        _add_or_join(found, each, origin, movers)
    return [
        each
        for each in found
        if len(each.members) >= _FEWEST and (not each.is_background or _is_on(movers, each))
    ]


def _is_on(movers: Array, segment: Segment) -> bool:
    """True if a segment that is cut on one side is on a mover, who may stand at an edge of view."""
    x, y = segment.front
    if all(segment.is_cut):
        return False
    away = np.hypot(movers[:, 0] - x, movers[:, 1] - y) - movers[:, 2]
    return bool((away <= _BESIDE).any())


def _add_or_join(found: list[Segment], segment: Segment, origin: Array, movers: Array) -> None:
    """Add a segment; one that may be a leg is joined to the other leg of that person."""
    if segment.radius > _LEG or any(segment.is_cut):
        found.append(segment)
        return
    segment = segment._replace(legs=(segment.near + segment.radius,))
    x, y = segment.center(origin, 0.0)
    owner = _nearest(movers, x, y)
    for place in range(len(found) - 1, max(len(found) - 5, -1), -1):
        other = found[place]
        is_alike = owner >= 0 or segment.is_static == other.is_static
        if len(other.legs) != 1 or not is_alike:
            continue
        other_x, other_y = other.center(origin, 0.0)
        is_near = math.hypot(x - other_x, y - other_y) <= _STRIDE
        near, front = min((other.near, other.front), (segment.near, segment.front))
        sine = math.sin(min((segment.left - other.right) / 2.0, 1.0))
        radius = near * sine / (1.0 - sine)
        if is_near and radius <= _LARGEST and _nearest(movers, other_x, other_y) == owner:
            found[place] = Segment(
                np.concatenate([other.members, segment.members]),
                other.right,
                segment.left,
                near,
                front,
                (False, False),
                other.entered + segment.entered,
                other.static + segment.static,
                radius,
                other.legs + segment.legs,
            )
            return
    found.append(segment)


def _nearest(movers: Array, x: float, y: float) -> int:
    """Index of the mover at a place, -1 for none."""
    if not len(movers):
        return -1
    away = np.hypot(movers[:, 0] - x, movers[:, 1] - y)
    nearest = int(np.argmin(away))
    return nearest if away[nearest] <= _STRIDE else -1


@allocation_free
def after_farthest_gap(polar: Array, places: Array, step: float) -> int:
    """Index of the hit after the gap that is farthest away, of hits all around; 0 without any."""
    farthest, after = 0.0, 0
    for i in range(polar.shape[0]):
        away = min(polar[i, 0], polar[i - 1, 0])
        if away > farthest and _gap(polar, places, i, step) > 1.0:
            farthest, after = away, i
    return after


@allocation_free
def _gap(polar: Array, places: Array, i: int, step: float) -> float:
    """Gap between a hit and the one before it, above one between two objects."""
    distance, turned = polar[i, 0], (polar[i, 1] - polar[i - 1, 1]) % math.tau
    gap = _apart(places, i, i - 1) / (_GAP + _GAP_BY_STEP * distance * turned)
    if distance * turned > _SLIT:
        gap = max(gap, turned / (_HOLE * step))
    return gap


@allocation_free
def split(bounds: IntArray, polar: Array, places: Array, step: float) -> int:
    """Bounds of segments between gaps and at notches; their number is returned."""
    count, low, peak, at = 0, polar[0, 0], polar[0, 0], 0
    for i in range(1, polar.shape[0]):
        distance = polar[i, 0]
        is_new = _gap(polar, places, i, step) > 1.0
        is_notch = distance < peak - _DEEP and peak > low + _DEEP
        if is_new or is_notch:
            count += 1
            bounds[count] = i if is_new else at
        if is_new or is_notch or distance < low:
            low, peak, at = distance, distance, i
        elif distance >= peak:
            peak, at = distance, i
    bounds[count + 1] = polar.shape[0]
    return count + 1


@allocation_free
def divide(
    parts: IntArray,
    keys: IntArray,
    bounds: IntArray,
    polar: Array,
    places: Array,
    labels: IntArray,
    movers: Array,
    step: float,
) -> int:
    """Bounds of parts of segments: a person before a wall, several people, a trolley.

    What is not wide has parts only where several movers are on it.

    Their number is returned, or -1 where a wall is where nothing was: odometry has jumped.
    """
    count = 0
    for k in range(bounds.shape[0] - 1):
        first, last = bounds[k], bounds[k + 1]
        parts[count] = first
        count += 1
        is_wide = _is_wide(polar, places, first, last, step)
        if not is_wide and _radius(polar, first, last, step) <= _ONE:
            continue
        lowest, highest = movers.shape[0], -1
        for i in range(first, last):
            keys[i] = _key(places, labels, movers, i, False)
            if keys[i] >= 0:
                lowest, highest = min(lowest, keys[i]), max(highest, keys[i])
        if not is_wide and lowest >= highest:
            continue
        for i in range(first, last if not is_wide else first):
            keys[i] = _key(places, labels, movers, i, True)
        for i in range(first + 1, last - 1):
            if keys[i] < 0 and keys[i - 1] == keys[i + 1]:
                keys[i] = keys[i - 1]
        begin = first
        while begin < last:
            end = begin + 1
            while end < last and keys[end] == keys[begin]:
                end += 1
            if begin > first:
                parts[count] = begin
                count += 1
            width = _apart(places, begin, end - 1)
            if keys[begin] == -_ENTERED and width > _LONG:
                return -1
            if keys[begin] == -_ENTERED and _is_wide(polar, places, begin, end, step):
                pieces, piece = max(math.ceil(width / _PERSON), 2), 1
                for i in range(begin + 1, end):
                    if piece < pieces and _apart(places, begin, i) * pieces > piece * width:
                        parts[count] = i
                        count, piece = count + 1, piece + 1
            begin = end
    parts[count] = bounds[bounds.shape[0] - 1]
    return count


@allocation_free
def _is_wide(polar: Array, places: Array, first: int, last: int, step: float) -> bool:
    """True if hits are on more than one person, who may be close to the sensor."""
    is_long = _apart(places, first, last - 1) > _WIDE
    return is_long or _radius(polar, first, last, step) > _LARGEST


@allocation_free
def _radius(polar: Array, first: int, last: int, step: float) -> float:
    """Radius of a disc that looks as wide as hits, and is as near."""
    near = math.inf
    for i in range(first, last):
        near = min(near, polar[i, 0])
    half = (polar[last - 1, 1] - polar[first, 1] + step) / 2.0
    sine = math.sin(min(half, 1.0))
    return near * sine / (1.0 - sine)


@allocation_free
def _apart(places: Array, i: int, j: int) -> float:
    return math.hypot(places[i, 0] - places[j, 0], places[i, 1] - places[j, 1])


@allocation_free
def _key(places: Array, labels: IntArray, movers: Array, i: int, all_are_on_movers: bool) -> int:
    """Index of the mover that a point is on, or its label below zero."""
    is_static = labels[i] == _STATIC and not all_are_on_movers
    best, key = _AROUND, -_ENTERED if labels[i] == _ENTERED else -_STATIC
    if all_are_on_movers:
        best = math.inf
    for j in range(movers.shape[0]):
        away = math.hypot(places[i, 0] - movers[j, 0], places[i, 1] - movers[j, 1]) - movers[j, 2]
        is_it = not is_static or (movers[j, 3] > 0.0 and away <= _BESIDE)
        if is_it and away < best:
            best, key = away, j
    return key


@allocation_free
def describe(
    table: Array,
    parts: IntArray,
    polar: Array,
    labels: IntArray,
    step: float,
    right: float,
    left: float,
) -> None:
    """Rows of numbers that make a `Segment`."""
    size = polar.shape[0]
    for k in range(table.shape[0]):
        first, last = parts[k], parts[k + 1]
        near, front, entered, static = math.inf, first, 0.0, 0.0
        for i in range(first, last):
            if polar[i, 0] < near:
                near, front = polar[i, 0], i
            entered += labels[i] == _ENTERED
            static += labels[i] == _STATIC
        table[k, 0], table[k, 1] = first, last
        table[k, 2], table[k, 3] = polar[first, 1] - step / 2.0, polar[last - 1, 1] + step / 2.0
        table[k, 4], table[k, 9] = near, front
        # Comparisons with NaN are false.
        ends_left = math.cos(polar[last - 1, 1] - left) >= math.cos(_HOLE * step)
        ends_right = math.cos(polar[first, 1] - right) >= math.cos(_HOLE * step)
        table[k, 5] = ends_left or _hides(polar, last % size, last - 1, step)
        table[k, 6] = ends_right or _hides(polar, first - 1, first, step)
        table[k, 7], table[k, 8] = entered, static
        table[k, 10] = _radius(polar, first, last, step)


@allocation_free
def _hides(polar: Array, i: int, j: int, step: float) -> bool:
    """True if a hit is before a neighbour, which may go on behind it."""
    is_beside = math.cos(polar[i, 1] - polar[j, 1]) >= math.cos(_HOLE * step)
    return is_beside and polar[i, 0] < polar[j, 0] - _DEEP
