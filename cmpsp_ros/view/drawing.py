"""Roads, obstacles and paths in matplotlib's axes."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import PathPatch
from matplotlib.path import Path
from matplotlib.patheffects import withStroke
from numpy.typing import NDArray

from cmpsp_ros.robots.arcs import arc_ends
from cmpsp_ros.view.scene import LOOKS, Part
from cmpsp_ros.world.obstacles.shapes import Shape, outlines
from cmpsp_ros.world.roads.road import Road

Array = NDArray[np.float64]

PER_ARC = 8
"""Points drawn on each arc."""

_ENDS = 'start and end'
_DASHES = {'solid': '-', 'dash': '--', 'dot': ':', 'dashdot': '-.'}
"""Matplotlib's names for plotly's."""


def draw_road(axes: Axes, road: Road, face: str, edge: str) -> None:
    """Draw a road, its edges and its centre line below everything else, in two colours."""
    axes.fill(*road.area().T, color=face, lw=0.0, zorder=0)
    for line in road.edges():
        axes.plot(*line.T, color=edge, lw=1.0, zorder=1)
    axes.plot(*road.center_line().T, color=edge, lw=1.0, ls=':', zorder=1)


def draw_obstacles(axes: Axes, obstacles: Iterable[Shape], **look: Any) -> None:
    """Draw obstacles in a look of one's own, below paths."""
    for each in obstacles:
        lines = (Path(line, closed=True) for line in outlines(each, each.radius))
        edge = Path.make_compound_path(*lines)
        axes.add_patch(PathPatch(edge, **{'zorder': 2, **look}))


def draw(axes: Axes, parts: Iterable[Part], color: str = '', alpha: float = 1.0) -> None:
    """Draw parts of a scene; each kind is named once for a legend.

    Args:
        axes: Where to.
        parts: What to draw.
        color: Of kinds that have the colour of their run.
        alpha: Opacity.
    """
    kinds = list(LOOKS)
    for part in parts:
        look = part.look
        if not part.lines:
            continue
        known = axes.get_legend_handles_labels()[1]
        shape = Path.make_compound_path(*map(Path, part.lines))
        axes.add_patch(
            PathPatch(
                shape, fc=look.fill or 'none', ec=look.color or color, lw=look.width, alpha=alpha,
                ls=_DASHES[look.dash], zorder=1.0 + kinds.index(part.kind) / len(kinds),
                label=None if look.label in known else look.label,
            )
        )  # fmt: skip
        inside, around = look.of_names
        for name, place in part.names:
            axes.annotate(
                plain_text(name), place, color=inside, ha='center', va='center', zorder=6,
                size='small', path_effects=[withStroke(linewidth=2.0, foreground=around)],
            )  # fmt: skip


def draw_ends(axes: Axes, poses: Array, color: Any) -> None:
    """Draw a triangle that points ahead at the first and the last of poses ``(N, 3)``."""
    known = axes.get_legend_handles_labels()[1]
    look = {'color': color, 'ms': 9, 'mec': 'white', 'ls': ''}
    # A start is above another robot's end.
    for index, order, label in ((-1, 7, None), (0, 8, None if _ENDS in known else _ENDS)):
        x, y, heading = poses[index].tolist()
        marker = (3, 0, math.degrees(heading) - 90.0)
        axes.plot(x, y, marker=marker, zorder=order, label=label, **look)


def plain_text(text: str) -> str:
    """Text with dollar signs escaped: they would begin a formula."""
    return text.replace('$', r'\$')


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
