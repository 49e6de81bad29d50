"""`sensor_msgs/PointCloud2` from a sensor: the points at the heights that count."""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from cmpsp_ros.sensing.beams import ScanError, Sensor, Sight, stamp_of
from cmpsp_ros.sensing.point_layout import points_of

MOST: Final = 2_000_000
"""Points in a cloud; more are refused."""


def sight_of(message: Any, sensor: Sensor) -> Sight:
    """The beams to the points of a cloud that are at heights that count, and in reach.

    Points that are not finite are nothing known.

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
    is_in = (points[:, 2] >= low) & (points[:, 2] <= high)
    is_in &= np.hypot(points[:, 0], points[:, 1]) <= sensor.reach
    ends = points[is_in, :2]
    stamp, hits = stamp_of(message), np.ones(len(ends), dtype=bool)
    stamps = np.full(len(ends), stamp, dtype=np.int64)
    return Sight(sensor, stamp, stamps, ends, hits, is_sweep=False)
