"""Segments of a scan: neighbouring hits on one object."""

import math
from typing import Final, NamedTuple

import numpy as np

from cmpsp_ros.arrays import Array, BoolArray, IntArray
from cmpsp_ros.sensing.scan_parts import (
    BESIDE,
    LARGEST,
    after_farthest_gap,
    describe,
    divide,
    split,
)

_FEWEST: Final = 3
_LEG: Final = 0.15  # radius up to which a segment may be a leg [m]
_STRIDE: Final = 0.6  # distance of the legs of one person [m]
_SAME: Final = 0.2  # distance of two centres of the same thing [m]
_LATELY: Final = 2_000_000_000  # time for which scenery is remembered, as movers are [ns]


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


class Scenery:
    """Places that lately looked static, and were no mover."""

    def __init__(self) -> None:
        """Start with none."""
        self._scans: list[tuple[int, Array]] = []

    def add(self, stamp: int, places: Array) -> None:
        """Remember places ``(S, 2)`` [m] that a scan shows [ns], and forget old ones."""
        self._scans = [each for each in self._scans if each[0] >= stamp - _LATELY]
        self._scans.append((stamp, places))

    def has(self, places: Array) -> BoolArray:
        """True for those of some places ``(P, 2)`` [m] where it is."""
        known = np.concatenate([np.empty((0, 2)), *(each for _, each in self._scans)])
        away = np.square(places[:, None] - known).sum(axis=2).min(axis=1, initial=math.inf)
        return np.asarray(away <= _SAME * _SAME)


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
    polar, places = seen[order], points[order]
    if begin := after_farthest_gap(polar, places, view[0]):
        order, polar, places = (
            np.concatenate([each[begin:], each[:begin]]) for each in (order, polar, places)
        )
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
    is_object = (table[:, 1] - table[:, 0] >= 2.0) & (table[:, 10] <= LARGEST)
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
    return bool((away <= BESIDE).any())


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
        if is_near and radius <= LARGEST and _nearest(movers, other_x, other_y) == owner:
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
