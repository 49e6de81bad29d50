"""Pictures of a run: the path on its road, and the wheel speeds over time."""

from __future__ import annotations

import math
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Patch
from matplotlib.patheffects import withStroke
from numpy.typing import NDArray

from cmpsp_ros.bags.runs.encounters import encounters
from cmpsp_ros.bags.runs.run import Run
from cmpsp_ros.bags.runs.tracks import seen_at
from cmpsp_ros.demo.summary import window
from cmpsp_ros.guidance.formulation.constraint_tightening import sample_space
from cmpsp_ros.guidance.horizon import NANOSECONDS
from cmpsp_ros.guidance.settings import GuidanceSettings
from cmpsp_ros.view.drawing import (
    along,
    draw_around,
    draw_obstacles,
    draw_road,
    map_corners,
    show,
)
from cmpsp_ros.view.palette import BAGS, GOAL, LIMIT, MARGIN, MOVING, OBSTACLE, ROAD

Array = NDArray[np.float64]

_PLANS = 4

_ROOM = 0.8

# Width of the picture, and what is below the road [in].
_WIDTH, _BELOW = 8.0, 1.2

_DRIVEN = 'black'


def draw_trajectory(run: Run, settings: GuidanceSettings, path: Path) -> None:
    """Road, obstacles with the margin kept, the driven path and the plan at a few instants.

    Moving obstacles are drawn at the robot's closest approach.
    """
    first, last = window(run, settings)
    part = run.driven.between(first, last)
    driven = along(part.poses, part.twists[:-1], part.durations)
    figure = Figure(layout='constrained')
    axes = figure.add_subplot()
    draw_road(axes, settings.road)
    draw_obstacles(axes, settings.obstacles)
    kept = sample_space(settings)
    for obstacle, center, radius in zip(settings.obstacles, kept.centers, kept.radii, strict=True):
        draw_around(axes, obstacle, radius, MARGIN)
        if not obstacle.corners:
            continue
        axes.annotate(
            obstacle.name, center, color='white', ha='center', va='center', zorder=6,
            path_effects=[withStroke(linewidth=3.0, foreground=OBSTACLE)],
        )  # fmt: skip
    plans = [plan for plan in run.plans if first <= plan.stamp < last]
    colors = mpl.colormaps['viridis'](np.linspace(0.15, 0.85, _PLANS))
    for number, color in enumerate(colors) if plans else ():
        plan = plans[number * len(plans) // _PLANS]
        name = f'plan at {(plan.stamp - first) / 1e9:.1f} s'
        axes.plot(*plan.points.T, '.-', ms=3, lw=0.8, color=color, zorder=4, label=name)
    _draw_moving(axes, run, settings, first, last)
    axes.plot(*driven.T, color=_DRIVEN, lw=2.0, zorder=5, label='driven')
    axes.plot(*driven[0], 'o', color=_DRIVEN, ms=7, zorder=6, label='start')
    goals = np.array([goal.position for goal in settings.goals]).reshape(-1, 2)
    if len(goals):
        name = 'goal' if len(goals) == 1 else 'goals'
        axes.plot(*goals.T, '*', color=GOAL, ms=15, ls='', zorder=6, label=name)
    for goal in settings.goals:
        axes.annotate(goal.name, goal.position, (7, 7), textcoords='offset points', zorder=6)
    points = [driven, goals, *(plan.points for plan in plans), map_corners(settings)]
    width, height = show(axes, points, _ROOM * settings.road.width)
    figure.set_size_inches(_WIDTH, _WIDTH * height / width + _BELOW)
    handles = [*axes.get_legend_handles_labels()[0], *_keys(settings)]
    figure.legend(handles=handles, loc='outside lower center', ncols=4)
    figure.savefig(path, dpi=120)


def _draw_moving(axes: Axes, run: Run, settings: GuidanceSettings, first: int, last: int) -> None:
    """The path of a moving obstacle, and its position at the closest approach."""
    timeout = settings.moving_obstacles.timeout
    nearest: dict[str, tuple[float, int]] = {}
    for each in encounters(run.driven.between(first, last), run.tracks, 0.0, timeout):
        index = int(each.clearance.argmin())
        found = float(each.clearance[index]), int(each.stamps[index])
        nearest[each.name] = min(found, nearest.get(each.name, found))
    for index, (name, (_, stamp)) in enumerate(nearest.items()):
        way = np.array([(each.x, each.y) for each in run.tracks if each.name == name])
        axes.plot(*way.T, color=MOVING, ls='-.', lw=0.8, zorder=2)
        (there,) = (each for each in seen_at(run.tracks, stamp, timeout) if each.name == name)
        center, robot = (there.x, there.y), run.driven.at(stamp)[:2]
        label = 'moving obstacle where nearest' if index == 0 else None
        axes.add_patch(Circle(center, there.radius, color=MOVING, lw=0, zorder=4, label=label))
        axes.plot(*zip(center, robot, strict=True), color=MOVING, lw=1.0, zorder=4)
        axes.plot(*robot, '.', color=_DRIVEN, ms=8, zorder=6)
        when = f'{(stamp - first) / NANOSECONDS:.1f} s'
        axes.annotate(when, center, (9, -14), textcoords='offset points', zorder=6)


def draw_wheel_speeds(run: Run, settings: GuidanceSettings, path: Path) -> None:
    """Speeds of all wheels, with their limits."""
    first, last = window(run, settings)
    # Of two speeds at one instant the second is the one that a command has set.
    latest = np.append(np.diff(run.wheel_stamps) > 0, True)
    inside = latest & (run.wheel_stamps >= first) & (run.wheel_stamps < last)
    seconds = np.append((run.wheel_stamps[inside] - first) / 1e9, settings.final_time)
    wheel_speeds = np.vstack([run.wheel_speeds[inside], run.wheel_speeds[inside][-1:]])
    figure = Figure(figsize=(9.0, 4.5), layout='constrained')
    axes = figure.add_subplot()
    names = settings.robot.wheel_names
    for speeds, side, color in zip(wheel_speeds.T, names, BAGS, strict=False):
        axes.step(seconds, speeds, where='post', color=color, label=f'{side} wheel')
    limit = settings.robot.max_wheel_speed
    if math.isfinite(limit):
        axes.axhline(limit, color=LIMIT, ls='--', lw=1.0, label=f'limit {limit:g} rad/s')
        if wheel_speeds.min() < 0.0:
            axes.axhline(-limit, color=LIMIT, ls='--', lw=1.0)
    axes.set(xlabel='time [s]', ylabel='wheel speed [rad/s]', xlim=(0.0, settings.final_time))
    axes.grid(alpha=0.3)
    axes.legend()
    figure.savefig(path, dpi=120)


def _keys(settings: GuidanceSettings) -> list[Patch]:
    keys = [Patch(color=ROAD, label='road')]
    if settings.obstacles:
        keys.append(Patch(color=OBSTACLE, label='obstacle'))
        keys.append(Patch(fill=False, edgecolor=MARGIN, ls='--', label='kept clear at samples'))
    return keys
