"""The chart of the road with obstacles, paths driven, and the plan at the slider's time."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from cmpsp_ros.bags.report.charts import Figure, axis, escaped, layout, numbers
from cmpsp_ros.bags.report.slider import goals_of, tracks_of_each
from cmpsp_ros.bags.report.view import View
from cmpsp_ros.view.palette import EDGE, GOAL, OBSTACLE, ROAD, bag_color
from cmpsp_ros.world.obstacles.shapes import Obstacle, Shape, outline
from cmpsp_ros.world.roads.road import Road

Array = NDArray[np.float64]

_ROOM = 0.6
"""Part of the road's width that is shown around everything that happened."""


def path(views: Sequence[View]) -> Figure:
    """Road, obstacles, goal, paths driven, plans and robots."""
    figure: Figure = {'data': _traces(views), 'layout': layout()}
    shapes, annotations = [], []
    for road in dict.fromkeys(road for view in views for road in view.roads):
        shapes += _road(road)
    for obstacle, kept in obstacles(views).items():
        shapes += _shapes(obstacle, kept)
        annotations.append(_name(obstacle))
    x, y = frame(views)
    figure['layout'] |= {
        'shapes': shapes,
        'annotations': annotations,
        'height': 640,
        'hovermode': 'closest',
        'xaxis': axis(
            {'title': {'text': 'x [m]'}, 'range': x, 'showgrid': False, 'zeroline': False}
        ),
        'yaxis': axis(
            {
                'title': {'text': 'y [m]'},
                'range': y,
                'showgrid': False,
                'zeroline': False,
                'scaleanchor': 'x',
            }
        ),
        'showlegend': True,
    }
    return figure


def _traces(views: Sequence[View]) -> list[Figure]:
    """Paths, plans, robots, what moves and the goal driven to, each for all bags; then the rest.

    The script counts on this order.
    """
    several = len(views) > 1
    prefixes = [f'{escaped(view.label)}: ' if several else '' for view in views]
    driven = [
        {
            'name': f'{prefix}driven',
            'mode': 'lines',
            'x': numbers(view.poses[:, 0]),
            'y': numbers(view.poses[:, 1]),
            'text': [f'{each:.2f} s' for each in view.times],
            'hovertemplate': '%{text}: %{x:.3f}, %{y:.3f} m<extra></extra>',
            'line': {'color': bag_color(number), 'width': 2.6},
        }
        for number, (prefix, view) in enumerate(zip(prefixes, views, strict=True))
    ]
    plans = [
        {
            'name': f'{prefix}plan',
            'mode': 'lines+markers',
            'x': [],
            'y': [],
            'hoverinfo': 'skip',
            'line': {'color': bag_color(number), 'width': 1.2, 'dash': 'dot'},
            'marker': {'size': 5, 'symbol': 'circle-open'},
        }
        for number, prefix in enumerate(prefixes)
    ]
    robots = [
        {
            'name': f'{prefix}robot',
            'mode': 'markers',
            'x': numbers(view.poses[:1, 0]),
            'y': numbers(view.poses[:1, 1]),
            'hoverinfo': 'skip',
            'showlegend': False,
            'marker': {
                'symbol': 'arrow-wide',
                'size': 18,
                'angle': 90.0 - math.degrees(view.poses[0, 2]),
                'color': bag_color(number),
                'line': {'color': '#ffffff', 'width': 1.5},
            },
        }
        for number, (prefix, view) in enumerate(zip(prefixes, views, strict=True))
    ]
    traces: list[Figure] = [*driven, *plans, *robots, *_discs(prefixes), *_goal_rings(prefixes)]
    return [{'type': 'scatter', **each} for each in (*traces, *_goals(views), *_ways(views))]


def _discs(prefixes: Sequence[str]) -> list[Figure]:
    """What moves at the slider's time."""
    return [
        {
            'name': f'{prefix}what moves',
            'mode': 'lines',
            'x': [],
            'y': [],
            'hoverinfo': 'skip',
            'showlegend': False,
            'fill': 'toself',
            'fillcolor': OBSTACLE,
            'opacity': 0.85,
            'line': {'width': 0},
        }
        for prefix in prefixes
    ]


def _goal_rings(prefixes: Sequence[str]) -> list[Figure]:
    """Rings around the goal that is driven to at the slider's time."""
    return [
        {
            'name': f'{prefix}driven to',
            'mode': 'markers',
            'x': [],
            'y': [],
            'hoverinfo': 'skip',
            'marker': {
                'symbol': 'circle-open',
                'size': 26,
                'color': bag_color(number),
                'line': {'width': 2},
            },
        }
        for number, prefix in enumerate(prefixes)
    ]


def _goals(views: Sequence[View]) -> list[Figure]:
    goals = goals_of(views)
    if not goals:
        return []
    x, y = np.array([goal.position for goal in goals]).T
    return [
        {
            'name': 'goal' if len(goals) == 1 else 'goals',
            'mode': 'markers+text',
            'x': numbers(x),
            'y': numbers(y),
            'text': [escaped(goal.name) for goal in goals],
            'textposition': 'top right',
            'cliponaxis': False,
            'hovertemplate': 'goal %{text}: %{x:.3f}, %{y:.3f} m<extra></extra>',
            'marker': {'symbol': 'star', 'size': 15, 'color': GOAL},
        }
    ]


def _ways(views: Sequence[View]) -> list[Figure]:
    """Where what moves was told to be, one line each."""
    return [
        {
            'name': told[0].name,
            'mode': 'lines',
            'x': numbers(np.array([each.x for each in told])),
            'y': numbers(np.array([each.y for each in told])),
            'text': [
                f'{view.record.seconds(each.stamp):.2f} s, radius {each.radius:.3g} m'
                for each in told
            ],
            'hovertemplate': '%{text}: %{x:.3f}, %{y:.3f} m<extra></extra>',
            'line': {'color': OBSTACLE, 'width': 1.6, 'dash': 'dashdot'},
        }
        for view in views
        for told in tracks_of_each(view)
    ]


def _road(road: Road) -> list[Figure]:
    shapes: list[Figure] = []
    if len(road.area()):
        fill = {'fillcolor': ROAD, 'fillrule': 'nonzero', 'line': {'width': 0}}
        shapes.append({'type': 'path', 'path': f'{_line(road.area())} Z', **fill})
    solid = {'color': EDGE, 'width': 1.2}
    dotted = {'color': EDGE, 'width': 1, 'dash': 'dot'}
    for points, line in [*((edge, solid) for edge in road.edges()), (road.center_line(), dotted)]:
        if len(points):
            shapes.append({'type': 'path', 'path': _line(points), 'line': line})
    return [shape | {'layer': 'below'} for shape in shapes]


def _shapes(obstacle: Shape, kept: float) -> list[Figure]:
    disc = _edge(obstacle, obstacle.radius)
    disc |= {'fillcolor': OBSTACLE, 'opacity': 0.85, 'line': {'width': 0}, 'layer': 'below'}
    if kept == obstacle.radius:
        return [disc]
    around = {'line': {'color': OBSTACLE, 'width': 1.2, 'dash': 'dash'}, 'layer': 'below'}
    return [disc, _edge(obstacle, kept) | around]


def _name(obstacle: Shape) -> Figure:
    x, y = obstacle.center
    font = {'color': '#ffffff', 'size': 13}
    return {'x': x, 'y': y, 'text': escaped(obstacle.name), 'showarrow': False, 'font': font}


def obstacles(views: Sequence[View]) -> dict[Shape, float]:
    """All obstacles there ever were, and the radius that the robot's centre keeps out of."""
    every = (epoch.settings for view in views for epoch in view.record.history.epochs)
    return {
        obstacle: obstacle.radius + settings.robot_radius + settings.safety.margin
        for settings in every
        for obstacle in settings.obstacles
    }


def frame(views: Sequence[View]) -> tuple[list[float], list[float]]:
    """What happened, with room around it, in x and in y."""
    points = [view.poses[:, :2] for view in views]
    points += [np.array([goal.position]) for goal in goals_of(views)]
    low, high = np.vstack(points).min(axis=0), np.vstack(points).max(axis=0)
    road = views[0].settings.road
    room = _ROOM * road.width
    return [low[0] - room, high[0] + room], [low[1] - room, high[1] + room]


def _line(points: Array) -> str:
    return f'M {" L ".join(f"{x:.4f},{y:.4f}" for x, y in points.tolist())}'


def _edge(obstacle: Shape, distance: float) -> Figure:
    if isinstance(obstacle, Obstacle):
        return _circle(obstacle.center, distance)
    return {'type': 'path', 'path': f'{_line(outline(obstacle, distance))} Z'}


def _circle(center: tuple[float, float], radius: float) -> Figure:
    x, y = center
    return {'type': 'circle', 'x0': x - radius, 'x1': x + radius} | {
        'y0': y - radius,
        'y1': y + radius,
    }
