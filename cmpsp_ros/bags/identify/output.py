"""Results of an identification: the parameter file of the robot, and a picture."""

from collections.abc import Iterator
from pathlib import Path
from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from cmpsp_ros.bags.errors import written
from cmpsp_ros.bags.identify.drives import Drive, Series
from cmpsp_ros.bags.identify.estimates import AXES, Identification
from cmpsp_ros.bags.identify.model import Response
from cmpsp_ros.parameters.files import dump
from cmpsp_ros.view import BAGS, EDGE, GRID, TEXT


def write_parameters(path: Path, robot: Identification) -> None:
    """Write identified parameters; the others are comments."""
    drives = ''.join(f'# {each.label}, {each.stamps[-1]:.0f} s\n' for each in robot.drives)
    head = f'# By `cmpsp identify`, intervals of 95 %, from\n{drives}\n/**:\n  ros__parameters:\n'
    with written(path):
        path.write_text(head + '\n'.join(_lines(robot)) + '\n', encoding='utf-8')


def _lines(robot: Identification) -> Iterator[str]:
    known = {key: each.interval for key, each in robot.estimates.items()}
    values, hints = _parameters(robot)
    for key, each in robot.estimates.items():
        figures = f'{known[key]} {each.unit}'.rstrip() if known[key] else ''
        yield f'    # {each.name}: {", ".join(filter(None, (figures, each.remark)))}.'
        yield from (f'    # {hint}' for hint in hints.get(key, ()))
        if key in values:
            yield dump({values[key][0]: round(values[key][1], 4)}).splitlines()[-1]
    yield "    # The paper's constant wheel speeds are another robot's."
    yield dump({'initial_guess.type': 'road'}).splitlines()[-1]
    yield dump({'enable_stamped_cmd_vel': robot.drives[0].stamped}).splitlines()[-1]


def _parameters(
    robot: Identification,
) -> tuple[dict[str, tuple[str, float]], dict[str, tuple[str, ...]]]:
    known = {key: each.interval.value for key, each in robot.estimates.items() if each.interval}
    values: dict[str, tuple[str, float]] = {}
    hints: dict[str, tuple[str, ...]] = {}
    if 'command_delay' in known:
        values['command_delay'] = 'command_delay', max(known['command_delay'], 0.0)
    lag = robot.estimates['lag'].interval
    if lag is not None:
        hints['lag'] = (
            'Included in command_delay. Apart from it, with command_delay less the lag:',
            f'max_wheel_lag: {lag.high:.4g}',
        )
    linear, angular = known.get('linear_scale'), known.get('angular_scale')
    radius, half_track = map(robot.nominal.get, ('robot.wheel_radius', 'robot.half_track'))
    hints['linear_scale'] = ('robot.wheel_radius: that of the driver times this.',)
    hints['angular_scale'] = (
        'robot.half_track: that of the driver times the linear scale, divided by this.',
    )
    same = ('Its driver must have the same value: it makes wheel speeds of twists.',)
    if linear and radius:
        values['linear_scale'] = 'robot.wheel_radius', radius * linear
        hints['linear_scale'] = same
        for kind in ('speed', 'acceleration'):
            if f'linear_{kind}' in known:
                limit = known[f'linear_{kind}'] / (radius * linear)
                values[f'linear_{kind}'] = f'robot.max_wheel_{kind}', limit
        if angular and half_track:
            values['angular_scale'] = 'robot.half_track', half_track * linear / angular
            hints['angular_scale'] = same
    return values, hints


_DETAIL: Final = 2.5  # length of what is shown enlarged [s]
_MEAN: Final = 0.06  # time over which a measured speed is a mean [s]


def draw(robot: Identification, path: Path) -> None:
    """Draw the longest drive, and an enlargement of its liveliest part."""
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
    with written(path):
        figure.savefig(path, dpi=110)


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
