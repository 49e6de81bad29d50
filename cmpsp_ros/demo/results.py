"""Pictures of a run, of one robot or several, and all its results in a folder."""

import json
import math
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from itertools import combinations, cycle, groupby
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle

from cmpsp_ros import view
from cmpsp_ros.bags.runs import DrivenPath, Run, encounters, lifetime, read_run, seen_at
from cmpsp_ros.demo.scenario import Scenario
from cmpsp_ros.demo.summary import Summary, final_time, nearest_robot, summarise, window
from cmpsp_ros.guidance import NANOSECONDS, GuidanceSettings
from cmpsp_ros.robots.motion import REFERENCE_POINT
from cmpsp_ros.sensing import Track
from cmpsp_ros.world.obstacles import Shape

_PLANS = 4

_ROOM = 0.8

# Width of the picture, and heights below the course: the axis, and rows of the legend [in].
_WIDTH, _BELOW, _ROW, _COLUMNS = 8.0, 0.7, 0.25, 3

_DRIVEN = 'black'


def draw_trajectory(
    run: Run, settings: GuidanceSettings, path: Path, hidden: Sequence[Shape] = (), title: str = ''
) -> Figure:
    """Draw the course, the path, plans at a few instants, and moving obstacles where nearest."""
    first, last = window(run, settings)
    part = run.driven.between(first, last)
    driven = view.along(part.poses, part.twists[:-1], part.durations)
    figure = Figure(layout='constrained')
    axes = figure.add_subplot()
    there = view.course([settings.road], settings.obstacles, hidden)
    view.draw(axes, view.traces([*there, view.kept_clear(settings, settings.world)], ''))
    plans = [plan for plan in run.plans if first <= plan.stamp < last]
    plans = [plans[number * len(plans) // _PLANS] for number in range(_PLANS if plans else 0)]
    colors = mpl.colormaps['viridis'](np.linspace(0.15, 0.85, _PLANS))
    for plan, color in zip(plans, colors, strict=False):
        name = f'plan at {(plan.stamp - first) / 1e9:.1f} s'
        axes.plot(*plan.points.T, '.-', ms=3, lw=0.8, color=color, zorder=4, label=name)
    _draw_moving(axes, run, settings, first, last)
    axes.plot(*driven.T, color=_DRIVEN, lw=2.0, zorder=5, label='driven')
    stood = view.bodies(view.body(settings), part.poses[[0, -1]])
    robot = view.traces([view.trail(settings, part.poses), stood], _DRIVEN)
    view.draw(
        axes, [*robot, view.goals_trace(settings.goals), view.ends(part.poses, _DRIVEN)], above=6.0
    )
    goals = np.array([goal.position for goal in settings.goals]).reshape(-1, 2)
    points = [driven, goals, *(plan.points for plan in plans), view.map_corners(settings)]
    points += stood.lines
    low, high = view.frame(points, (*settings.obstacles, *hidden), _ROOM * settings.road.width)
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), xlabel='x [m]', ylabel='y [m]')
    axes.set(aspect='equal', title=title)
    handles, labels = axes.get_legend_handles_labels()
    rows = math.ceil(len(labels) / _COLUMNS)
    width, height = high - low
    figure.set_size_inches(_WIDTH, _WIDTH * height / width + _BELOW + _ROW * rows)
    view.legend_below(figure, handles, labels, ncols=_COLUMNS)
    figure.savefig(path, dpi=120, bbox_inches='tight')
    return figure


def _draw_moving(axes: Axes, run: Run, settings: GuidanceSettings, first: int, last: int) -> None:
    """Paths of all that moves, each with its position at the closest approach; tracks without."""
    for tracks, color, label in (
        (run.told, view.MOVING, 'moving obstacle where nearest'),
        (run.people, view.PERSON, 'person where nearest'),
    ):
        driven = run.driven.between(first, last)
        _draw_encounters(axes, driven, tracks, settings, color, label)
    grouped = groupby((each for each in run.tracks if each.is_seen), key=lambda each: each.id)
    paths = [np.array([(each.x, each.y) for each in tracks]) for _, tracks in grouped]
    view.draw(axes, view.traces([view.Part('tracked', tuple(paths))], ''))


def _draw_encounters(
    axes: Axes,
    driven: DrivenPath,
    tracks: Sequence[Track],
    settings: GuidanceSettings,
    color: str,
    label: str | None,
) -> None:
    nearest: dict[str, tuple[float, int]] = {}
    point, lifetime_of = [(REFERENCE_POINT, 0.0)], partial(lifetime, settings=settings)
    for each in encounters(driven, tracks, point, lifetime_of):
        index = int(each.clearance.argmin())
        found = float(each.clearance[index]), int(each.stamps[index])
        nearest[each.name] = min(found, nearest.get(each.name, found))
    for name, (_, stamp) in nearest.items():
        way = np.array([(each.x, each.y) for each in tracks if each.name == name])
        axes.plot(*way.T, color=color, ls='-.', lw=0.8, zorder=2)
        (there,) = (each for each in seen_at(tracks, stamp, settings) if each.name == name)
        center, robot = (there.x, there.y), driven.at(stamp)[:2]
        axes.add_patch(Circle(center, there.radius, color=color, lw=0, zorder=4, label=label))
        axes.plot(*zip(center, robot, strict=True), color=color, lw=1.0, zorder=4)
        axes.plot(*robot, '.', color=_DRIVEN, ms=8, zorder=6)
        when = f'{(stamp - int(driven.stamps[0])) / NANOSECONDS:.1f} s'
        axes.annotate(when, center, (9, -14), textcoords='offset points', zorder=6)
        label = None


def draw_controls(run: Run, settings: GuidanceSettings, path: Path, title: str = '') -> Figure:
    """Draw wheel speeds, or other controls of the robot, with their limits."""
    first, last = window(run, settings)
    robot, stamps, twists = settings.robot, run.driven.stamps, run.driven.twists
    if robot.steering_limits is None:
        # Wheels that slip turn faster than the robot moves.
        stamps, twists = run.wheel_stamps, robot.twist_of_wheels(run.wheel_speeds)
    # Of two twists at one instant the second is the one that a command has set.
    latest = np.append(np.diff(stamps) > 0, True)
    inside = np.flatnonzero(latest & (stamps >= first) & (stamps < last))
    seconds = np.append((stamps[inside] - first) / NANOSECONDS, settings.final_time)
    signals = robot.signals(twists[[*inside, inside[-1]]])
    figure = Figure(layout='constrained')
    quantities = list(dict.fromkeys(each.axis for each in signals))
    figure.set_size_inches(9.0, 2.0 + 2.5 * len(quantities))
    rows = figure.subplots(len(quantities), sharex=True, squeeze=False)[:, 0]
    for axes, quantity in zip(rows, quantities, strict=True):
        chosen = [each for each in signals if each.axis == quantity]
        for each, color in zip(chosen, cycle(view.BAGS)):
            axes.step(seconds, each.values, where='post', color=color, label=each.name)
        limit = chosen[0].limit
        if math.isfinite(limit):
            axes.axhline(limit, color=view.LIMIT, ls='--', lw=1.0, label=f'limit {limit:.4g}')
            if min(each.values.min() for each in chosen) < 0.0:
                axes.axhline(-limit, color=view.LIMIT, ls='--', lw=1.0)
        axes.set(ylabel=quantity, xlim=(0.0, settings.final_time))
        axes.grid(alpha=0.3)
        axes.legend()
    rows[-1].set_xlabel('time [s]')
    rows[0].set_title(title)
    figure.savefig(path, dpi=120)
    return figure


_GRID = 20_000_000
_SMALLEST = 0.06


def draw_fleet(fleet: Sequence[Scenario], runs: Sequence[Run], path: Path) -> Figure:
    """Road and obstacles of the first robot, all paths, and all robots at the nearest instant."""
    figure = Figure(figsize=(8.0, 8.0), layout='constrained')
    axes = figure.add_subplot()
    settings = fleet[0].settings
    view.draw(
        axes, view.traces(view.course([settings.road], settings.obstacles, fleet[0].hidden), '')
    )
    windows = [window(run, each.settings) for each, run in zip(fleet, runs, strict=True)]
    paths = [run.driven.between(*when) for run, when in zip(runs, windows, strict=True)]
    colors = mpl.colormaps['turbo'](np.linspace(0.05, 0.95, len(fleet)))
    nearest = _nearest(paths)
    for each, driven, color in zip(fleet, paths, colors, strict=True):
        points = view.along(driven.poses, driven.twists[:-1], driven.durations)
        axes.plot(*points.T, color=color, lw=1.8, zorder=4, label=each.namespace)
        stood = view.bodies(view.body(each.settings), driven.poses[[0, -1]])
        start = view.ends(driven.poses[:1], color) | {'name': 'start'}
        view.draw(axes, [*view.traces([stood], color), start], above=6.0)
        # Hollow: one robot's goal is another one's start.
        star = {'mec': color, 'mfc': 'none', 'ms': 16, 'zorder': 5}
        axes.plot(*each.settings.goal, '*', **star, label='goal' if driven is paths[0] else None)
        if nearest is not None:
            outline = (view.body(each.settings) or view.disc(_SMALLEST))[:1]
            (there,) = view.bodies(outline, [driven.at(nearest)]).lines
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


def _nearest(paths: Sequence[DrivenPath]) -> int | None:
    """Time of the closest approach of any two robots [ns]; None if there is none."""
    begin = max(int(each.stamps[0]) for each in paths)
    end = min(int(each.stamps[-1]) for each in paths)
    stamps = range(begin, end, _GRID)
    if not stamps or len(paths) < 2:
        return None
    places = np.array([[each.at(stamp)[:2] for stamp in stamps] for each in paths])
    away = [np.linalg.norm(one - other, axis=1) for one, other in combinations(places, 2)]
    return stamps[int(np.argmin(np.min(away, axis=0)))]


def sum_up(robots: Sequence[Scenario], folder: Path) -> tuple[Summary, ...]:
    """Write `summary.json` and the pictures of a run beside its bag; the figures of each robot."""
    if len(robots) > 1:
        return _sum_up_fleet(robots, folder)
    (scenario,), recorded = robots, read_run(folder / 'bag')
    settings = replace(scenario.settings, final_time=final_time(recorded, scenario.settings))
    scenario = replace(scenario, settings=settings)
    summary = summarise(recorded, scenario.truth, scenario.name)
    _write(summary.values(), folder)
    title = f'{scenario.name}: clearance {summary.clearance:.3f} m'
    if summary.miss is not None:
        title += f', miss {summary.miss:.4f} m'
    draw_trajectory(recorded, settings, folder / 'trajectory.png', scenario.hidden, title)
    draw_controls(recorded, settings, folder / 'wheel_speeds.png', scenario.name)
    return (summary,)


def _sum_up_fleet(fleet: Sequence[Scenario], folder: Path) -> tuple[Summary, ...]:
    runs = [read_run(folder / 'bag', each.namespace) for each in fleet]
    summaries = tuple(
        replace(summarise(run, each.settings, each.name), apart=nearest_robot(k, fleet, runs))
        for k, (each, run) in enumerate(zip(fleet, runs, strict=True))
    )
    named = zip((each.namespace for each in fleet), summaries, strict=True)
    values = {name: each.values() | {'apart_m': each.apart} for name, each in named}
    _write({'preset': fleet[0].name, 'robots': values}, folder)
    draw_fleet(fleet, runs, folder / 'trajectory.png')
    return summaries


def _write(values: dict[str, Any], folder: Path) -> None:
    text = json.dumps(values, indent=2)
    (folder / 'summary.json').write_text(f'{text}\n', encoding='utf-8')
