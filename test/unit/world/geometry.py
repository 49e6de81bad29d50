"""Clearances from the definitions, in plain numpy: dense samples, and no compiled code of ours.

A robot is driven by the midpoint rule, its outline is sampled all around, and the distance of each
point of it from every road edge and obstacle is computed by brute force. `DENSE` is the error.
"""

import math
from itertools import pairwise

import numpy as np
from scipy.interpolate import CubicSpline, PchipInterpolator

PIECES = 300
DENSE = 2e-3


def driven(pose, twists, durations):
    """Times and poses along a drive under twists (forward, left, turning), by the midpoint rule."""
    x, y, heading = pose
    times, poses, clock = [0.0], [(x, y, heading)], 0.0
    for (forward, left, turning), duration in zip(twists, durations, strict=True):
        step = duration / PIECES
        for _ in range(PIECES):
            middle = heading + turning * step / 2.0
            x += step * (forward * math.cos(middle) - left * math.sin(middle))
            y += step * (forward * math.sin(middle) + left * math.cos(middle))
            heading, clock = heading + turning * step, clock + step
            times.append(clock)
            poses.append((x, y, heading))
    return np.array(times), np.array(poses)


def placed(points, poses):
    """Points of the robot's frame ``(P, 2)`` at poses ``(K, 3)``; shape ``(K, P, 2)``."""
    cosine, sine = np.cos(poses[:, 2]), np.sin(poses[:, 2])
    turn = np.array([[cosine, -sine], [sine, cosine]]).transpose(2, 0, 1)
    return poses[:, None, :2] + points @ turn.transpose(0, 2, 1)


def outline(corners, count=120):
    """Points all around a polygon, shape ``(P, 2)``."""
    corners = np.array(corners, dtype=float)
    part = np.linspace(0.0, 1.0, count, endpoint=False)[:, None]
    after = np.roll(corners, -1, axis=0)
    return np.vstack([a + part * (b - a) for a, b in zip(corners, after, strict=True)])


def from_line(points, line, *, closed):
    """Distance of points ``(..., 2)`` from a line through points ``(K, 2)``."""
    line = np.array([*line, line[0]] if closed else line, dtype=float)
    least = np.full(points.shape[:-1], math.inf)
    for a, b in pairwise(line):
        along = b - a
        part = np.clip((points - a) @ along / max(along @ along, 1e-300), 0.0, 1.0)
        away = points - (a + part[..., None] * along)
        least = np.minimum(least, np.hypot(away[..., 0], away[..., 1]))
    return least


def from_disc(points, center, radius):
    return np.hypot(*np.moveaxis(points - np.array(center), -1, 0)) - radius


def from_capsule(points, start, end, radius):
    return from_line(points, [start, end], closed=False) - radius


def from_polygon(points, vertices):
    """Signed: negative inside."""
    vertices = np.array(vertices, dtype=float)
    sides = np.roll(vertices, -1, axis=0) - vertices
    to = points[..., None, :] - vertices
    crosses = sides[:, 0] * to[..., 1] - sides[:, 1] * to[..., 0]
    inside = (crosses > 0.0).all(axis=-1) | (crosses < 0.0).all(axis=-1)
    return np.where(inside, -1.0, 1.0) * from_line(points, vertices, closed=True)


def from_cells(points, origin, resolution, occupied):
    """Distance from occupied cells, closed squares in rows along x; 0 inside."""
    x, y, heading = origin
    cosine, sine = math.cos(heading), math.sin(heading)
    dx, dy = points[..., 0] - x, points[..., 1] - y
    u, v = (cosine * dx + sine * dy) / resolution, (cosine * dy - sine * dx) / resolution
    least = np.full(points.shape[:-1], math.inf)
    for row, column in np.argwhere(occupied):
        off_u = np.maximum(np.abs(u - column - 0.5) - 0.5, 0.0)
        off_v = np.maximum(np.abs(v - row - 0.5) - 0.5, 0.0)
        least = np.minimum(least, np.hypot(off_u, off_v))
    return least * resolution


def from_moving_disc(points, times, state, growth):
    """Distance of points ``(K, P, 2)`` at times ``(K,)`` from a disc (x, y, u, v, radius)."""
    x, y, u, v, radius = state
    centers = np.array([x, y]) + times[:, None] * np.array([u, v])
    away = points - centers[:, None]
    return np.hypot(away[..., 0], away[..., 1]) - radius - growth * times[:, None]


def from_circles(points, center, inner, outer):
    """Distances from the outer and the inner edge of an annulus, negative beyond them."""
    distance = np.hypot(*np.moveaxis(points - np.array(center), -1, 0))
    return outer - distance, distance - inner


def from_corridor(points, line, left, right, *, closed, spacing=0.02):
    """Distances from the left and the right edge of a corridor, negative beyond them.

    The cubic spline through the points of the centre line by its own length, and widths by
    monotone pieces, which are level at both ends.
    """
    line, left, right = (
        np.array([*each, each[0]] if closed else each) for each in (line, left, right)
    )
    knots = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(line, axis=0).T))])
    kind = 'periodic' if closed else 'natural'
    for _ in range(4):
        spline = CubicSpline(knots, line, bc_type=kind)
        fine = np.linspace(knots[0], knots[-1], 20_001)
        lengths = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(spline(fine), axis=0).T))])
        knots = np.interp(knots, fine, lengths)
    spline = CubicSpline(knots, line, bc_type=kind)
    at = np.linspace(0.0, knots[-1], math.ceil(knots[-1] / spacing))
    along = spline(at, 1)
    normal = np.column_stack([-along[:, 1], along[:, 0]]) / np.hypot(*along.T)[:, None]
    center, widths = spline(at), [PchipInterpolator(knots, each)(at) for each in (left, right)]
    flat = points.reshape(-1, 2)
    nearest = np.argmin(np.hypot(*(flat[:, None] - center).transpose(2, 0, 1)), axis=1)
    off = ((flat - center[nearest]) * normal[nearest]).sum(axis=1)
    found = []
    for side, width in zip((1.0, -1.0), widths, strict=True):
        edge = center + side * width[:, None] * normal
        close = np.hypot(*(flat[:, None] - edge).transpose(2, 0, 1)).min(axis=1)
        within = side * off <= width[nearest]
        found.append(np.where(within, close, -close).reshape(points.shape[:-1]))
    return found
