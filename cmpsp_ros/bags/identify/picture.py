"""Picture of an identification: speeds measured, and predicted before and after it."""

from __future__ import annotations

from pathlib import Path
from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from cmpsp_ros.bags.errors import BagError
from cmpsp_ros.bags.identify.drives import Drive, Series
from cmpsp_ros.bags.identify.estimates import AXES, Identification
from cmpsp_ros.bags.identify.response import Response
from cmpsp_ros.view import BAGS, EDGE, GRID, TEXT

_DETAIL: Final = 2.5
"""Length of what is shown enlarged [s]."""

_MEAN: Final = 0.06
"""Time over which a measured speed is a mean [s]."""


def draw(robot: Identification, path: Path) -> None:
    """Draw the longest drive, and where it is liveliest once more.

    Raises:
        BagError: The picture cannot be written.
    """
    number = int(np.argmax([each.stamps[-1] for each in robot.drives]))
    drive = robot.drives[number]
    figure = Figure(figsize=(15.0, 8.0), layout='constrained')
    panels = figure.subplots(2, 2, width_ratios=[5, 3])
    for axis, (name, unit, _, _) in enumerate(AXES):
        series = robot.fit.series[2 * number + axis]
        for axes in panels[axis]:
            _draw_speeds(axes, robot, drive, series)
        begins, sizes = series.changes, np.abs(np.diff(series.commands, append=0.0))
        lively = [sizes[(begins >= at) & (begins < at + _DETAIL)].sum() for at in begins]
        begin = float(begins[int(np.argmax(lively))]) - 0.1
        panels[axis][0].set(ylabel=f'{name} speed [{unit}]', xlim=(0.0, series.stamps[-1]))
        panels[axis][1].set(xlim=(begin, begin + _DETAIL))
    panels[0][0].legend(ncols=4, loc='lower left', bbox_to_anchor=(0.0, 1.0), frameon=False)
    try:
        figure.savefig(path, dpi=110)
    except OSError as error:
        raise BagError(f'{path}: cannot be written: {error.strerror or error}') from error


def _draw_speeds(axes: Axes, robot: Identification, drive: Drive, series: Series) -> None:
    times = np.arange(0.0, series.stamps[-1], 0.005)
    # The part of the parameter that is the response.
    nominal = max(robot.nominal.get('command_delay', 0.0) - (drive.answer or 0.0), 0.0)
    before, after = Response(delay=nominal), robot.fit.response(series.axis)
    every = max(round(_MEAN / float(np.median(np.diff(series.stamps)))), 1)
    stamps = series.stamps[::every]
    travelled = np.append(0.0, np.cumsum(series.steps))[::every]
    speeds = np.diff(travelled) / np.diff(stamps)
    axes.step(*series.command, where='post', color=EDGE, lw=1.0, label='commanded')
    axes.plot((stamps[1:] + stamps[:-1]) / 2.0, speeds, '.', color=TEXT, ms=3.0, label='measured')
    for response, color, style, label in (
        (before, BAGS[1], '--', f'predicted before, delay {1e3 * nominal:.0f} ms'),
        (after, BAGS[0], '-', 'predicted after'),
    ):
        predicted = response.travel(*series.command, times)[1]
        axes.plot(times, predicted, style, color=color, lw=1.6, label=label)
    axes.grid(color=GRID)
    axes.set(xlabel='time [s]')
