"""Scans of the last second by direction: was this place free, was something there, or hidden?

A place that two scans in a row have seen through, and where something is now, has been entered.
Nothing that stands still does that, however its view changes.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import IntEnum
from typing import Final

import numpy as np

from cmpsp_ros.arrays import Array, BoolArray, IntArray
from cmpsp_ros.mpsp.jit import allocation_free

N_DIRECTIONS: Final = 720
_WIDTH: Final = math.tau / N_DIRECTIONS
_NS: Final = 1_000_000_000
_OFF: Final = 0.1  # distance by which odometry and beams may be wrong, from 1 m on [m]
_OFF_CLOSE: Final = 0.04  # the same at the sensor, where who stands side by side has to be told [m]
_OFF_BY_RANGE: Final = 0.01
_TURNED: Final = math.radians(1.0)  # angle by which odometry may be wrong
_DENSE, _SPAN, _SLOT = _NS * 55 // 100, _NS * 16 // 10, _NS // 4
"""Ages up to which all scans are kept, and one in each slot of time [ns]."""
_OLDEST: Final = 6 * _NS  # age up to which one a second is kept, for places not shown since [ns]
_BESIDE: Final = 2.0  # distance up to which these count [m]: odometry turns too far later
_RECENT: Final = _SPAN / _NS
_LONG_AGO: Final = 1.0  # age of a hit from which the thing that was hit stands still [s]
_IN_A_ROW: Final = 2
_ENOUGH, _A_MISS, _HOLE = 2.0, 0.4, 4
"""Hits beyond a place that is free, weight of a beam that hits nothing, directions without any."""


class Label(IntEnum):
    """History of the place where a beam ends."""

    NEW = 0
    STATIC = 1
    ENTERED = 2


@dataclass(frozen=True, eq=False)
class View:
    """Nearest hit in each direction of the frame of odometry."""

    stamp: int  # time of its last beam [ns]
    origin: Array  # place from which it was seen, shape ``(2,)`` [m]
    # Distance of hits [m]; where beams have hit nothing their length, negative, and infinite where
    # there are none. Shape ``(N_DIRECTIONS,)``.
    ranges: Array

    @classmethod
    def of(cls, stamp: int, origin: Array, ends: Array, hits: BoolArray) -> View:
        """View by the ends of beams ``(P, 2)`` [m], and whether each has hit something."""
        ranges = np.full(N_DIRECTIONS, np.inf)
        look_at(ranges, origin, ends, hits)
        return cls(stamp, origin, ranges)

    def is_through(self, x: float, y: float) -> bool:
        """True if it shows that nothing is at a place."""
        return status(self.ranges, self.origin, x, y) == _FREE

    def is_blind(self, x: float, y: float) -> bool:
        """True if it has no beam in the direction of a place."""
        place = direction(x - self.origin[0], y - self.origin[1])
        return bool(self.ranges[place] == math.inf)


class ScanHistory:
    """Views of one sensor."""

    def __init__(self) -> None:
        self._views: list[View] = []

    def labels(self, points: Array, stamp: int) -> IntArray:
        """`Label` of points that are hit at a time [ns], shape ``(P,)``."""
        labels = np.zeros(len(points), np.int64)
        if self._views:
            views = self._views[::-1]
            ages = np.array([stamp - each.stamp for each in views]) / _NS
            origins = np.array([each.origin for each in views])
            label(labels, points, np.array([each.ranges for each in views]), origins, ages)
        return labels

    def add(self, view: View) -> None:
        """Keep a view, and drop those that are no longer needed."""
        self._views.append(view)
        kept, before = [], -_NS
        for each in self._views:
            age = view.stamp - each.stamp
            slot = _SLOT if age <= _SPAN else _NS
            if age <= _DENSE or (age <= _OLDEST and each.stamp // slot != before // slot):
                kept.append(each)
            before = each.stamp
        self._views = kept


_UNKNOWN, _FREE, _HIT = 0, 1, 2
_STATIC, _ENTERED = int(Label.STATIC), int(Label.ENTERED)


@allocation_free
def direction(x: float, y: float) -> int:
    """Index of the direction of an offset, negative to the right: those count from the end.

    Abramowitz and Stegun 4.4.49, off by 1e-5 rad: thousands are asked for in a scan.
    """
    low, high = min(abs(x), abs(y)), max(abs(x), abs(y))
    tangent = low / high if high > 0.0 else 0.0
    squared = tangent * tangent
    angle = tangent * (0.9998660 + squared * (-0.3302995 + squared * (
        0.1801410 + squared * (-0.0851330 + squared * 0.0208351))))  # fmt: skip
    angle = math.pi / 2.0 - angle if abs(y) > abs(x) else angle
    angle = math.pi - angle if x < 0.0 else angle
    return math.floor((-angle if y < 0.0 else angle) * (N_DIRECTIONS / math.tau))


@allocation_free
def look_at(ranges: Array, origin: Array, ends: Array, hits: BoolArray) -> None:
    """Enter beams into a view."""
    for i in range(ends.shape[0]):
        x, y = ends[i, 0] - origin[0], ends[i, 1] - origin[1]
        distance = math.sqrt(x * x + y * y)
        if not 0.0 < distance < math.inf:
            continue
        place = direction(x, y)
        if hits[i]:
            ranges[place] = distance if ranges[place] <= 0.0 else min(ranges[place], distance)
        elif ranges[place] == math.inf:
            ranges[place] = -distance


@allocation_free
def status(ranges: Array, origin: Array, at_x: float, at_y: float) -> int:
    """Evidence of a view about a place: that it is free, that something is there, or neither.

    All beams in directions that may be that of the place have to go beyond it.
    """
    x, y = at_x - origin[0], at_y - origin[1]
    distance = math.sqrt(x * x + y * y)
    if distance < _OFF:
        return _UNKNOWN
    off = _OFF_CLOSE + (_OFF - _OFF_CLOSE) * min(distance, 1.0)
    margin = off + _OFF_BY_RANGE * distance
    middle = direction(x, y)
    # A hit at the place itself decides, and there most hits are.
    if abs(ranges[middle] - distance) <= margin:
        return _HIT
    half = 1 + math.ceil(max(off / distance, _TURNED) / _WIDTH)
    beyond, unknown, is_hidden = 0.0, 0, False
    for k in range(middle - half, middle + half + 1):
        found = ranges[k]
        unknown = unknown + 1 if found == math.inf else 0
        if abs(found - distance) <= margin:
            return _HIT
        if abs(found) > distance + margin:
            beyond += (1.0 if found > 0.0 else _A_MISS) * (unknown == 0)
        elif found > 0.0:
            is_hidden = True
        is_hidden |= unknown > _HOLE
    return _FREE if beyond >= _ENOUGH and not is_hidden else _UNKNOWN


@allocation_free
def label(labels: IntArray, points: Array, views: Array, origins: Array, ages: Array) -> None:
    """Label points by views ``(V, N_DIRECTIONS)``, the newest first, with their ages ``(V,)`` [s].

    A single view that saw nothing there between two that did has missed it. Older ones say only of
    places near the sensor that were free, and then out of sight.
    """
    for i in range(points.shape[0]):
        free, oldest, is_recent = 0, 0.0, True
        for k in range(ages.shape[0]):
            if is_recent and ages[k] > _RECENT:
                x, y = points[i, 0] - origins[0, 0], points[i, 1] - origins[0, 1]
                if oldest >= _LONG_AGO or x * x + y * y > _BESIDE * _BESIDE:
                    break
                is_recent = False
            found = status(views[k], origins[k], points[i, 0], points[i, 1])
            if found == _FREE:
                free += 1
                if free == _IN_A_ROW:
                    break
            elif found == _HIT:
                if not is_recent:
                    break
                free, oldest = 0, ages[k]
        if free == _IN_A_ROW:
            labels[i] = _ENTERED
        elif oldest >= _LONG_AGO:
            labels[i] = _STATIC
