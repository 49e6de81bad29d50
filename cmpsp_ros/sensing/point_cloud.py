"""`sensor_msgs/PointCloud2` from a sensor: beams, as far as they are at the heights that count.

A beam to a point on the floor, beyond the reach or above all that counts shows as much free space
as one to an obstacle: where it is at heights that count, and within reach. Above and below them it
shows nothing: it may pass over an obstacle that no other beam meets, or down a staircase. Where
there is no point there is no beam: a cloud does not say where the sensor has looked in vain.
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from cmpsp_ros.sensing.beams import ScanError, Sensor, Sight, stamp_of
from cmpsp_ros.sensing.point_layout import points_of

MOST: Final = 2_000_000
"""Points in a cloud; more are refused."""

_APART: Final = 0.025
"""Distance of the ends of beams that free cells; of nearer ones the first counts [m]."""


def sight_of(message: Any, sensor: Sensor) -> Sight:
    """The beams of a cloud, as far as they are at heights that count and in reach.

    Points that are not finite are nothing known, whether the cloud is organised or not.

    Args:
        message: A `sensor_msgs/PointCloud2` with fields ``x``, ``y`` and ``z`` [m].
        sensor: Where it comes from.

    Raises:
        ScanError: It is in another frame, lacks a field or does not fit its sizes, or has too many
            points, or none that is finite.
    """
    sensor.check_frame(message)
    count = int(message.width) * int(message.height)
    if count > MOST:
        raise ScanError(f'{sensor.name}: width, height', f'{count} points', f'{MOST} at most')
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
