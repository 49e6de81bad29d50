"""`sensor_msgs/LaserScan`: what is wrong with one, and the beams of one that is right."""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np

from cmpsp_ros.sensing.beams import ScanError, Sensor, Sight, stamp_of

_NUMBERS: Final = (
    'angle_min',
    'angle_max',
    'angle_increment',
    'time_increment',
    'range_min',
    'range_max',
)
_OFF_BY: Final = 1.5
"""Beams by which count and angles may disagree: drivers differ on whether both ends count."""

_LONGEST: Final = 10.0
"""Time that a scan may take [s]."""


def sight_of(message: Any, sensor: Sensor) -> Sight:
    """The beams of a scan.

    A range is what REP 117 says: ``inf`` is free up to ``range_max``, NaN is nothing known, and at
    ``-inf`` there is something nearer than ``range_min``, which is taken to be there. What is
    finite but out of range is nothing known, as 0 is with many sensors.

    Args:
        message: A `sensor_msgs/LaserScan`.
        sensor: Where it comes from.

    Raises:
        ScanError: It is in another frame, a number in its header is not finite, its angles do not
            increase or do not fit the number of ranges, or it has no ranges or knows nothing.
    """
    sensor.check_frame(message)
    _check_header(message, sensor.name)
    ranges = np.asarray(message.ranges, dtype=float)
    count, increment = len(ranges), float(message.angle_increment)
    _check_count(message, count, sensor.name)
    if np.isnan(ranges).all():
        raise ScanError(f'{sensor.name}: ranges', f'{count} times NaN', 'a range')
    duration = (count - 1) * float(message.time_increment)
    if duration > _LONGEST:
        found = f'{message.time_increment:.9g} s, {duration:.3g} s in all'
        raise ScanError(f'{sensor.name}: time_increment', found, f'at most {_LONGEST} s in all')
    nearest, farthest = float(message.range_min), min(float(message.range_max), sensor.reach)
    is_met = (ranges >= nearest) & (ranges <= float(message.range_max))
    lengths = np.where(is_met | (ranges == math.inf), np.minimum(ranges, farthest), 0.0)
    is_near = ranges == -math.inf
    lengths[is_near] = nearest
    angles = float(message.angle_min) + increment * np.arange(count)
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


def _check_header(message: Any, name: str) -> None:
    for each in _NUMBERS:
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


def _check_count(message: Any, count: int, name: str) -> None:
    first, last = float(message.angle_min), float(message.angle_max)
    increment = float(message.angle_increment)
    fitting = (last - first) / increment + 1.0
    if count == 0 or abs(count - fitting) > _OFF_BY:
        wanted = f'{max(fitting, 1.0):.0f} from angle_min, angle_max and angle_increment'
        raise ScanError(f'{name}: ranges', f'{count}', wanted)
    if (count - 1) * increment > math.tau + increment:
        found = f'{first:.9g} to {last:.9g} rad'
        raise ScanError(f'{name}: angle_max', found, 'a full turn at most')
