"""The chart of the courses with driven paths, and what the slider moves on them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cmpsp_ros.bags.report.charts import Figure, axis, escaped, layout, numbers, suffix
from cmpsp_ros.bags.report.slider import coordinates, goals_of
from cmpsp_ros.bags.report.view import View
from cmpsp_ros.view.palette import GOAL, MOVING, SEEN, TEXT, UNSEEN, bag_color
from cmpsp_ros.view.scene import Part, frame, map_corners

Array = NDArray[np.float64]

_NONE: Array = np.zeros(0)
_PANEL, _GAP = 520, 0.13
"""Height of a panel [pixels], and the part of it that is left free below it."""

_ROOM = 0.6
"""Part of the road's width that is shown around everything that happened."""


def path(views: Sequence[View]) -> Figure:
    """Courses, goals, paths driven, plans and robots; a panel for each course.

    Traces that the script fills carry the number of their bag and their part in `meta`.
    """
    figure: Figure = {'data': [], 'layout': layout()}
    places = panels(views)
    height = _PANEL * len(places)
    figure['layout'] |= {'height': height + 150, 'hovermode': 'closest', 'showlegend': True}
    figure['layout']['legend'] = {'orientation': 'h', 'x': 0, 'y': -60 / height, 'yanchor': 'top'}
    for number, members in enumerate(places):
        on, count = suffix(number), len(places)
        x, y = frame_of([views[k] for k in members])
        low = 1.0 - (number + 1 - _GAP * (number < count - 1)) / count
        own = {'showgrid': False, 'zeroline': False}
        figure['layout'][f'xaxis{on}'] = axis(
            {'title': {'text': 'x [m]'}, 'range': x, 'anchor': f'y{on}', **own}
        )
        figure['layout'][f'yaxis{on}'] = axis(
            {
                'title': {'text': 'y [m]'},
                'range': y,
                'domain': [low, 1.0 - number / count],
                'scaleanchor': f'x{on}',
                **own,
            }
        )
        for trace in _panel(views, members):
            figure['data'].append(trace | {'xaxis': f'x{on}', 'yaxis': f'y{on}'})
    _name_once(figure['data'])
    return figure


def panels(views: Sequence[View]) -> list[list[int]]:
    """Numbers of the views that have the same course, in order."""
    found: dict[object, list[int]] = {}
    for number, view in enumerate(views):
        found.setdefault(tuple(part.key for part in view.course), []).append(number)
    return list(found.values())


def frame_of(views: Sequence[View]) -> list[tuple[float, float]]:
    """What happened on a course, with room around it: ends in x and in y [m]."""
    points = [np.array([goal.position for goal in goals_of(view)]) for view in views]
    points = [view.poses[:, :2] for view in views] + [each for each in points if len(each)]
    points += [map_corners(view.settings) for view in views]
    points += [other.poses[:, :2] for view in views for other in view.others.values()]
    points += [line for view in views for each in view.run[-1:] for line in each.lines]
    shapes = [shape for view in views for shape in (*view.shapes, *view.hidden)]
    low, high = frame(points, shapes, _ROOM * views[0].settings.road.width)
    return list(zip(low.tolist(), high.tolist(), strict=True))


def _panel(views: Sequence[View], members: Sequence[int]) -> Iterator[Figure]:
    """The course of some views, and then the run of each."""
    for part in views[members[0]].course:
        yield from _part(part)
    if any(views[k].grids for k in members):
        for name, color in (('seen by sensors', SEEN), ('not seen yet', UNSEEN)):
            square = {'symbol': 'square', 'size': 12, 'color': color, 'opacity': 0.55}
            yield _trace(name, 'markers', np.array([np.nan]), np.array([np.nan])) | {
                'marker': square
            }
    for number in members:
        # With several bags the legend has one entry for each, which switches all of it.
        named = {'legendgroup': f'bag {number}', 'showlegend': False} if len(views) > 1 else {}
        for trace in _run(number, views[number]):
            yield trace | named
        driven = _driven(views[number], bag_color(number)) | named
        if len(views) > 1:
            driven |= {'showlegend': True, 'name': escaped(views[number].label)}
        yield driven


def _run(number: int, view: View) -> Iterator[Figure]:
    """One run but for the path driven, with traces that are empty until the script fills them."""
    color = bag_color(number)
    for part in view.run:
        yield from _part(part, color)
    grey = {'color': TEXT, 'width': 1.4}
    moving = {'fill': 'toself', 'fillcolor': MOVING, 'line': {'width': 0}}
    ring = {'symbol': 'circle-open', 'size': 26, 'line': {'width': 2}, 'color': color}
    hidden = {'showlegend': False}
    for name, mode, look in (
        ('moving', 'lines', {**moving, **hidden, 'opacity': 0.85}),
        ('others', 'lines', {'fill': 'toself', 'fillcolor': '#d9dce2', 'line': grey, **hidden}),
        ('plan', 'lines+markers', {
            'line': {'color': color, 'width': 1.2, 'dash': 'dot'},
            'marker': {'size': 5, 'symbol': 'circle-open'},
        }),
        ('driven to', 'markers', {'marker': ring}),
        ('body', 'lines', {'line': {'color': color, 'width': 2.0}, **hidden}),
        ('robot', 'markers', {'marker': _arrow(view.poses[:1, 2], color, 17), **hidden}),
    ):  # fmt: skip
        yield _trace(name, mode) | look | {'meta': {'bag': number, 'part': name}}
    ends = _trace('start and end', 'markers', *view.poses[[0, -1], :2].T)
    yield ends | {'marker': _arrow(view.poses[[0, -1], 2], color, 13)}
    if goals := goals_of(view):
        name = 'goal' if len(goals) == 1 else 'goals'
        trace = _trace(name, 'markers+text', *np.array([goal.position for goal in goals]).T)
        trace |= _hover([escaped(goal.name) for goal in goals])
        trace['hovertemplate'] = f'goal {trace["hovertemplate"]}'
        marker = {'symbol': 'star', 'size': 15, 'color': GOAL}
        yield trace | {'textposition': 'top right', 'cliponaxis': False, 'marker': marker}


def _driven(view: View, color: str) -> Figure:
    trace = _trace('driven', 'lines', *view.poses[:, :2].T)
    trace |= _hover([f'{each:.2f} s' for each in view.times])
    return trace | {'line': {'color': color, 'width': 2.6}}


def _part(part: Part, color: str = '') -> Iterator[Figure]:
    """Lines of one kind as a trace, and its names as another."""
    look = part.look
    if not part.lines:
        return
    trace = _trace(look.label, 'lines') | dict(zip('xy', coordinates(part.lines), strict=True))
    line = {'color': look.color or color, 'width': 1.2 * look.width, 'dash': look.dash}
    filled = {'fill': 'toself', 'fillcolor': look.fill} if look.fill else {}
    yield trace | filled | {'line': line, 'showlegend': bool(look.label)}
    if part.names:
        names = _trace(f'names of {part.kind}', 'text', *np.array([at for _, at in part.names]).T)
        inside, around = look.of_names
        glow = ', '.join([f'0 0 2px {around}'] * 4)
        font = {'color': inside, 'size': 13, 'shadow': glow}
        texts = [escaped(name) for name, _ in part.names]
        yield names | {'text': texts, 'textfont': font, 'showlegend': False}


def _name_once(traces: Sequence[Figure]) -> None:
    """Keep one entry of each name in the legend; panels share it."""
    known = set[str]()
    for trace in traces:
        if trace['name'] in known and 'meta' not in trace:
            trace['showlegend'] = False
        known.add(trace['name'])


def _trace(name: str, mode: str, x: Array = _NONE, y: Array = _NONE) -> Figure:
    trace: dict[str, Any] = {'type': 'scatter', 'name': name, 'mode': mode, 'hoverinfo': 'skip'}
    return trace | {'x': numbers(x), 'y': numbers(y)}


def _hover(texts: list[str]) -> Figure:
    """What is shown of a point, with a text for each."""
    shown = {'hovertemplate': '%{text}: %{x:.3f}, %{y:.3f} m<extra></extra>', 'hoverinfo': 'all'}
    return {'text': texts, **shown}


def _arrow(headings: Array, color: str, size: int) -> Figure:
    white, angles = {'color': '#ffffff', 'width': 1.5}, numbers(90.0 - np.degrees(headings))
    return {'symbol': 'triangle-up', 'size': size, 'angle': angles, 'color': color, 'line': white}
