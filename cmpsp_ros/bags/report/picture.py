"""The report on one sheet, as a picture."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import cycle
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from cmpsp_ros.bags.errors import BagError
from cmpsp_ros.bags.report.path_chart import frame, obstacles
from cmpsp_ros.bags.report.slider import goals_of, tracks_of_each
from cmpsp_ros.bags.report.view import View
from cmpsp_ros.view.drawing import draw_around, draw_footprints, draw_obstacles, draw_road
from cmpsp_ros.view.palette import GOAL, GRID, LEVEL_COLORS, LIMIT, OBSTACLE, bag_color


def draw(views: Sequence[View], output: Path) -> None:
    """Draw path, fallback levels, wheel speeds, clearance and step times.

    Raises:
        BagError: The picture cannot be written.
    """
    figure = Figure(figsize=(14.0, 8.0), layout='constrained')
    grid = figure.add_gridspec(4, 2, width_ratios=[5, 6], height_ratios=[1, 3, 3, 3])
    _draw_path(figure.add_subplot(grid[:, 0]), views)
    shown: Axes | None = None
    for row, draw_one in enumerate((_draw_levels, _draw_wheels, _draw_clearance, _draw_steps)):
        axes = figure.add_subplot(grid[row, 1], sharex=shown)
        draw_one(axes, views)
        axes.grid(color=GRID)
        axes.set_axisbelow(True)
        axes.tick_params(labelbottom=row == 3)
        shown = axes
    if shown is not None:
        shown.set(xlabel='time [s]', xlim=(0.0, max(view.end for view in views)))
    try:
        figure.savefig(output, dpi=110)
    except OSError as error:
        raise BagError(f'{output}: cannot be written: {error.strerror or error}') from error


def _draw_path(axes: Axes, views: Sequence[View]) -> None:
    for road in dict.fromkeys(road for view in views for road in view.roads):
        draw_road(axes, road)
    for obstacle, kept in obstacles(views).items():
        draw_obstacles(axes, [obstacle])
        draw_around(axes, obstacle, kept)
        if obstacle.corners:
            name = _plain(obstacle.name)
            axes.text(*obstacle.center, name, color='white', ha='center', va='center')
    for tracks in (each for view in views for each in tracks_of_each(view)):
        x, y = [each.x for each in tracks], [each.y for each in tracks]
        axes.plot(x, y, color=OBSTACLE, ls='-.', lw=1.2, zorder=3)
    for number, view in enumerate(views):
        color = bag_color(number)
        axes.plot(*view.poses[:, :2].T, color=color, lw=2.0, label=_plain(view.label), zorder=4)
        axes.plot(*view.poses[0, :2], 'o', color=color, ms=7, zorder=5)
        draw_footprints(axes, view.settings, view.poses, color)
    for goal in goals_of(views):
        axes.plot(*goal.position, '*', color=GOAL, ms=14, zorder=5)
        axes.annotate(_plain(goal.name), goal.position, (6, 6), textcoords='offset points')
    (left, right), (bottom, top) = frame(views)
    axes.set(xlim=(left, right), ylim=(bottom, top), xlabel='x [m]', ylabel='y [m]')
    axes.set_aspect('equal')
    axes.legend(loc='best')


def _draw_levels(axes: Axes, views: Sequence[View]) -> None:
    for number, view in enumerate(views):
        for band in view.bands:
            color = LEVEL_COLORS.get(band.level, 'white')
            axes.barh(number, band.end - band.begin, 0.6, left=band.begin, color=color)
    there = {band.level for view in views for band in view.bands}
    keys = [
        Patch(color=color, label=level) for level, color in LEVEL_COLORS.items() if level in there
    ]
    if keys:
        axes.legend(handles=keys, ncols=len(keys), loc='lower left', bbox_to_anchor=(0.0, 1.0))
    axes.set_yticks(range(len(views)), [_plain(view.label) for view in views])
    axes.invert_yaxis()


_STYLES = '-', '--', '-.', ':'


def _draw_wheels(axes: Axes, views: Sequence[View]) -> None:
    for number, view in enumerate(views):
        times, speeds = view.commands
        names = zip(view.settings.robot.wheel_names, cycle(_STYLES))
        for column, (side, style) in enumerate(names):
            name = f'{side} wheel' if not number else None
            axes.step(
                times, speeds[:, column], style, where='post', color=bag_color(number), label=name
            )
    for limit in {view.settings.robot.max_wheel_speed for view in views}:
        if math.isfinite(limit):
            axes.axhline(limit, color=LIMIT, ls='--', lw=1.0)
    axes.set(ylabel='commanded [rad/s]')
    axes.legend(loc='lower left')


def _draw_clearance(axes: Axes, views: Sequence[View]) -> None:
    for number, view in enumerate(views):
        times, road, obstacle = view.clearance
        color = bag_color(number)
        names = ('road edges', 'obstacles') if not number else (None, None)
        if np.isfinite(road).any():
            axes.plot(times, road, color=color, label=names[0])
        if np.isfinite(obstacle).any():
            axes.plot(times, obstacle, '--', color=color, label=names[1])
    axes.axhline(0.0, color=LIMIT, ls='--', lw=1.0)
    axes.set(ylabel='clearance [m]')
    if len(axes.lines) > 1:
        axes.legend(loc='upper right')


def _draw_steps(axes: Axes, views: Sequence[View]) -> None:
    for number, view in enumerate(views):
        axes.plot(*view.steps, '.-', lw=0.8, color=bag_color(number))
        axes.axhline(1e3 * view.settings.control_period, color=LIMIT, ls='--', lw=1.0)
        if len(view.missed_deadlines[0]):
            name = None if axes.get_legend() else 'deadline missed'
            axes.plot(*view.missed_deadlines, 'x', ms=5, color=LIMIT, label=name)
            axes.legend(loc='lower left')
    axes.set(ylabel='step time [ms]', yscale='log')


def _plain(text: str) -> str:
    """Text from a bag, with dollar signs escaped: they would begin a formula."""
    return text.replace('$', r'\$')
