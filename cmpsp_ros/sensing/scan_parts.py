"""Parts of a scan that are on one object: compiled, for every hit is looked at."""

import math
from typing import Final

from cmpsp_ros.arrays import Array, BoolArray, IntArray
from cmpsp_ros.mpsp.jit import allocation_free
from cmpsp_ros.sensing.scan_history import Label

_GAP: Final = 0.1  # distance of neighbours on one object [m]
_GAP_BY_STEP: Final = 1.5  # the same, by that of two beams at their range
_HOLE: Final = 5.5  # angle between neighbours on one object, in steps of the scanner
_SLIT: Final = 0.04  # width up to which a hole is no gap between two objects [m]
_DEEP: Final = 0.1  # depth of the notch between two round objects that touch [m]
_WIDE: Final = 0.8  # width of more than one person, and of each part then [m]
_PERSON: Final = 0.6
_LONG: Final = 2.5  # width from which it is a wall, which does not move [m]
_ONE: Final = 0.35  # radius from which it may be two people [m]
LARGEST: Final = 0.6  # radius of the largest object [m]; walls and what has parts are larger
_AROUND: Final = 0.15  # distance from where a mover is expected at which a hit may be on it [m]
BESIDE: Final = 0.05  # distance from a mover up to which the nearest hit of a segment is on it [m]
_STATIC, _ENTERED = int(Label.STATIC), int(Label.ENTERED)


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

    Their number is returned, or -1 where a wall is where nothing was: odometry has jumped.
    """
    count = 0
    for k in range(bounds.shape[0] - 1):
        begin, last = bounds[k], bounds[k + 1]
        parts[count] = begin
        count += 1
        if not _assign(keys, polar, places, labels, movers, begin, last, step):
            continue
        while begin < last:
            end = begin + 1
            while end < last and keys[end] == keys[begin]:
                end += 1
            if begin > bounds[k]:
                parts[count] = begin
                count += 1
            width = _apart(places, begin, end - 1)
            if keys[begin] == -_ENTERED and width > _LONG:
                return -1
            is_long = keys[begin] == -_ENTERED and width > _WIDE
            is_seen_close = keys[begin] != -_STATIC and _radius(polar, begin, end, step) > LARGEST
            if is_long or is_seen_close:
                count = _cut(parts, count, places, begin, end, width)
            begin = end
    parts[count] = bounds[bounds.shape[0] - 1]
    return count


@allocation_free
def _assign(
    keys: IntArray,
    polar: Array,
    places: Array,
    labels: IntArray,
    movers: Array,
    first: int,
    last: int,
    step: float,
) -> bool:
    """Fill in the keys of a segment's hits, equal in one part; False if it has no parts.

    One that is not wide is divided between several movers on it, or into one who stands and the
    rest.
    """
    is_wide = _is_wide(polar, places, first, last, step)
    if not is_wide and _radius(polar, first, last, step) <= _ONE:
        return False
    lowest, highest = movers.shape[0], -1
    for i in range(first, last):
        keys[i] = _key(places, labels, movers, i)
        if keys[i] >= 0:
            lowest, highest = min(lowest, keys[i]), max(highest, keys[i])
    if not is_wide:
        if lowest > highest or (lowest == highest and movers[lowest, 3] == 0.0):
            return False
        for i in range(first, last):
            keys[i] = _nearest_to(places, movers, i)
            if lowest == highest and _off(places, movers, i, lowest) > BESIDE:
                keys[i] = -_STATIC
    for i in range(first + 1, last - 1):
        if keys[i] < 0 and keys[i - 1] == keys[i + 1]:
            keys[i] = keys[i - 1]
    return True


@allocation_free
def _cut(parts: IntArray, count: int, places: Array, begin: int, end: int, width: float) -> int:
    """Cut hits into pieces as wide as a person, two at least; the number of parts after it."""
    pieces, piece = max(math.ceil(width / _PERSON), 2), 1
    for i in range(begin + 1, end):
        if piece < pieces and _apart(places, begin, i) * pieces > piece * width:
            parts[count] = i
            count, piece = count + 1, piece + 1
    return count


@allocation_free
def _is_wide(polar: Array, places: Array, first: int, last: int, step: float) -> bool:
    """True if hits are on more than one person, who may be close to the sensor."""
    is_long = _apart(places, first, last - 1) > _WIDE
    return is_long or _radius(polar, first, last, step) > LARGEST


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
def _key(places: Array, labels: IntArray, movers: Array, i: int) -> int:
    """Index of the mover that a point is on, or its label below zero."""
    is_static = labels[i] == _STATIC
    best, key = _AROUND, -_ENTERED if labels[i] == _ENTERED else -_STATIC
    for j in range(movers.shape[0]):
        is_far = abs(places[i, 0] - movers[j, 0]) - movers[j, 2] >= best
        if is_far or (is_static and movers[j, 3] == 0.0):
            continue
        away = _off(places, movers, i, j)
        if away < best and (not is_static or away <= BESIDE):
            best, key = away, j
    return key


@allocation_free
def _nearest_to(places: Array, movers: Array, i: int) -> int:
    """Index of the mover nearest to a point."""
    nearest = 0
    for j in range(1, movers.shape[0]):
        if _off(places, movers, i, j) < _off(places, movers, i, nearest):
            nearest = j
    return nearest


@allocation_free
def _off(places: Array, movers: Array, i: int, j: int) -> float:
    """Distance of a point from a mover, negative in it."""
    return math.hypot(places[i, 0] - movers[j, 0], places[i, 1] - movers[j, 1]) - movers[j, 2]


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


@allocation_free
def keep_within(chosen: BoolArray, points: Array, discs: Array) -> None:
    """Unset those of the chosen points that are in none of some discs (x, y, radius)."""
    for i in range(points.shape[0]):
        is_within = False
        for j in range(discs.shape[0]):
            x, y = points[i, 0] - discs[j, 0], points[i, 1] - discs[j, 1]
            is_within |= x * x + y * y < discs[j, 2] * discs[j, 2]
        chosen[i] &= is_within
