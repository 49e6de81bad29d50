"""ROS messages of sensors: LaserScan and PointCloud2."""

import math
from collections.abc import Sequence
from typing import Any, Final

import numpy as np

from cmpsp_ros.sensing.beams import ScanError, Sensor, Sight

FARTHEST: Final = 1e8  # beyond, squares and differences lose their meaning [m]

_SCAN_NUMBERS: Final = (
    'angle_min',
    'angle_max',
    'angle_increment',
    'time_increment',
    'range_min',
    'range_max',
)
_COUNT_TOLERANCE: Final = 1.5
"""Beams by which count and angles may disagree: drivers differ on whether both ends count."""
_LONGEST_SCAN: Final = 10.0  # maximum duration of a scan [s]
_MAX_POINTS: Final = 2_000_000
_APART: Final = 0.025  # distance of ends of beams that free cells; of nearer ones the first [m]
_TYPES: Final = {1: 'i1', 2: 'u1', 3: 'i2', 4: 'u2', 5: 'i4', 6: 'u4', 7: 'f4', 8: 'f8'}
"""numpy types by datatype of a PointField."""


def stamp_of(message: Any) -> int:
    """Time stamp of a message with a header [ns]."""
    stamp = message.header.stamp
    return int(stamp.sec * 1_000_000_000 + stamp.nanosec)


def is_place(x: float, y: float) -> bool:
    """True if coordinates [m] are those of a place on Earth; NaN is not."""
    return abs(x) <= FARTHEST and abs(y) <= FARTHEST


def sight_of(message: Any, sensor: Sensor) -> Sight:
    """Beams of a `sensor_msgs/LaserScan` or `PointCloud2`, whichever the sensor publishes.

    Ranges of a scan follow REP 117: ``inf`` is free up to ``range_max``, NaN is unknown, and
    ``-inf`` is an obstacle nearer than ``range_min``, which is taken to be there. Finite ranges out
    of bounds are unknown, such as 0 with many sensors.

    A beam of a cloud to the floor, beyond the reach or above all heights that count shows as much
    free space as one to an obstacle: only within reach and at heights that count. Above and below
    them it may pass over an obstacle, or down a staircase. A cloud does not say where the sensor
    looked in vain.

    ScanError if it is in another frame, inconsistent, of too many points, or nothing in it is
    known.
    """
    sensor.check_frame(message)
    return _scan(message, sensor) if sensor.type == 'scan' else _cloud(message, sensor)


def _scan(message: Any, sensor: Sensor) -> Sight:
    _check_scan(message, sensor.name)
    ranges = np.asarray(message.ranges, dtype=float)
    count = len(ranges)
    nearest, farthest = float(message.range_min), min(float(message.range_max), sensor.reach)
    is_met = (ranges >= nearest) & (ranges <= float(message.range_max))
    lengths = np.where(is_met | (ranges == math.inf), np.minimum(ranges, farthest), 0.0)
    is_near = ranges == -math.inf
    lengths[is_near] = nearest
    angles = float(message.angle_min) + float(message.angle_increment) * np.arange(count)
    since = np.round(1e9 * float(message.time_increment) * np.arange(count)).astype(np.int64)
    stamps = stamp_of(message) + since
    return Sight(
        sensor,
        int(stamps[-1]),
        stamps,
        np.zeros((count, 2)),
        lengths[:, None] * np.column_stack([np.cos(angles), np.sin(angles)]),
        (is_met & (ranges <= farthest)) | is_near,
        is_sweep=True,
    )


def _check_scan(message: Any, name: str) -> None:
    for each in _SCAN_NUMBERS:
        number = float(getattr(message, each))
        if not math.isfinite(number):
            raise ScanError(f'{name}: {each}', f'{number}', 'a finite number')
    if not message.angle_increment > 0.0:
        found = f'{message.angle_increment:.9g} rad'
        raise ScanError(f'{name}: angle_increment', found, 'angles that increase')
    if message.time_increment < 0.0:
        raise ScanError(f'{name}: time_increment', f'{message.time_increment:.9g} s', '0 or more')
    if not 0.0 <= message.range_min < message.range_max:
        found = f'{message.range_min:.9g} to {message.range_max:.9g} m'
        raise ScanError(f'{name}: range_min, range_max', found, '0 <= range_min < range_max')
    first, last = float(message.angle_min), float(message.angle_max)
    count, increment = len(message.ranges), float(message.angle_increment)
    fitting = (last - first) / increment + 1.0
    if count == 0 or abs(count - fitting) > _COUNT_TOLERANCE:
        wanted = f'{max(fitting, 1.0):.0f} from angle_min, angle_max and angle_increment'
        raise ScanError(f'{name}: ranges', f'{count}', wanted)
    if (count - 1) * increment > math.tau + increment:
        found = f'{first:.9g} to {last:.9g} rad'
        raise ScanError(f'{name}: angle_max', found, 'a full turn at most')
    ranges = np.asarray(message.ranges, dtype=float)
    is_range = (ranges >= message.range_min) & (ranges <= message.range_max)
    if not (is_range | np.isinf(ranges)).any():
        found = f'{count}, none of them valid, the first {ranges[0]:.9g}'
        raise ScanError(f'{name}: ranges', found, f'one of {message.range_min:.9g} m or more')
    duration = (count - 1) * float(message.time_increment)
    if duration > _LONGEST_SCAN:
        found = f'{message.time_increment:.9g} s, {duration:.3g} s in all'
        raise ScanError(f'{name}: time_increment', found, f'at most {_LONGEST_SCAN} s in all')


def _cloud(message: Any, sensor: Sensor) -> Sight:
    count = int(message.width) * int(message.height)
    if count > _MAX_POINTS:
        found, wanted = f'{count} points', f'{_MAX_POINTS} at most'
        raise ScanError(f'{sensor.name}: width, height', found, wanted)
    rows = points_of(message, ('x', 'y', 'z'), (), sensor.name)
    points = np.column_stack([rows[name].astype(float) for name in ('x', 'y', 'z')])
    points = points[np.isfinite(points).all(axis=1)]
    if count and not len(points):
        raise ScanError(f'{sensor.name}: data', f'{count} points, none finite', 'a finite point')
    low, high = sensor.heights
    places, z = points[:, :2], points[:, 2]
    away = np.hypot(places[:, 0], places[:, 1])
    is_hit = (z >= low) & (z <= high) & (away <= sensor.reach)
    # A level beam is at one height all along: 0 / 0 is NaN, which fmax and fmin ignore.
    with np.errstate(divide='ignore', invalid='ignore'):
        one, other, longest = low / z, high / z, sensor.reach / away
    first = np.fmin(np.fmax(np.minimum(one, other), 0.0), 1.0)
    last = np.fmax(np.fmin(np.fmin(np.maximum(one, other), longest), 1.0), 0.0)
    begins, ends = first[:, None] * places, last[:, None] * places
    hits, frees = np.flatnonzero(is_hit), np.flatnonzero(~is_hit & (first < last))
    cells = np.round(ends[frees] / _APART)
    _, chosen = np.unique(cells @ (2.0**20, 1.0), return_index=True)
    beams = np.concatenate([hits, frees[np.sort(chosen)]])
    stamp = stamp_of(message)
    stamps = np.full(len(beams), stamp, dtype=np.int64)
    return Sight(sensor, stamp, stamps, begins[beams], ends[beams], is_hit[beams], is_sweep=False)


def points_of(message: Any, floats: Sequence[str], integers: Sequence[str], name: str) -> Any:
    """Points of a PointCloud2 of any layout, as a structured array of shape ``(K,)``.

    Fields named in `floats` and `integers` have any length, `name` is the source of the cloud.
    Raises ScanError if it lacks a field, or does not fit its own sizes.
    """
    width, height, step = int(message.width), int(message.height), int(message.point_step)
    order = '>' if message.is_bigendian else '<'
    present = {field.name: field for field in message.fields}
    names, formats, offsets = [*floats, *integers], [], []
    for each in names:
        field, kinds = present.get(each), 'f' if each in floats else 'iu'
        form = '' if field is None else _TYPES.get(int(field.datatype), '')
        if field is None or form[:1] not in kinds or not form or int(field.count) not in (0, 1):
            wanted = 'a float32 or float64' if each in floats else 'an integer'
            found = 'none' if field is None else f'{field.count} of datatype {field.datatype}'
            raise ScanError(f'{name}: field {each!r}', found, wanted)
        formats.append(order + form)
        offsets.append(int(field.offset))
    row, data = int(message.row_step), np.frombuffer(message.data, dtype=np.uint8)
    fits = all(
        at + np.dtype(form).itemsize <= step for at, form in zip(offsets, formats, strict=True)
    )
    if not fits or row < step * width or len(data) < row * height:
        wanted = f'{height} rows of {row} with {width} points of {step}, each with its fields'
        raise ScanError(f'{name}: data', f'{len(data)} bytes', wanted)
    layout = np.dtype(
        {'names': names, 'formats': formats, 'offsets': offsets, 'itemsize': max(step, 1)}
    )
    rows = data[: row * height].reshape(height, row)[:, : step * width]
    return np.frombuffer(rows.tobytes(), dtype=layout)
