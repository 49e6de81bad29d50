"""Pictures over time: position and heading, and wheel speeds with their limits."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from numpy.typing import NDArray

from cmpsp_ros.studies.paper.drives import Drive
from cmpsp_ros.studies.paper.style import LIMIT, PANELS, key_above, strokes
from cmpsp_ros.studies.plot_style import WIDTH

Array = NDArray[np.float64]
Look = dict[str, Any]

_GUESS = 'green'


def draw_poses(panels: Sequence[Sequence[Drive]]) -> Figure:
    """Position and heading in time, a column of panels for each way of driving them."""
    looks = strokes(len(panels[0]), coincide=False)

    def draw(axes: Axes, row: int, drive: Drive, look: Look) -> None:
        values = drive.path.poses[:, row]
        values = np.degrees(values) if row == 2 else values
        axes.plot(drive.path.times, values, color=drive.experiment.color, **look)

    figure, rows = _grid(panels, ('x [m]', 'y [m]', 'heading [deg]'), draw, looks)
    goal = panels[0][0].path.settings.goal
    end = panels[0][0].path.times[-1]
    for row, value in zip(rows, goal, strict=False):
        for axes in row:
            axes.plot(end, value, '*', color='white', mec='black', ms=8, zorder=5, clip_on=False)
    for row in rows:
        _share(row)
    return figure


def draw_wheel_speeds(
    panels: Sequence[Sequence[Drive]],
    guesses: Sequence[tuple[float, float]] = (),
    *,
    coincide: bool = False,
) -> Figure:
    """Wheel speeds in time, right above left, with the limit of every run that has one.

    Args:
        panels: Runs of each panel, the same experiments in all of them.
        guesses: First guesses to show, dotted [rad/s].
        coincide: Whether several runs are the same.
    """
    looks = strokes(len(panels[0]), coincide=coincide)

    def draw(axes: Axes, row: int, drive: Drive, look: Look) -> None:
        look = {**look, 'lw': 0.7 * look['lw']}
        speeds = drive.path.wheel_speeds[:, row]
        held = np.append(speeds, speeds[-1])
        axes.step(drive.path.times, held, where='post', color=drive.experiment.color, **look)

    keys: list[Line2D] = []
    limits = {drive.path.settings.robot.max_wheel_speed for drive in panels[0]}
    finite = sorted((limit for limit in limits if math.isfinite(limit)), reverse=True)
    dashes = dict(zip(finite, ('--', '-.'), strict=False))
    for limit, dash in dashes.items():
        keys.append(Line2D([], [], color=LIMIT, ls=dash, lw=0.8, label=f'limit {limit:g} rad/s'))
    if guesses:
        keys.append(Line2D([], [], color=_GUESS, ls=':', lw=1.2, label='first guess'))
    names = ('right wheel [rad/s]', 'left wheel [rad/s]')
    figure, rows = _grid(panels, names, draw, looks, keys)
    for row, of_wheel in enumerate(rows):
        for axes in of_wheel:
            for limit, dash in dashes.items():
                axes.axhline(limit, color=LIMIT, ls=dash, lw=0.8, zorder=1)
            for guess in guesses:
                axes.axhline(guess[row], color=_GUESS, ls=':', lw=1.2, zorder=1)
    _share([axes for row in rows for axes in row])
    return figure


def _grid(
    panels: Sequence[Sequence[Drive]],
    names: Sequence[str],
    draw: Callable[[Axes, int, Drive, Look], None],
    looks: Sequence[Look],
    keys: Sequence[Line2D] = (),
) -> tuple[Figure, list[list[Axes]]]:
    """A row of axes for each quantity, a column for each panel, and the legend above all."""
    figure = Figure(figsize=(WIDTH, 0.5 + 1.45 * len(names)), layout='constrained')
    heights = (0.22, *(1.0 for _ in names))
    grid = figure.add_gridspec(len(heights), len(panels), height_ratios=heights)
    rows: list[list[Axes]] = []
    for row, name in enumerate(names):
        rows.append([])
        for column, drives in enumerate(panels):
            axes = figure.add_subplot(grid[row + 1, column])
            for drive, look in zip(drives, looks, strict=True):
                draw(axes, row, drive, look)
            axes.set(xlim=(0.0, drives[0].path.times[-1]))
            axes.grid(visible=True)
            if column == 0:
                axes.set_ylabel(name)
            if row == 0:
                axes.set_title(PANELS[column])
            if row == len(names) - 1:
                axes.set_xlabel('time [s]')
            else:
                axes.tick_params(labelbottom=False)
            rows[-1].append(axes)
    key_above(figure.add_subplot(grid[0, :]), [*_keys(panels[0], looks), *keys], 6)
    return figure, rows


def _share(panels: Sequence[Axes]) -> None:
    """One range of values for panels that are to be compared."""
    low = min(axes.get_ylim()[0] for axes in panels)
    high = max(axes.get_ylim()[1] for axes in panels)
    for axes in panels:
        axes.set_ylim(low, high)


def _keys(drives: Sequence[Drive], looks: Sequence[Look]) -> list[Line2D]:
    return [
        Line2D([], [], color=drive.experiment.color, label=drive.experiment.label, **look)
        for drive, look in zip(drives, looks, strict=True)
    ]
