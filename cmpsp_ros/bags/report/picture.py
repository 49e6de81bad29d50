"""The report on one sheet, as a picture."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from itertools import cycle
from pathlib import Path
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from cmpsp_ros.bags.errors import BagError
from cmpsp_ros.bags.report.charts import limits, quantities
from cmpsp_ros.bags.report.path_chart import frame_of, panels
from cmpsp_ros.bags.report.slider import goals_of
from cmpsp_ros.bags.report.view import View
from cmpsp_ros.view.drawing import draw, draw_ends, plain_text
from cmpsp_ros.view.palette import GOAL, GRID, LEVEL_COLORS, LIMIT, bag_color
from cmpsp_ros.view.scene import seen


def draw_report(views: Sequence[View], output: Path) -> None:
    """Draw paths, fallback levels, controls, clearance and step times.

    Raises:
        BagError: The picture cannot be written.
    """
    places, titles = panels(views), quantities(views)
    of_titles = (partial(_draw_controls, title=title) for title in titles)
    draws: list[Callable[[Axes, Sequence[View]], None]]
    draws = [_draw_levels, *of_titles, _draw_clearance, _draw_steps]
    height = 5.5 + 1.5 * max(len(titles) + 1, len(places))
    height = 5.5 + 1.5 * max(len(titles) + 1, len(places))
    figure = Figure(figsize=(14.0, height), layout='constrained')
    halves = figure.add_gridspec(1, 2, width_ratios=[5, 6])
    grid = halves[0].subgridspec(len(places) + 1, 1, height_ratios=[6] * len(places) + [1])
    handles: dict[str, Any] = {}
    for number, members in enumerate(places):
        axes = figure.add_subplot(grid[number])
        _draw_path(axes, views, members)
        handles |= dict(zip(*axes.get_legend_handles_labels()[::-1], strict=True))
    keys = figure.add_subplot(grid[-1])
    keys.set_axis_off()
    keys.legend(handles.values(), handles.keys(), loc='center', ncols=2, fontsize='small')
    rows = halves[1].subgridspec(len(draws), 1, height_ratios=[1] + [3] * (len(draws) - 1))
    shown: Axes | None = None
    for row, draw_one in enumerate(draws):
        axes = figure.add_subplot(rows[row], sharex=shown)
        draw_one(axes, views)
        axes.grid(color=GRID)
        axes.set_axisbelow(True)
        axes.tick_params(labelbottom=row == len(draws) - 1)
        shown = axes
    if shown is not None:
        shown.set(xlabel='time [s]', xlim=(0.0, max(view.end for view in views)))
    try:
        figure.savefig(output, dpi=110)
    except OSError as error:
        raise BagError(f'{output}: cannot be written: {error.strerror or error}') from error


def _draw_path(axes: Axes, views: Sequence[View], members: Sequence[int]) -> None:
    draw(axes, views[members[0]].course)
    for number in members:
        view, color = views[number], bag_color(number)
        draw(axes, view.run, color)
        if view.grids:
            draw(axes, [seen([grid for _, grid in view.grids])])
        label = plain_text(view.label)
        axes.plot(*view.poses[:, :2].T, color=color, lw=2.0, label=label, zorder=4)
        draw_ends(axes, view.poses, color)
        for goal in goals_of(view):
            axes.plot(*goal.position, '*', color=GOAL, ms=14, ls='', zorder=5, label='goal')
            axes.annotate(plain_text(goal.name), goal.position, (6, 6), textcoords='offset points')
    (left, right), (bottom, top) = frame_of([views[k] for k in members])
    axes.set(xlim=(left, right), ylim=(bottom, top), xlabel='x [m]', ylabel='y [m]')
    axes.set_aspect('equal')


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
    axes.set_yticks(range(len(views)), [plain_text(view.label) for view in views])
    axes.invert_yaxis()


_STYLES = '-', '--', '-.', ':'


def _draw_controls(axes: Axes, views: Sequence[View], title: str) -> None:
    for number, view in enumerate(views):
        times, signals = view.commands
        chosen = [each for each in signals if each.axis == title]
        for each, style in zip(chosen, cycle(_STYLES)):
            name = plain_text(each.name) if not number else None
            axes.step(times, each.values, style, where='post', color=bag_color(number), label=name)
    for limit in limits(views, title):
        axes.axhline(limit, color=LIMIT, ls='--', lw=1.0)
    axes.set(ylabel=title)
    axes.legend(loc='lower left')


def _draw_clearance(axes: Axes, views: Sequence[View]) -> None:
    for number, view in enumerate(views):
        times, values = view.clearance
        for (name, value), style in zip(values.items(), cycle(_STYLES)):
            known = axes.get_legend_handles_labels()[1]
            label = None if name in known else name
            axes.plot(times, value, style, color=bag_color(number), label=label)
    axes.axhline(0.0, color=LIMIT, ls='--', lw=1.0)
    axes.set(ylabel='clearance [m]')
    if len(axes.lines) > 1:
        axes.legend(loc='upper right', fontsize='small')


def _draw_steps(axes: Axes, views: Sequence[View]) -> None:
    for number, view in enumerate(views):
        axes.plot(*view.steps, '.-', lw=0.8, color=bag_color(number))
        axes.axhline(1e3 * view.settings.control_period, color=LIMIT, ls='--', lw=1.0)
    axes.set(ylabel='step time [ms]', yscale='log')
