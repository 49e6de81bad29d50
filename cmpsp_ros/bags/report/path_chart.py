"""The chart of the road with obstacles, driven paths, and the plan at the slider's time."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from cmpsp_ros.bags.report.charts import Figure, axis, escaped, layout, numbers
from cmpsp_ros.bags.report.slider import goals_of, tracks_of_each
from cmpsp_ros.bags.report.view import View
from cmpsp_ros.guidance.messages.tracks import Track
from cmpsp_ros.view.drawing import map_corners
from cmpsp_ros.view.palette import EDGE, GOAL, OBSTACLE, ROAD, bag_color
from cmpsp_ros.world.obstacles.shapes import Shape, outlines
from cmpsp_ros.world.roads.road import Road

Array = NDArray[np.float64]

_NONE: Array = np.zeros(0)

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
        if obstacle.corners:
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
    """Paths, plans, robots, moving obstacles and current goal, each for all bags; then the rest.

    The script relies on this order, and fills the traces that are empty here.
    """
    several = len(views) > 1
    named = [(f'{escaped(view.label)}: ' if several else '', view) for view in views]
    colors = [bag_color(number) for number in range(len(views))]
    obstacle = {'fill': 'toself', 'fillcolor': OBSTACLE, 'opacity': 0.85, 'line': {'width': 0}}
    ring = {'symbol': 'circle-open', 'size': 26, 'line': {'width': 2}}
    return [
        *(
            _trace(f'{prefix}driven', 'lines', view.poses[:, 0], view.poses[:, 1])
            | _hover([f'{each:.2f} s' for each in view.times])
            | {'line': {'color': color, 'width': 2.6}}
            for (prefix, view), color in zip(named, colors, strict=True)
        ),
        *(
            _trace(f'{prefix}plan', 'lines+markers')
            | {'line': {'color': color, 'width': 1.2, 'dash': 'dot'}}
            | {'marker': {'size': 5, 'symbol': 'circle-open'}}
            for (prefix, _), color in zip(named, colors, strict=True)
        ),
        *(
            _trace(f'{prefix}robot', 'markers', view.poses[:1, 0], view.poses[:1, 1])
            | {'marker': _arrow(view.poses[0, 2], color), 'showlegend': False}
            for (prefix, view), color in zip(named, colors, strict=True)
        ),
        *(
            _trace(f'{prefix}moving obstacles', 'lines') | obstacle | {'showlegend': False}
            for prefix, _ in named
        ),
        *(
            _trace(f'{prefix}driven to', 'markers') | {'marker': {'color': color, **ring}}
            for (prefix, _), color in zip(named, colors, strict=True)
        ),
        *_goals(views),
        *(_way(view, tracks) for view in views for tracks in tracks_of_each(view)),
    ]


def _trace(name: str, mode: str, x: Array = _NONE, y: Array = _NONE) -> Figure:
    return {'type': 'scatter', 'name': name, 'mode': mode, 'hoverinfo': 'skip'} | {
        'x': numbers(x),
        'y': numbers(y),
    }


def _hover(texts: list[str]) -> Figure:
    """What is shown of a point, with a text for each."""
    shown = {'hovertemplate': '%{text}: %{x:.3f}, %{y:.3f} m<extra></extra>', 'hoverinfo': 'all'}
    return {'text': texts, **shown}


def _arrow(heading: float, color: str) -> Figure:
    white = {'color': '#ffffff', 'width': 1.5}
    angle = 90.0 - math.degrees(heading)
    return {'symbol': 'arrow-wide', 'size': 18, 'angle': angle, 'color': color, 'line': white}


def _goals(views: Sequence[View]) -> list[Figure]:
    goals = goals_of(views)
    if not goals:
        return []
    name = 'goal' if len(goals) == 1 else 'goals'
    trace = _trace(name, 'markers+text', *np.array([goal.position for goal in goals]).T)
    trace |= _hover([escaped(goal.name) for goal in goals])
    trace['hovertemplate'] = f'goal {trace["hovertemplate"]}'
    marker = {'symbol': 'star', 'size': 15, 'color': GOAL}
    return [trace | {'textposition': 'top right', 'cliponaxis': False, 'marker': marker}]


def _way(view: View, tracks: Sequence[Track]) -> Figure:
    """Where a moving obstacle was."""
    x, y = np.array([(each.x, each.y) for each in tracks]).T
    times = [(view.record.seconds(each.stamp), each.radius) for each in tracks]
    trace = _trace(tracks[0].name, 'lines', x, y)
    trace |= _hover([f'{seconds:.2f} s, radius {radius:.3g} m' for seconds, radius in times])
    return trace | {'line': {'color': OBSTACLE, 'width': 1.6, 'dash': 'dashdot'}}


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
    points += [map_corners(view.settings) for view in views]
    low, high = np.vstack(points).min(axis=0), np.vstack(points).max(axis=0)
    road = views[0].settings.road
    room = _ROOM * road.width
    return [low[0] - room, high[0] + room], [low[1] - room, high[1] + room]


def _line(points: Array) -> str:
    return f'M {" L ".join(f"{x:.4f},{y:.4f}" for x, y in points.tolist())}'


def _edge(obstacle: Shape, distance: float) -> Figure:
    if len(obstacle.corners) == 1:
        return _circle(obstacle.center, distance)
    lines = [f'{_line(line)} Z' for line in outlines(obstacle, distance)]
    return {'type': 'path', 'path': ' '.join(lines)}


def _circle(center: tuple[float, float], radius: float) -> Figure:
    x, y = center
    return {'type': 'circle', 'x0': x - radius, 'x1': x + radius} | {
        'y0': y - radius,
        'y1': y + radius,
    }
