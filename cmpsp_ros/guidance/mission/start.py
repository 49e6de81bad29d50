"""Where a run may begin: most odometry begins at (0, 0, 0), wherever the course is."""

from __future__ import annotations

import math

from cmpsp_ros.arrays import Array
from cmpsp_ros.guidance.world import GuidanceSettings
from cmpsp_ros.world import FreeSpace


def reason_not_to_begin(settings: GuidanceSettings, pose: Array) -> str:
    """Why no run begins at a pose ``(x, y, heading)`` [m, m, rad], in a sentence; or nothing."""
    limit = settings.start_tolerance
    if settings.start_pose is not None:
        distance, where = math.dist(pose[:2].tolist(), settings.start_pose[:2]), 'from start.pose'
    else:
        distance, where = _distance_from_road(settings, pose), 'off the road'
    if distance <= limit:
        return ''
    return (
        f'The robot is {distance:.3g} m {where}, more than {limit:.3g} m (start.tolerance):'
        ' no run begins there.'
    )


def _distance_from_road(settings: GuidanceSettings, pose: Array) -> float:
    """How far beyond the edges or the ends of the road [m]; 0 on it."""
    road = settings.road
    beside = (-FreeSpace.of(road, (), 0.0).at(pose[None])[0]).tolist()
    return float(max(0.0, road.beyond((float(pose[0]), float(pose[1]))), *beside))
