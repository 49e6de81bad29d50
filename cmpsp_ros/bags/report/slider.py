"""The parts of the path chart that the slider moves: plans, robots, goals, obstacles and grids."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import groupby
from typing import Any

import numpy as np

from cmpsp_ros.bags.report.charts import numbers
from cmpsp_ros.bags.report.view import MOST_PLANS, View, thinned
from cmpsp_ros.bags.runs.goals import goals_driven_to
from cmpsp_ros.guidance.goals import Goal
from cmpsp_ros.guidance.messages.tracks import Track
from cmpsp_ros.view.grid_picture import grid_picture


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
            'clearance': {
                't': numbers(view.clearance[0]),
                'value': numbers(np.minimum(*view.clearance[1:])),
            },
            'decisions': [
                [round(view.record.seconds(each.stamp), 6), each.level, each.reason]
                for each in view.record.decisions
            ],
            'goals': [
                [round(seconds, 6), *goal.position, label_of(goal)]
                for seconds, goal in goals_over_time(view)
            ],
            'moving': [_of_obstacle(view, each) for each in tracks_of_each(view)],
            'timeout': view.settings.moving_obstacles.timeout,
        }
        for view in views
    ]


def tracks_of_each(view: View) -> list[list[Track]]:
    """What was received of each moving obstacle, in order of time."""
    grouped = groupby(view.record.tracks, key=lambda each: each.id)
    return [list(tracks) for _, tracks in grouped]


def goals_over_time(view: View) -> list[tuple[float, Goal]]:
    """Time from which each goal is the current one [s], in order; none for a followed road."""
    found = goals_driven_to(view.record.decisions, view.settings)
    return [(view.record.seconds(stamp), goal) for stamp, goal in found]


def goals_of(views: Sequence[View]) -> list[Goal]:
    """All goals there were, each once."""
    asked = (goal for view in views for goal in view.settings.goals)
    driven_to = (goal for view in views for _, goal in goals_over_time(view))
    places = {(goal.position, goal.name): goal for goal in (*driven_to, *asked)}
    named = {position for position, name in places if name}
    return [goal for (place, name), goal in places.items() if name or place not in named]


def label_of(goal: Goal) -> str:
    """A goal in words."""
    return f'{goal.name} at {goal.time:g} s' if goal.name else 'the goal'


def _of_obstacle(view: View, tracks: list[Track]) -> dict[str, Any]:
    chosen = [tracks[k] for k in thinned(np.arange(len(tracks)), MOST_PLANS)]
    columns = {
        name: numbers(np.array([getattr(each, name) for each in chosen]))
        for name in ('x', 'y', 'vx', 'vy', 'radius')
    }
    times = np.array([view.record.seconds(each.stamp) for each in chosen])
    return {'t': numbers(times), **columns}
