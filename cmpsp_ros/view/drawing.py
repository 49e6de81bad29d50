"""Roads, obstacles and paths in matplotlib's axes."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import PathPatch
from matplotlib.path import Path
from numpy.typing import NDArray

from cmpsp_ros.guidance.settings import MAP, GuidanceSettings
from cmpsp_ros.robots.arcs import arc_ends
from cmpsp_ros.view.palette import EDGE, OBSTACLE, ROAD
from cmpsp_ros.world.obstacles.shapes import Shape, outlines
from cmpsp_ros.world.roads.road import Road

Array = NDArray[np.float64]

PER_ARC = 8
"""Points drawn on each arc."""

_WHOLE_MAP = 20.0
"""Side up to which a map is shown as a whole [m]."""


def draw_road(axes: Axes, road: Road, face: str = ROAD, edge: str = EDGE) -> None:
    """Draw a road, its edges and its centre line below everything else, in two colours."""
    axes.fill(*road.area().T, color=face, lw=0.0, zorder=0)
    for line in road.edges():
        axes.plot(*line.T, color=edge, lw=1.0, zorder=1)
    axes.plot(*road.center_line().T, color=edge, lw=1.0, ls=':', zorder=1)


def draw_obstacles(axes: Axes, obstacles: Iterable[Shape], **look: Any) -> None:
    """Draw obstacles, below paths."""
    for each in obstacles:
        edge = _path(each, each.radius)
        axes.add_patch(PathPatch(edge, **{'fc': OBSTACLE, 'lw': 0.0, 'zorder': 2, **look}))


def draw_around(axes: Axes, obstacle: Shape, distance: float, color: str = OBSTACLE) -> None:
    """Draw the closest that the robot's centre may come to an obstacle, dashed."""
    around = _path(obstacle, distance)
    axes.add_patch(PathPatch(around, fill=False, ec=color, ls='--', zorder=2))


def map_corners(settings: GuidanceSettings) -> Array:
    """Corners of the map ``(4, 2)`` [m]; none if it is so large that a path would be lost on it."""
    known = settings.grid(MAP)
    if known is None or max(known.grid.size) > _WHOLE_MAP:
        return np.empty((0, 2))
    return known.grid.ends


def _path(obstacle: Shape, distance: float) -> Path:
    lines = [Path(line, closed=True) for line in outlines(obstacle, distance)]
    return Path.make_compound_path(*lines)


def along(poses: Array, twists: Array, durations: Array) -> Array:
    """Positions along arcs, several on each to show its curvature, shape ``(K, 2)``.

    Args:
        poses: At the beginning of each arc and the end of the last, ``(N + 1, 3)`` [m, m, rad].
        twists: Speed and turn rate on each, ``(N, 2)`` [m/s, rad/s].
        durations: Of each, ``(N,)`` [s].
    """
    parts = np.linspace(0.0, 1.0, PER_ARC, endpoint=False)
    begins = np.repeat(poses[:-1], PER_ARC, axis=0)
    since = (durations[:, None] * parts).ravel()
    points = arc_ends(begins, np.repeat(twists, PER_ARC, axis=0), since)
    return np.vstack([points[:, :2], poses[-1:, :2]])


def show(axes: Axes, points: Sequence[Array], room: float) -> tuple[float, float]:
    """Show points and some room [m] around them, at one scale; width and height of that [m]."""
    every = np.vstack(points)
    (left, bottom), (right, top) = every.min(axis=0) - room, every.max(axis=0) + room
    axes.set(xlim=(left, right), ylim=(bottom, top), xlabel='x [m]', ylabel='y [m]')
    axes.set_aspect('equal')
    return right - left, top - bottom
