"""Exact distances between points and the arcs that the robot drives under constant speeds."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

# Below this turn [rad] an arc is taken for its chord, from which it is nowhere further than an
# eighth of that part of its length.
_STRAIGHT = 1e-10


def arc_ends(poses: Array, twists: Array, durations: Array) -> Array:
    """Pose at the end of each arc.

    Args:
        poses: Pose at the start of each arc, shape ``(N, 3)`` [m, m, rad].
        twists: Speed and turn rate along it, shape ``(N, 2)`` [m/s, rad/s].
        durations: Shape ``(N,)`` [s].

    Returns:
        Shape ``(N, 3)``; headings are not wrapped.
    """
    x, y, heading = poses.T
    length, turn = twists[:, 0] * durations, twists[:, 1] * durations
    middle = heading + turn / 2.0
    chord = length * np.sinc(turn / (2.0 * np.pi))
    return np.column_stack([x + chord * np.cos(middle), y + chord * np.sin(middle), heading + turn])


def reach(poses: Array, twists: Array, durations: Array, points: Array) -> tuple[Array, Array]:
    """Least and greatest distance of each arc, from end to end, to each point.

    Args:
        poses: Pose at the start of each arc, shape ``(N, 3)`` [m, m, rad].
        twists: Speed and turn rate along it, shape ``(N, 2)`` [m/s, rad/s].
        durations: Shape ``(N,)`` [s].
        points: Shape ``(M, 2)`` [m].

    Returns:
        Two arrays of shape ``(N, M)`` [m].
    """
    starts = poses[:, None, :2]
    ends = arc_ends(poses, twists, durations)[:, None, :2]
    at_start = np.linalg.norm(points - starts, axis=2)
    at_end = np.linalg.norm(points - ends, axis=2)
    least, greatest = np.minimum(at_start, at_end), np.maximum(at_start, at_end)

    length, turn = twists[:, 0] * durations, twists[:, 1] * durations
    bent = np.abs(turn) > _STRAIGHT
    chord = ends - starts
    squared = (chord**2).sum(axis=2)
    along = ((points - starts) * chord).sum(axis=2) / np.where(squared > 0.0, squared, 1.0)
    foot = starts + np.clip(along, 0.0, 1.0)[:, :, None] * chord
    to_chord = np.linalg.norm(points - foot, axis=2)
    least = np.where(bent[:, None], least, to_chord)

    R = (length / np.where(bent, turn, 1.0))[:, None]
    heading = poses[:, 2, None]
    out = points - starts
    # Components of `out` across the start's heading, towards the arc's centre, and along it.
    across = np.cos(heading) * out[:, :, 1] - np.sin(heading) * out[:, :, 0]
    ahead = np.cos(heading) * out[:, :, 0] + np.sin(heading) * out[:, :, 1]
    excess = (out**2).sum(axis=2) - 2.0 * R * across
    distance = np.sqrt(np.maximum(R * R + excess, 0.0))
    # Distance from the circle, without the difference of two numbers as large as its radius.
    far = distance + np.abs(R)
    near = np.abs(excess) / np.where(far > 0.0, far, 1.0)
    # Angle, about the centre, from the start on to where the arc passes the point.
    bearing = np.arctan2(R * ahead, R * R - R * across) * np.sign(turn)[:, None]
    for angle, extreme, fold, best in (
        (bearing, near, np.minimum, least),
        (bearing + np.pi, far, np.maximum, greatest),
    ):
        passed = bent[:, None] & (np.mod(angle, 2.0 * np.pi) <= np.abs(turn)[:, None])
        best[passed] = fold(best[passed], extreme[passed])
    return least, greatest
