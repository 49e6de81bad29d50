"""Chart of the path, and the data that its slider moves."""

from collections.abc import Iterator, Sequence
from html import escape
from typing import Any

import numpy as np

from cmpsp_ros import view as drawing
from cmpsp_ros.arrays import Array
from cmpsp_ros.bags.report.charts import Figure, axis, layout, suffix
from cmpsp_ros.bags.report.view import MOST_PLANS, View, thinned
from cmpsp_ros.bags.runs.run import DrivenPath, goals_driven_to, lifetime
from cmpsp_ros.guidance import Goal
from cmpsp_ros.guidance.messages import Track

_POSE = 'x', 'y', 'heading'


def moving(views: Sequence[View]) -> list[dict[str, Any]]:
    """For each bag its plans, poses, obstacles, goals and decisions."""
    return [
        {
            'plans': [
                {'t': round(view.record.seconds(each.stamp), 6), **_columns('xy', each.points)}
                for each in view.plans
            ],
            'grids': [
                {'t': round(view.record.seconds(stamp), 6), **drawing.grid_picture(grid)}
                for stamp, grid in view.grids
            ],
            't': drawing.numbers(view.times),
            **_columns(_POSE, view.poses),
            'body': drawing.coordinates(drawing.body(view.settings)),
            'others': [_of_robot(view, each) for _, each in view.others],
            'disc': drawing.coordinates(drawing.disc(view.settings.moving_obstacles.others_radius)),
            'clearance': {
                't': drawing.numbers(view.clearance[0]),
                'value': drawing.numbers(_least(view)),
            },
            'decisions': [
                [round(view.record.seconds(each.stamp), 6), each.level, each.reason]
                for each in view.record.decisions
            ],
            'goals': [
                [round(seconds, 6), *goal.position, label_of(goal)]
                for seconds, goal in goals_over_time(view)
            ],
            'moving': [_of_obstacle(view, each) for each in view.tracks],
            'people': [_of_obstacle(view, each) for each in view.people],
            'sigmas': drawing.SIGMAS,
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
    """Minimum clearance from everything, shape ``(K,)``; infinite if nothing is near."""
    times, clearance = view.clearance
    return np.asarray(np.min([np.full(len(times), np.inf), *clearance.values()], axis=0))


def _of_robot(view: View, driven: DrivenPath) -> dict[str, Any]:
    times = np.array([view.record.seconds(each) for each in driven.stamps.tolist()])
    return {'t': drawing.numbers(times), **_columns(_POSE, driven.poses)}


def _columns(names: Sequence[str], values: Array) -> dict[str, Any]:
    return dict(zip(names, map(drawing.numbers, values.T), strict=True))


def _of_obstacle(view: View, tracks: Sequence[Track]) -> dict[str, Any]:
    chosen = [tracks[k] for k in thinned(np.arange(len(tracks)), MOST_PLANS)]
    names = (*Track.FIELDS, *Track.DOUBTS)
    columns = _columns(
        names, np.array([[getattr(each, name) for name in names] for each in chosen])
    )
    times = np.array([view.record.seconds(each.stamp) for each in chosen])
    return {'t': drawing.numbers(times), 'timeout': lifetime(tracks[0], view.settings), **columns}


# Height of a panel [pixels], and the part of it that is left free below it.
_PANEL, _GAP = 520, 0.13
_ROOM = 0.6  # part of the road's width that is shown around everything that happened


def path(views: Sequence[View]) -> Figure:
    """Courses, goals, paths driven, plans and robots; a panel for each course."""
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
            {'title': {'text': 'x [m]', 'standoff': 6}, 'range': x, 'anchor': f'y{on}', **own}
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
        for each in _panel(views, members):
            figure['data'].append(each | {'xaxis': f'x{on}', 'yaxis': f'y{on}'})
    _name_once(figure['data'])
    return figure


def panels(views: Sequence[View]) -> list[list[int]]:
    """Numbers of the views that have the same course, in order."""
    found: dict[object, list[int]] = {}
    for number, view in enumerate(views):
        found.setdefault(tuple(part.key for part in view.course), []).append(number)
    return list(found.values())


def frame_of(views: Sequence[View]) -> list[tuple[float, float]]:
    """Ends in x and in y of a picture of all runs on a course [m]."""
    points = [np.array([goal.position for goal in goals_of(view)]) for view in views]
    points = [view.poses[:, :2] for view in views] + [each for each in points if len(each)]
    points += [drawing.map_corners(view.settings) for view in views]
    points += [other.poses[:, :2] for view in views for _, other in view.others]
    points += [line for view in views for each in view.run[-1:] for line in each.lines]
    shapes = [shape for view in views for shape in (*view.shapes, *view.hidden)]
    low, high = drawing.frame(points, shapes, _ROOM * views[0].settings.road.width)
    return list(zip(low.tolist(), high.tolist(), strict=True))


def _panel(views: Sequence[View], members: Sequence[int]) -> Iterator[Figure]:
    yield from drawing.traces(views[members[0]].course, '')
    if any(views[k].grids for k in members):
        for name, color in (
            (drawing.LOOKS['seen'].label, drawing.SEEN),
            ('not seen yet', drawing.UNSEEN),
        ):
            square = {'symbol': 'square', 'size': 12, 'color': color, 'opacity': 0.55}
            yield drawing.trace(name, 'markers', *np.full((2, 1), np.nan)) | {'marker': square}
    for number in members:
        # With several bags the legend has one entry for each, which switches all of it.
        named = {'legendgroup': f'bag {number}', 'showlegend': False} if len(views) > 1 else {}
        for each in _run(number, views[number]):
            yield each | named
        driven = drawing.trace('driven', 'lines', *views[number].poses[:, :2].T)
        driven |= drawing.hover([f'{each:.2f} s' for each in views[number].times])
        driven |= {'line': {'color': drawing.bag_color(number), 'width': 2.6}} | named
        if len(views) > 1:
            driven |= {'showlegend': True, 'name': escape(views[number].label)}
        yield driven


def _run(number: int, view: View) -> Iterator[Figure]:
    """One run but for the path driven, with traces that are empty until the script fills them."""
    color = drawing.bag_color(number)
    yield from drawing.traces(view.run, color)
    grey = {'color': drawing.TEXT, 'width': 1.4}
    moving = {'fill': 'toself', 'fillcolor': drawing.MOVING, 'line': {'width': 0}}
    ring = {'symbol': 'circle-open', 'size': 30, 'line': {'width': 2}, 'color': color}
    hidden = {'showlegend': False}
    for name, mode, look in (
        ('doubts', 'lines', {**moving, **hidden, 'opacity': 0.2}),
        ('moving', 'lines', {**moving, **hidden, 'opacity': 0.85}),
        ('velocities', 'lines', {'line': {'color': drawing.MOVING, 'width': 2.0}, **hidden}),
        ('people', 'lines', {'line': {'color': drawing.PERSON, 'width': 2.0}, **hidden}),
        ('others', 'lines', {'fill': 'toself', 'fillcolor': '#d9dce2', 'line': grey, **hidden}),
        ('plan', 'lines+markers', {
            'line': {'color': color, 'width': 1.2, 'dash': 'dot'},
            'marker': {'size': 5, 'symbol': 'circle-open'},
        }),
        ('driven to', 'markers', {'marker': ring}),
        ('body', 'lines', {'line': {'color': color, 'width': 2.0}, **hidden}),
        ('robot', 'markers', {**drawing.arrow(view.poses[:1, 2], color, 17), **hidden}),
    ):  # fmt: skip
        yield drawing.trace(name, mode) | look | {'meta': {'bag': number, 'part': name}}
    yield drawing.goals_trace(goals_of(view))
    yield drawing.ends(view.poses, color)


def _name_once(shown: Sequence[Figure]) -> None:
    known = set[str]()
    for each in shown:
        if each['name'] in known and 'legendgroup' not in each:
            each['showlegend'] = False
        known.add(each['name'])
