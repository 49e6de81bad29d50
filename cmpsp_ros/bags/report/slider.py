"""The parts of the path chart that the slider moves: plans, robots, goals, obstacles and grids."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from cmpsp_ros.arrays import Array
from cmpsp_ros.bags.report.view import MOST_PLANS, View, thinned
from cmpsp_ros.bags.runs.goals import goals_driven_to
from cmpsp_ros.bags.runs.run import Driven
from cmpsp_ros.guidance import Goal
from cmpsp_ros.guidance.messages import Track
from cmpsp_ros.view import body, coordinates, disc, grid_picture, numbers


def moving(views: Sequence[View]) -> list[dict[str, Any]]:
    """For each bag its plans, poses, obstacles, goals and decisions."""
    return [
        {
            'plans': [
                {
                    't': round(view.record.seconds(each.stamp), 6),
                    'x': numbers(each.points[:, 0]),
                    'y': numbers(each.points[:, 1]),
                }
                for each in view.plans
            ],
            'grids': [
                {'t': round(view.record.seconds(stamp), 6), **grid_picture(grid)}
                for stamp, grid in view.grids
            ],
            't': numbers(view.times),
            'x': numbers(view.poses[:, 0]),
            'y': numbers(view.poses[:, 1]),
            'heading': numbers(view.poses[:, 2]),
            'body': coordinates(body(view.settings)),
            'others': [_of_robot(view, each) for each in view.others.values()],
            'disc': coordinates(disc(view.settings.moving_obstacles.others_radius)),
            'clearance': {'t': numbers(view.clearance[0]), 'value': numbers(_least(view))},
            'decisions': [
                [round(view.record.seconds(each.stamp), 6), each.level, each.reason]
                for each in view.record.decisions
            ],
            'goals': [
                [round(seconds, 6), *goal.position, label_of(goal)]
                for seconds, goal in goals_over_time(view)
            ],
            'moving': [_of_obstacle(view, each) for each in view.tracks],
            'timeout': view.settings.moving_obstacles.timeout,
        }
        for view in views
    ]


def goals_over_time(view: View) -> list[tuple[float, Goal]]:
    """Time from which each goal is the current one [s], in order; none for a followed road."""
    found = goals_driven_to(view.record.decisions, view.settings)
    return [(view.record.seconds(stamp), goal) for stamp, goal in found]


def goals_of(view: View) -> list[Goal]:
    """All goals there were, each once."""
    driven_to = (goal for _, goal in goals_over_time(view))
    places = {(goal.position, goal.name): goal for goal in (*driven_to, *view.settings.goals)}
    named = {position for position, name in places if name}
    return [goal for (place, name), goal in places.items() if name or place not in named]


def label_of(goal: Goal) -> str:
    """A goal in words."""
    return f'{goal.name} at {goal.time:g} s' if goal.name else 'the goal'


def _least(view: View) -> Array:
    """Clearance from everything there is, shape ``(K,)``; infinite where there is nothing."""
    times, clearance = view.clearance
    least: Array = np.min([np.full(len(times), np.inf), *clearance.values()], axis=0)
    return least


def _of_robot(view: View, driven: Driven) -> dict[str, Any]:
    times = np.array([view.record.seconds(each) for each in driven.stamps.tolist()])
    columns = dict(zip(('x', 'y', 'heading'), driven.poses.T, strict=True))
    return {name: numbers(each) for name, each in {'t': times, **columns}.items()}


def _of_obstacle(view: View, tracks: Sequence[Track]) -> dict[str, Any]:
    chosen = [tracks[k] for k in thinned(np.arange(len(tracks)), MOST_PLANS)]
    columns = {
        name: numbers(np.array([getattr(each, name) for each in chosen]))
        for name in ('x', 'y', 'vx', 'vy', 'radius')
    }
    times = np.array([view.record.seconds(each.stamp) for each in chosen])
    return {'t': numbers(times), **columns}
