"""Exact distances between points and the arcs that the robot drives under constant speeds."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

# Below this turn [rad] an arc is taken for its chord, from which it is nowhere further than
# 1.3e-8 of its length; the centre of a flatter arc is too far away to measure from.
_STRAIGHT = 1e-7


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

    radius = length / np.where(bent, turn, 1.0)
    heading = poses[:, 2]
    normal = np.column_stack([-np.sin(heading), np.cos(heading)])
    centers = starts + (radius[:, None] * normal)[:, None, :]
    out = points - centers
    distance = np.linalg.norm(out, axis=2)
    side = np.sign(radius)[:, None]
    facing = np.arctan2(side * out[:, :, 0], -side * out[:, :, 1])
    size = np.abs(radius)[:, None]
    for angle, extreme, fold in (
        (facing, np.abs(distance - size), np.minimum),
        (facing + np.pi, distance + size, np.maximum),
    ):
        passed = np.mod((angle - heading[:, None]) * np.sign(turn)[:, None], 2.0 * np.pi)
        on_arc = bent[:, None] & (passed <= np.abs(turn)[:, None])
        if fold is np.minimum:
            least = np.where(on_arc, fold(least, extreme), least)
        else:
            greatest = np.where(on_arc, fold(greatest, extreme), greatest)
    return least, greatest
