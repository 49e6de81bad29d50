"""Pictures of paths on their road, with obstacles, start and goal."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Circle, Patch, Wedge

from cmpsp_ros.guidance.settings import GuidanceSettings
from cmpsp_ros.studies.paper.drives import Drive, Path
from cmpsp_ros.studies.paper.style import PANELS, key_above, strokes
from cmpsp_ros.studies.plot_style import WIDTH
from cmpsp_ros.world.obstacles.shapes import Shape

_ROAD, _EDGE, _OBSTACLE, _RIM = '0.93', '0.55', '0.72', '0.3'
_GUESS = 'green'
_BESIDE = 0.35


def draw_trajectories(
    panels: Sequence[Sequence[Drive]], guess: Path | None = None, *, coincide: bool = False
) -> Figure:
    """Paths of several runs on one road, a panel for each way of driving them.

    Args:
        panels: Runs of each panel, the same experiments in all of them.
        guess: Where the first guess leads, dotted; None to leave it out.
        coincide: Whether several paths are the same.
    """
    figure = Figure(figsize=(WIDTH, 0.575 * WIDTH), layout='constrained')
    looks = strokes(len(panels[0]), coincide=coincide)
    grid = figure.add_gridspec(2, len(panels), height_ratios=(0.09, 1.0))
    for column, (drives, title) in enumerate(zip(panels, PANELS, strict=True)):
        axes = figure.add_subplot(grid[1, column])
        _draw_place(axes, drives)
        if guess is not None:
            axes.plot(*guess.points().T, ls=':', lw=1.2, color=_GUESS, zorder=3)
        for drive, look in zip(drives, looks, strict=True):
            axes.plot(*drive.path.points().T, color=drive.experiment.color, zorder=4, **look)
        _mark_ends(axes, drives)
        axes.set_title(title)
    key_above(figure.add_subplot(grid[0, :]), _keys(panels[0], guess, looks), 4)
    return figure


def _draw_place(axes: Axes, drives: Sequence[Drive]) -> None:
    """Road, centre line and every obstacle that any of the runs has."""
    settings = drives[0].path.settings
    road = settings.annulus
    width = road.outer_radius - road.inner_radius
    axes.add_patch(Wedge(road.center, road.outer_radius, 0, 360, width=width, fc=_ROAD, lw=0))
    for radius, style in (
        (road.inner_radius, '-'),
        (road.outer_radius, '-'),
        (road.center_radius, (0, (1, 3))),
    ):
        axes.add_patch(Circle(road.center, radius, fill=False, ec=_EDGE, ls=style, lw=0.7))
    for obstacle in {each.name: each for drive in drives for each in _obstacles(drive)}.values():
        axes.add_patch(
            Circle(obstacle.center, obstacle.radius, fc=_OBSTACLE, ec=_RIM, lw=0.7, zorder=2)
        )
        # Beside the road, where no path covers it.
        away = np.subtract(obstacle.center, road.center)
        place = road.center + away * ((road.outer_radius + _BESIDE) / np.linalg.norm(away))
        box = {'fc': 'white', 'ec': 'none', 'pad': 0.6}
        axes.annotate(obstacle.name, place, ha='center', va='center', bbox=box, zorder=5)
    _frame(axes, settings)


def _obstacles(drive: Drive) -> tuple[Shape, ...]:
    return drive.path.settings.obstacles


def _frame(axes: Axes, settings: GuidanceSettings) -> None:
    """The quarter of the road that is driven."""
    road = settings.annulus
    x, y = road.center
    room = 0.05 * road.outer_radius
    axes.set(
        xlim=(x - room, x + road.outer_radius + room),
        ylim=(y - road.outer_radius - room, y + 1.5 * room),
        xlabel='x [m]',
        ylabel='y [m]',
        xticks=np.arange(0.0, 12.0, 2.0),
        yticks=np.arange(-10.0, 1.0, 2.0),
    )
    axes.set_aspect('equal')


def _mark_ends(axes: Axes, drives: Sequence[Drive]) -> None:
    start = drives[0].path.poses[0]
    axes.plot(start[0], start[1], 'o', color='white', mec='black', ms=5, zorder=6)
    axes.plot(*drives[0].path.settings.goal, '*', color='white', mec='black', ms=9, zorder=6)


def _keys(
    drives: Sequence[Drive], guess: Path | None, looks: Sequence[dict[str, Any]]
) -> list[Artist]:
    keys: list[Artist] = [
        Line2D([], [], color=drive.experiment.color, label=drive.experiment.label, **look)
        for drive, look in zip(drives, looks, strict=True)
    ]
    if guess is not None:
        keys.append(Line2D([], [], color=_GUESS, ls=':', lw=1.2, label='first guess'))
    start: dict[str, Any] = {'ls': '', 'color': 'white', 'mec': 'black'}
    keys.append(Line2D([], [], marker='o', ms=5, label='start', **start))
    keys.append(Line2D([], [], marker='*', ms=9, label='goal', **start))
    if any(drive.path.settings.obstacles for drive in drives):
        keys.append(Patch(fc=_OBSTACLE, ec=_RIM, lw=0.7, label='obstacle'))
    return keys
