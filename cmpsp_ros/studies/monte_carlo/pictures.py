"""Pictures of a study: all its paths, the distributions of its figures, and single runs."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle

from cmpsp_ros import view
from cmpsp_ros.guidance import NANOSECONDS, GuidanceSettings
from cmpsp_ros.studies.common import WIDTH, plot_style
from cmpsp_ros.studies.monte_carlo.contacts import contacts
from cmpsp_ros.studies.monte_carlo.driving import DrivenRun
from cmpsp_ros.studies.monte_carlo.outcome import RunVerdict, StudyOutcome

_DPI: Final = 150
_SMALLEST_MISS: Final = 1e-16
_EVERY: Final = 2.0  # time between two marks on paths among people [s]
_RIM = '0.3'
_LOOKS: Final = {
    RunVerdict.ARRIVED: ('tab:blue', 0.5),
    RunVerdict.TOO_FAR: ('0.45', 0.5),
    RunVerdict.MISSED: ('tab:orange', 1.2),
}
_FAILED: Final = ('tab:red', 1.2)


def draw_study(
    folder: Path, title: str, settings: GuidanceSettings | None, outcomes: Sequence[StudyOutcome],
    tolerance: float,
) -> list[Path]:  # fmt: skip
    """Draw all paths, and the spread of miss and clearance; arrival is within `tolerance` [m]."""
    with plot_style():
        return [
            _save(_paths(title, settings, outcomes, tolerance), folder / 'paths.png'),
            _save(_spread(title, outcomes, tolerance), folder / 'spread.png'),
        ]


def draw_run(path: Path, title: str, driven: DrivenRun) -> Path:
    """Draw one run: its path by fallback level, and its clearance over time."""
    with plot_style():
        figure = Figure(figsize=(WIDTH, 0.55 * WIDTH), layout='constrained')
        figure.suptitle(title, fontsize=7.0, family='monospace', wrap=True)
        way, over_time = figure.subplots(1, 2)
        _draw_way(way, driven)
        _draw_clearance(over_time, driven)
        return _save(figure, path)


def _paths(
    title: str,
    settings: GuidanceSettings | None,
    outcomes: Sequence[StudyOutcome],
    tolerance: float,
) -> Figure:
    figure = Figure(figsize=(WIDTH, WIDTH), layout='constrained')
    axes = figure.add_subplot()
    if settings is not None:
        _draw_place(axes, settings)
        axes.plot(*settings.goal, '*', color='white', mec='black', ms=9, zorder=6)
    named = set[RunVerdict]()
    # Failed runs are drawn last, on top.
    for each in sorted(outcomes, key=lambda each: each.failed(tolerance)):
        verdict = each.verdict(tolerance)
        color, width = _LOOKS.get(verdict, _FAILED)
        label = None if verdict in named else verdict.value
        named.add(verdict)
        axes.plot(each.x, each.y, color=color, lw=width, alpha=0.8, label=label)
    axes.set_aspect('equal')
    view.legend_below(figure, ncols=4)
    axes.set_title(title)
    return figure


def _spread(title: str, outcomes: Sequence[StudyOutcome], tolerance: float) -> Figure:
    figure = Figure(figsize=(WIDTH, 0.45 * WIDTH), layout='constrained')
    figure.suptitle(title)
    misses, clearances = figure.subplots(1, 2)
    misses_in_reach = [each.miss for each in outcomes if not each.out_of_reach]
    reachable = [max(each, _SMALLEST_MISS) for each in misses_in_reach if np.isfinite(each)]
    if reachable:
        low, high = np.floor(np.log10(min(reachable))), np.ceil(np.log10(max(reachable)))
        misses.hist(reachable, bins=np.logspace(low, max(high, low + 1.0), 41).tolist())
    misses.axvline(tolerance, color=_RIM, ls='--', lw=0.8)
    misses.set(xscale='log', xlabel='miss at the final time, goal in reach [m]', ylabel='runs')
    known = [each.clearance for each in outcomes if np.isfinite(each.clearance)]
    clearances.hist(known, bins=40)
    clearances.axvline(0.0, color=_RIM, ls='--', lw=0.8)
    clearances.set(xlabel='least clearance of the true path [m]')
    return figure


def _draw_place(axes: Axes, settings: GuidanceSettings) -> None:
    parts = view.course([settings.road], settings.obstacles)
    view.draw(axes, view.traces([replace(each, names=()) for each in parts], ''), above=0.0)
    axes.set(xlabel='x [m]', ylabel='y [m]')
    axes.set_aspect('equal')


def _draw_way(axes: Axes, driven: DrivenRun) -> None:
    """The exact arcs, each in the colour of the latest fallback level."""
    settings = driven.task.truth
    _draw_place(axes, settings)
    begins, poses = driven.stamps, driven.poses
    points = view.along(poses, *driven.arcs[1:])
    stamps = np.append(np.repeat(begins[:-1], view.PER_ARC), begins[-1])
    ends = [*(each.stamp for each in driven.decisions[1:]), np.inf]
    for decision, end in zip(driven.decisions, ends, strict=False):
        # One point more, so that the next piece begins where this one ends.
        chosen = (stamps >= decision.stamp) & (stamps <= end)
        axes.plot(*points[chosen].T, color=view.LEVEL_COLORS[decision.level.name.lower()], lw=1.2)
    _draw_people(axes, driven)
    axes.plot(*poses[0, :2], 'o', color='white', mec='black', ms=4)
    axes.plot(*settings.goal, '*', color='white', mec='black', ms=8)
    shapes = driven.task.scenario.obstacles
    boxes = [line for each in shapes for line in each.outlines(each.radius)]
    view.show(axes, [points, np.array([settings.goal]), *boxes], 0.5)


def _draw_people(axes: Axes, driven: DrivenRun) -> None:
    """Paths of people with times, the robot at the same times, and a cross at each contact."""
    if not driven.people or driven.walking is None:
        return
    seconds = np.array([stamp for stamp, _ in driven.people]) / NANOSECONDS
    states = np.array([each for _, each in driven.people])
    marked = np.searchsorted(seconds, np.arange(0.0, seconds[-1], _EVERY))
    stamps, places = driven.stamps / NANOSECONDS, driven.poses[:, :2]
    here = places[np.searchsorted(stamps, seconds[marked])]
    for time, place in zip(seconds[marked], here, strict=True):
        axes.annotate(f'{time:.0f}', place, fontsize=4.0, weight='bold')
    for person in range(states.shape[1]):
        color = f'C{person % 10}'
        axes.plot(*states[:, person, :2].T, color=color, lw=0.6, ls=':')
        for k in marked:
            x, y, _, _, radius = states[k, person]
            axes.add_patch(Circle((x, y), radius, fill=False, color=color, lw=0.4))
            axes.annotate(f'{seconds[k]:.0f}', (x, y), fontsize=4.0, color=color, ha='center')
    for met in contacts(driven, driven.walking.names):
        k = min(int(np.searchsorted(stamps, met.time)), len(places) - 1)
        axes.plot(*places[k], 'x', color='tab:red' if met.is_active else '0.55', ms=7, zorder=7)


def _draw_clearance(axes: Axes, driven: DrivenRun) -> None:
    clearance = driven.clearance()
    times = driven.stamps[:-1] / NANOSECONDS
    settings = driven.task.truth
    names = (*settings.road.edge_names, *(each.name for each in settings.obstacles))
    if driven.task.scanner is not None:
        names, clearance = ('all that stands there',), clearance.min(axis=1, keepdims=True)
    for name, column in zip(names, clearance.T, strict=True):
        axes.plot(times, column, lw=0.9, label=name)
    for level, color in view.LEVEL_COLORS.items():
        there = [each.stamp for each in driven.decisions if each.level.name.lower() == level]
        if there:
            seconds = np.array(there) / NANOSECONDS
            axes.plot(seconds, [-0.02] * len(there), '|', color=color, label=level)
    axes.axhline(0.0, color=_RIM, ls='--', lw=0.8)
    axes.set(xlabel='time [s]', ylabel='clearance [m]', ylim=(-0.1, 1.2))
    keys = axes.get_legend_handles_labels()
    view.legend_below(axes.figure, *keys, ncols=6, fontsize=6.0)


def _save(figure: Figure, path: Path) -> Path:
    figure.savefig(path, dpi=_DPI, metadata={'Software': None})
    return path
