"""The paper's pictures: paths on their road, and time series; files repeat exactly."""

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path as FilePath
from typing import Any, Final

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from cmpsp_ros import view
from cmpsp_ros.studies.common import WIDTH
from cmpsp_ros.studies.paper.drives import Drive, Panels, Path

Look = dict[str, Any]

PANELS: Final = ('(a) samples only, as in the paper', '(b) clear between samples too')

_LIMIT, _GUESS = '0.35', 'green'
_END: Final[Look] = {'color': 'white', 'mec': 'black'}
_BESIDE = 0.35
_DPI = 200

_PERIOD: Final = 9.0  # length of a dash and its gap, in line widths


def save(figure: Figure, folder: FilePath, name: str) -> None:
    """Write a picture as PNG and as SVG, without a date."""
    figure.savefig(folder / f'{name}.png', dpi=_DPI, metadata={'Software': None})
    figure.savefig(folder / f'{name}.svg', metadata={'Date': None, 'Creator': None})


def draw_trajectories(
    panels: Panels, guess: Path | None = None, *, coincide: bool = False
) -> Figure:
    """Paths of several runs on one road, in one panel per controller."""
    figure = Figure(figsize=(WIDTH, 0.575 * WIDTH), layout='constrained')
    looks = _strokes(len(panels[0]), coincide=coincide)
    grid = figure.add_gridspec(2, len(panels), height_ratios=(0.09, 1.0))
    for column, (drives, title) in enumerate(zip(panels, PANELS, strict=True)):
        axes = figure.add_subplot(grid[1, column])
        _draw_place(axes, drives)
        if guess is not None:
            axes.plot(*guess.points().T, ls=':', lw=1.2, color=_GUESS, zorder=3)
        for drive, look in zip(drives, looks, strict=True):
            axes.plot(*drive.path.points().T, color=drive.experiment.color, zorder=4, **look)
        axes.plot(*drives[0].path.poses[0, :2], 'o', ms=5, zorder=6, **_END)
        axes.plot(*drives[0].path.settings.goal, '*', ms=9, zorder=6, **_END)
        axes.set_title(title)
    keys: list[Artist] = [*_keys(panels[0], looks), *([] if guess is None else [_guess_key()])]
    keys += [Line2D([], [], ls='', marker=m, ms=s, label=name, **_END)
             for m, s, name in (('o', 5, 'start'), ('*', 9, 'goal'))]  # fmt: skip
    if any(drive.path.settings.obstacles for drive in panels[0]):
        keys.append(Patch(label='obstacle', color=view.OBSTACLE))
    key_above(figure.add_subplot(grid[0, :]), keys, 4)
    return figure


def draw_poses(panels: Panels) -> Figure:
    """Position and heading over time, with a column of panels per controller."""

    def draw(axes: Axes, row: int, drive: Drive, look: Look) -> None:
        values = drive.path.poses[:, row]
        values = np.degrees(values) if row == 2 else values
        axes.plot(drive.path.times, values, color=drive.experiment.color, **look)

    looks = _strokes(len(panels[0]), coincide=False)
    figure, rows = _grid(panels, ('x [m]', 'y [m]', 'heading [deg]'), draw, looks)
    path = panels[0][0].path
    for row, value in zip(rows, path.settings.goal, strict=False):
        for axes in row:
            axes.plot(path.times[-1], value, '*', ms=8, zorder=5, clip_on=False, **_END)
    for row in rows:
        _share(row)
    return figure


def draw_wheel_speeds(
    panels: Panels, guesses: Sequence[tuple[float, float]] = (), *, coincide: bool = False
) -> Figure:
    """Wheel speeds in time, right above left, with limits and, dotted, first guesses [rad/s]."""

    def draw(axes: Axes, row: int, drive: Drive, look: Look) -> None:
        look = {**look, 'lw': 0.7 * look['lw']}
        speeds = drive.path.controls[:, row]
        held = np.append(speeds, speeds[-1])
        axes.step(drive.path.times, held, where='post', color=drive.experiment.color, **look)

    limits = {drive.path.settings.robot.max_wheel_speed for drive in panels[0]}
    finite = sorted((limit for limit in limits if math.isfinite(limit)), reverse=True)
    dashes = dict(zip(finite, ('--', '-.'), strict=False))
    keys = [
        Line2D([], [], color=_LIMIT, ls=dash, lw=0.8, label=f'limit {limit:g} rad/s')
        for limit, dash in dashes.items()
    ]
    keys += [_guess_key()] if guesses else []
    names = ('right wheel [rad/s]', 'left wheel [rad/s]')
    looks = _strokes(len(panels[0]), coincide=coincide)
    figure, rows = _grid(panels, names, draw, looks, keys)
    for row, of_wheel in enumerate(rows):
        for axes in of_wheel:
            for limit, dash in dashes.items():
                axes.axhline(limit, color=_LIMIT, ls=dash, lw=0.8, zorder=1)
            for guess in guesses:
                axes.axhline(guess[row], color=_GUESS, ls=':', lw=1.2, zorder=1)
    _share([axes for row in rows for axes in row])
    return figure


def key_above(axes: Axes, lines: Sequence[Artist], columns: int) -> None:
    """A legend in axes of its own, where it cannot cover data."""
    axes.set_axis_off()
    legend = axes.legend(handles=list(lines), loc='center', ncols=columns, borderaxespad=0.0)
    # A wide one would squeeze the pictures below it.
    legend.set_in_layout(False)


def _draw_place(axes: Axes, drives: Sequence[Drive]) -> None:
    """The quarter of the road that is driven, and every obstacle that any of the runs has."""
    road = drives[0].path.settings.world.annulus
    shapes = {each.name: each for drive in drives for each in drive.path.settings.obstacles}
    parts = (replace(each, names=()) for each in view.course([road], shapes.values()))
    view.draw(axes, view.traces(parts, ''), above=0.0)
    for name, obstacle in shapes.items():
        # Beside the road, where no path covers it.
        away = np.subtract(obstacle.center, road.center)
        place = road.center + away * ((road.outer_radius + _BESIDE) / np.linalg.norm(away))
        box = {'fc': 'white', 'ec': 'none', 'pad': 0.6}
        axes.annotate(name, place, ha='center', va='center', bbox=box, zorder=5)
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


def _grid(
    panels: Panels,
    names: Sequence[str],
    draw: Callable[[Axes, int, Drive, Look], None],
    looks: Sequence[Look],
    keys: Sequence[Line2D] = (),
) -> tuple[Figure, list[list[Axes]]]:
    figure = Figure(figsize=(WIDTH, 0.5 + 1.45 * len(names)), layout='constrained')
    heights = (0.22, *(1.0 for _ in names))
    grid = figure.add_gridspec(len(heights), len(panels), height_ratios=heights)
    rows: list[list[Axes]] = []
    for row, name in enumerate(names):
        rows.append([figure.add_subplot(grid[row + 1, column]) for column in range(len(panels))])
        for axes, drives, title in zip(rows[-1], panels, PANELS, strict=True):
            for drive, look in zip(drives, looks, strict=True):
                draw(axes, row, drive, look)
            axes.set(xlim=(0.0, drives[0].path.times[-1]), title=title if row == 0 else '')
            axes.grid(visible=True)
            axes.tick_params(labelbottom=row == len(names) - 1)
            if row == len(names) - 1:
                axes.set_xlabel('time [s]')
        rows[-1][0].set_ylabel(name)
    key_above(figure.add_subplot(grid[0, :]), [*_keys(panels[0], looks), *keys], 6)
    return figure, rows


def _share(panels: Sequence[Axes]) -> None:
    limits = [axes.get_ylim() for axes in panels]
    for axes in panels:
        axes.set_ylim(min(low for low, _ in limits), max(high for _, high in limits))


def _keys(drives: Sequence[Drive], looks: Sequence[Look]) -> list[Line2D]:
    return [
        Line2D([], [], color=drive.experiment.color, label=drive.experiment.label, **look)
        for drive, look in zip(drives, looks, strict=True)
    ]


def _guess_key() -> Line2D:
    return Line2D([], [], color=_GUESS, ls=':', lw=1.2, label='first guess')


def _strokes(count: int, *, coincide: bool) -> list[Look]:
    """Strokes for close curves: those drawn first wider, or dashed where several coincide."""
    if not coincide:
        return [{'lw': 0.9 + 0.8 * (count - 1 - place)} for place in range(count)]
    dashes = [_PERIOD * (count - place) / (count + 1) for place in range(1, count)]
    return [{'lw': 1.8, 'ls': '-'}] + [
        {'lw': 1.8, 'ls': (0.0, (dash, _PERIOD - dash)), 'dash_capstyle': 'butt'} for dash in dashes
    ]
