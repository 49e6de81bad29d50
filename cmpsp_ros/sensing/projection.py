"""Beams in the frame of odometry, each from where the robot was when it was measured."""

import numpy as np

from cmpsp_ros.arrays import Array
from cmpsp_ros.mpsp.jit import allocation_free
from cmpsp_ros.sensing.beams import Beams, Sight


def projected(sight: Sight, poses: Array) -> Beams:
    """Beams in the frame of odometry, from the robot's pose at each stamp ``(B, 3)``.

    One pose ``(1, 3)`` holds for all.
    """
    ahead, left, turned = sight.sensor.pose
    begins, tips = (np.ascontiguousarray(each, float) for each in (sight.begins, sight.ends))
    starts, ends, origin = np.empty_like(begins), np.empty_like(tips), np.zeros(2)
    cosine, sine = np.cos(poses[:, 2]), np.sin(poses[:, 2])
    offsets = np.column_stack([cosine * ahead - sine * left, sine * ahead + cosine * left])
    angles = poses[:, 2] + turned
    turns = np.column_stack([np.cos(angles), np.sin(angles)])
    project(starts, ends, origin, begins, tips, poses[:, :2] + offsets, turns)
    return Beams(sight.stamp, origin, starts, ends, sight.hits, sight.is_sweep)


@allocation_free
def project(
    starts: Array,
    ends: Array,
    origin: Array,
    begins: Array,
    tips: Array,
    places: Array,
    turns: Array,
) -> None:
    """Fill in where beams start and end, and the mean of the sensor's places.

    `begins` and `tips` are in the sensor's frame; `places` and `turns` (cosine, sine) are those of
    each beam, or one for all.
    """
    for i in range(starts.shape[0]):
        k = min(i, places.shape[0] - 1)
        x, y, cosine, sine = places[k, 0], places[k, 1], turns[k, 0], turns[k, 1]
        starts[i, 0] = x + (cosine * begins[i, 0] - sine * begins[i, 1])
        starts[i, 1] = y + (sine * begins[i, 0] + cosine * begins[i, 1])
        ends[i, 0] = x + (cosine * tips[i, 0] - sine * tips[i, 1])
        ends[i, 1] = y + (sine * tips[i, 0] + cosine * tips[i, 1])
        origin[0], origin[1] = origin[0] + x, origin[1] + y
    # An empty cloud has no beams.
    count = max(starts.shape[0], 1)
    origin[0], origin[1] = origin[0] / count, origin[1] / count
