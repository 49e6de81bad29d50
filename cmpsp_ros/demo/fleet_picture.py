"""Picture of a run of several robots: their paths, and their closest approach."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from cmpsp_ros.bags.runs import Driven, Run
from cmpsp_ros.demo.scenario import Scenario
from cmpsp_ros.demo.summary import window
from cmpsp_ros.view import along, bodies, body, course, disc, draw, ends, traces

_GRID = 20_000_000
_SMALLEST = 0.06


def draw_fleet(fleet: Sequence[Scenario], runs: Sequence[Run], path: Path) -> Figure:
    """Road and obstacles of the first robot, all paths, and all robots at the nearest instant."""
    figure = Figure(figsize=(8.0, 8.0), layout='constrained')
    axes = figure.add_subplot()
    settings = fleet[0].settings
    draw(axes, traces(course([settings.road], settings.obstacles, fleet[0].hidden), ''))
    windows = [window(run, each.settings) for each, run in zip(fleet, runs, strict=True)]
    paths = [run.driven.between(*when) for run, when in zip(runs, windows, strict=True)]
    colors = mpl.colormaps['turbo'](np.linspace(0.05, 0.95, len(fleet)))
    nearest = _nearest(paths)
    for each, driven, color in zip(fleet, paths, colors, strict=True):
        points = along(driven.poses, driven.twists[:-1], driven.durations)
        axes.plot(*points.T, color=color, lw=1.8, zorder=4, label=each.namespace)
        stood = bodies(body(each.settings), driven.poses[[0, -1]])
        start = ends(driven.poses[:1], color) | {'name': 'start'}
        draw(axes, [*traces([stood], color), start], above=6.0)
        # Hollow: one robot's goal is another one's start.
        axes.plot(*each.settings.goal, '*', mec=color, mfc='none', ms=16, zorder=5)
        if nearest is not None:
            outline = (body(each.settings) or disc(_SMALLEST))[:1]
            (there,) = bodies(outline, [driven.at(nearest)]).lines
            axes.fill(*there.T, color=color, alpha=0.6, lw=0, zorder=6)
    axes.set(xlabel='x [m]', ylabel='y [m]')
    if nearest is not None:
        seconds = (nearest - min(first for first, _ in windows)) / 1e9
        axes.set_title(f'where they were nearest to each other, at {seconds:.1f} s')
    axes.set_aspect('equal')
    axes.autoscale_view()
    axes.legend(loc='best')
    figure.savefig(path, dpi=120)
    return figure


def _nearest(paths: Sequence[Driven]) -> int | None:
    """Time of the closest approach of any two robots [ns]; None if there is none."""
    begin = max(int(each.stamps[0]) for each in paths)
    end = min(int(each.stamps[-1]) for each in paths)
    stamps = range(begin, end, _GRID)
    if not stamps or len(paths) < 2:
        return None
    places = np.array([[each.at(stamp)[:2] for stamp in stamps] for each in paths])
    away = [np.linalg.norm(one - other, axis=1) for one, other in combinations(places, 2)]
    return stamps[int(np.argmin(np.min(away, axis=0)))]
