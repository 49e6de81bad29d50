"""Picture of an identification: speeds measured, and predicted before and after it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from cmpsp_ros.bags.errors import BagError
from cmpsp_ros.bags.identify.drives import Drive
from cmpsp_ros.bags.identify.estimates import AXES, Identification
from cmpsp_ros.bags.identify.response import Response
from cmpsp_ros.view.palette import BAGS, EDGE, GRID, TEXT

Array = NDArray[np.float64]

_DETAIL: Final = 2.5
"""Length of what is shown enlarged [s]."""

_SMOOTH: Final = 0.06
"""Time over which a measured speed is a mean [s]."""


def draw(robot: Identification, path: Path) -> None:
    """Draw the longest drive.

    Raises:
        BagError: The picture cannot be written.
    """
    number = int(np.argmax([each.stamps[-1] for each in robot.drives]))
    figure = Figure(figsize=(15.0, 8.0), layout='constrained')
    grid = figure.add_gridspec(2, 2, width_ratios=[5, 3])
    for axis, (name, unit, _) in enumerate(AXES):
        whole, detail = (figure.add_subplot(grid[axis, column]) for column in range(2))
        for axes in (whole, detail):
            _draw_speeds(axes, robot, number, axis)
            axes.grid(color=GRID)
            axes.set(xlabel='time [s]')
        whole.set(ylabel=f'{name} speed [{unit}]', xlim=(0.0, robot.drives[number].stamps[-1]))
        begin = _liveliest(robot.drives[number], axis)
        detail.set(xlim=(begin, begin + _DETAIL))
        if axis == 0:
            whole.legend(ncols=4, loc='lower left', bbox_to_anchor=(0.0, 1.0), frameon=False)
    try:
        figure.savefig(path, dpi=110)
    except OSError as error:
        raise BagError(f'{path}: cannot be written: {error.strerror or error}') from error


def _draw_speeds(axes: Axes, robot: Identification, number: int, axis: int) -> None:
    drive, model = robot.drives[number], robot.fit.model
    changes, commands = model.changes[number][axis]
    fitted = model.responses(robot.fit.p)[axis]
    # Without the age of odometry, of which nobody had to be told, and what a command answers.
    told = max(robot.nominal.get('command_delay', 0.0) - (drive.answer or 0.0), 0.0)
    times = np.arange(0.0, drive.stamps[-1], 0.005)
    axes.step(
        np.append(changes, drive.stamps[-1]), np.append(commands, commands[-1]),
        where='post', color=EDGE, lw=1.0, label='commanded',
    )  # fmt: skip
    axes.plot(*_measured(drive, axis), '.', color=TEXT, ms=3.0, label='measured')
    for response, color, style, label in (
        (Response(delay=told), BAGS[1], '--', f'predicted before, delay {1e3 * told:.0f} ms'),
        (replace(fitted), BAGS[0], '-', 'predicted after'),
    ):
        speeds = response.travel(changes, commands, times)[1]
        axes.plot(times, speeds, style, color=color, lw=1.6, label=label)


def _measured(drive: Drive, axis: int) -> tuple[Array, Array]:
    """Middles and mean speeds of stretches of odometry."""
    period = float(np.median(np.diff(drive.stamps)))
    every = max(round(_SMOOTH / period), 1)
    stamps = drive.stamps[::every]
    travel = np.append(0.0, np.cumsum(drive.steps[:, axis]))[::every]
    return (stamps[1:] + stamps[:-1]) / 2.0, np.diff(travel) / np.diff(stamps)


def _liveliest(drive: Drive, axis: int) -> float:
    """Begin of the part with the largest changes of the command."""
    changes = np.abs(np.diff(drive.commands[:, axis]))
    begins = drive.times[1:][changes > 0.0]
    ends = np.searchsorted(drive.times, begins + _DETAIL)
    total = np.append(0.0, np.cumsum(changes))
    if not len(begins):
        return 0.0
    firsts = np.searchsorted(drive.times, begins)
    gained = total[np.minimum(ends, len(total)) - 1] - total[firsts - 1]
    return float(begins[int(np.argmax(gained))]) - 0.1
