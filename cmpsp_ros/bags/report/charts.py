"""The charts of a report, as plotly figures in plain data."""

import math
from collections.abc import Sequence
from html import escape
from itertools import cycle
from textwrap import shorten
from typing import Any

import numpy as np

from cmpsp_ros.arrays import Array
from cmpsp_ros.bags.report.view import View
from cmpsp_ros.view import GRID, LEVEL_COLORS, LIMIT, TEXT, bag_color, number, numbers

Figure = dict[str, Any]

_BINS, _GREY = 40, '#9aa2af'
_GAP = 0.12  # part of a panel's height that is left free below it


def levels(views: Sequence[View]) -> Figure:
    """Bands of the fallback levels over time, one row a bag."""
    traces: list[Figure] = []
    for level, color in LEVEL_COLORS.items():
        bands = [(view, each) for view in views for each in view.bands if each.level == level]
        if not bands:
            continue
        texts = [
            f'{each.begin:.2f} to {each.end:.2f} s, {each.steps} steps'
            f'<br>{escape(shorten(each.reason, 90, placeholder="…"))}'
            for _, each in bands
        ]
        look = {'type': 'bar', 'orientation': 'h', 'width': 0.6, 'textposition': 'none'}
        content = {
            'name': level,
            'y': [escape(view.label) for view, _ in bands],
            'base': [number(each.begin) for _, each in bands],
            'x': [number(each.end - each.begin) for _, each in bands],
            'text': texts,
            'hovertemplate': f'<b>{level}</b> %{{text}}<extra></extra>',
            'marker': {'color': color, 'line': {'color': '#ffffff', 'width': 1}},
        }
        traces.append(look | content)
    figure = _over_time(views, traces, {'autorange': 'reversed', 'automargin': True}, 'levels')
    figure['layout'] |= {'barmode': 'overlay', 'height': 130 + 34 * len(views)}
    figure['layout']['hovermode'] = 'closest'
    return figure


_DASHES = 'solid', 'dash', 'dashdot', 'dot'


def controls(views: Sequence[View]) -> Figure:
    """Controls as commanded with their limits, one panel each; driven ones can be switched on."""
    titles = quantities(views)
    traces = []
    for index, view in enumerate(views):
        for (times, signals), kind, shown in (
            (view.commands, 'commanded', True),
            (view.driven, 'driven', 'legendonly'),
        ):
            for each, dash in zip(signals, cycle(_DASHES)):
                line = {
                    'color': bag_color(index),
                    'dash': dash if kind == 'commanded' else 'dot',
                    'shape': 'hv',
                    'width': 1.6 if kind == 'commanded' else 1.0,
                }
                name = _named(views, view, f'{escape(each.name)}, {kind}')
                trace = _line(name, times, each.values, line) | {'visible': shown}
                traces.append(trace | {'yaxis': f'y{suffix(titles.index(each.axis))}'})
    figure = _stacked(views, traces, titles)
    for title in titles:
        for limit, text in limits(views, title).items():
            _mark(figure, limit, text, axis=f'y{suffix(titles.index(title))}')
    return figure


def quantities(views: Sequence[View]) -> list[str]:
    """Each quantity that a robot is controlled by, with its unit, in order."""
    return list(dict.fromkeys(each.axis for view in views for each in view.commands[1]))


def limits(views: Sequence[View], quantity: str) -> dict[float, str]:
    """Limits of a quantity with their names; negative ones only where it became negative."""
    found = [each for view in views for each in view.commands[1] if each.axis == quantity]
    most = {each.limit for each in found if math.isfinite(each.limit)}
    if any((each.values < 0.0).any() for each in found):
        most |= {-each for each in most}
    return {each: f'limit {each:.4g} {found[0].unit}'.rstrip() for each in sorted(most)}


def clearance(views: Sequence[View]) -> Figure:
    """Clearance of the path driven from road edges, obstacles and other robots."""
    traces = []
    for index, view in enumerate(views):
        times, values = view.clearance
        for (what, value), dash in zip(values.items(), cycle(_DASHES)):
            line = {'color': bag_color(index), 'dash': dash, 'width': 1.6}
            traces.append(_line(_named(views, view, what), times, value, line))
    figure = _over_time(views, traces, {'title': {'text': 'clearance [m]'}, 'rangemode': 'tozero'})
    _mark(figure, 0.0, 'contact')
    for margin in sorted({view.settings.safety.margin for view in views} - {0.0}):
        _mark(figure, margin, f'margin {margin:g} m')
    return figure


def position(views: Sequence[View]) -> Figure:
    """Position and heading, in two panels."""
    traces = []
    columns = (('x', 'solid'), ('y', 'dash'), ('heading', 'solid'))
    for index, view in enumerate(views):
        for column, (name, dash) in enumerate(columns):
            line = {'color': bag_color(index), 'dash': dash, 'width': 1.6}
            trace = _line(_named(views, view, name), view.times, view.poses[:, column], line)
            traces.append(trace | ({'yaxis': 'y2'} if name == 'heading' else {}))
    return _stacked(views, traces, ['position [m]', 'heading [rad]'])


def step_times(views: Sequence[View]) -> Figure:
    """Computing time of each control step, and the response time of those that were too late."""
    traces = []
    for index, view in enumerate(views):
        times, taken = view.steps
        if len(times):
            line = {'color': bag_color(index), 'width': 1.0}
            trace = _line(_named(views, view, 'step time'), times, taken, line)
            traces.append(trace | {'mode': 'lines+markers', 'marker': {'size': 4}})
        if len(view.missed_deadlines[0]):
            trace = _line(_named(views, view, 'deadline missed'), *view.missed_deadlines, {})
            marker = {'size': 7, 'symbol': 'x', 'color': LIMIT}
            traces.append(trace | {'mode': 'markers', 'marker': marker})
    axis = {'title': {'text': 'step time [ms]'}, 'type': 'log', 'dtick': 1}
    figure = _over_time(views, traces, axis)
    for deadline in sorted({1e3 * view.settings.control_period for view in views}):
        _mark(figure, deadline, f'deadline {deadline:g} ms', log=True)
    return figure


def step_histogram(views: Sequence[View]) -> Figure:
    """Histogram of the computing time of control steps."""
    everything = np.concatenate([view.steps[1] for view in views])
    positive = everything[(everything > 0.0) & np.isfinite(everything)]
    traces: list[Figure] = []
    ends = (float(positive.min()), float(positive.max())) if len(positive) else (1.0, 10.0)
    edges = np.geomspace(ends[0] * 0.95, ends[1] * 1.05, _BINS + 1)
    for index, view in enumerate(views):
        taken = view.steps[1]
        counts = np.histogram(taken[taken > 0.0], edges)[0]
        traces.append(
            {
                'type': 'bar',
                'name': escape(view.label),
                'x': numbers(np.sqrt(edges[:-1] * edges[1:])),
                'width': numbers(np.diff(edges)),
                'y': counts.tolist(),
                'marker': {'color': bag_color(index)},
                'opacity': 0.85 if len(views) == 1 else 0.55,
                'hovertemplate': '%{x:.3g} ms: %{y} steps<extra></extra>',
            }
        )
    shape = layout() | {
        'barmode': 'overlay',
        'xaxis': axis({'title': {'text': 'step time [ms]'}, 'type': 'log'}),
        'yaxis': axis({'title': {'text': 'control steps'}, 'rangemode': 'tozero'}),
        'showlegend': len(views) > 1,
    }
    return {'data': traces, 'layout': shape}


def layout() -> Figure:
    """Layout that all charts share."""
    return {
        'font': {'family': 'system-ui, sans-serif', 'size': 13, 'color': TEXT},
        'paper_bgcolor': '#ffffff',
        'plot_bgcolor': '#ffffff',
        'margin': {'l': 70, 'r': 24, 't': 36, 'b': 48},
        'height': 300,
        'legend': {'orientation': 'h', 'x': 0, 'y': 1.02, 'yanchor': 'bottom'},
        'hovermode': 'x unified',
        'hoverlabel': {'align': 'left', 'bgcolor': '#ffffff'},
        'shapes': [],
        'annotations': [],
    }


def axis(more: Figure) -> Figure:
    """An axis in the report's style, with these settings."""
    lines = {'gridcolor': GRID, 'zerolinecolor': GRID, 'linecolor': _GREY, 'showline': True}
    return {**lines, 'ticks': 'outside', 'tickcolor': _GREY, **more}


def _over_time(
    views: Sequence[View], traces: list[Figure], y: Figure, kind: str = 'curves'
) -> Figure:
    """A chart over time, with the slider's cursor as its first shape."""
    end = max(view.end for view in views)
    cursor = {'type': 'line', 'x0': 0.0, 'x1': 0.0, 'yref': 'paper', 'y0': 0.0, 'y1': 1.0}
    shape = layout() | {
        'xaxis': axis({'title': {'text': 'time [s]'}, 'range': [0.0, number(end)]}),
        'yaxis': axis(y),
        'showlegend': True,
        'meta': {'kind': kind},
        'shapes': [cursor | {'line': {'color': TEXT, 'width': 1, 'dash': 'dot'}}],
    }
    return {'data': traces, 'layout': shape}


def _stacked(views: Sequence[View], traces: list[Figure], titles: Sequence[str]) -> Figure:
    figure, count = _over_time(views, traces, {}), len(titles)
    for index, title in enumerate(titles):
        domain = [1.0 - (index + 1 - _GAP * (index < count - 1)) / count, 1.0 - index / count]
        own = axis({'title': {'text': title}, 'domain': domain})
        figure['layout'][f'yaxis{suffix(titles.index(title))}'] = own
    figure['layout']['xaxis']['anchor'] = f'y{suffix(count - 1)}'
    figure['layout']['height'] = 140 + 160 * count
    return figure


def suffix(index: int) -> str:
    """Suffix of an axis as plotly counts them: none, 2, 3."""
    return str(index + 1) if index else ''


def _line(name: str, times: Array, values: Array, line: Figure) -> Figure:
    shown = {'type': 'scatter', 'mode': 'lines', 'name': name, 'hovertemplate': '%{y:.4g}'}
    return shown | {'x': numbers(times), 'y': numbers(values), 'line': line}


def _mark(figure: Figure, value: float, text: str, *, axis: str = 'y', log: bool = False) -> None:
    line = {'color': LIMIT, 'width': 1.4, 'dash': 'dash'}
    shape = {'type': 'line', 'xref': 'paper', 'x0': 0, 'x1': 1, 'y0': value, 'y1': value}
    figure['layout']['shapes'].append(shape | {'yref': axis, 'line': line})
    place = {'xref': 'paper', 'x': 1.0, 'xanchor': 'right', 'yref': axis, 'yanchor': 'bottom'}
    place['y'] = math.log10(value) if log else value
    said = {'text': text, 'showarrow': False, 'font': {'color': LIMIT, 'size': 12}}
    figure['layout']['annotations'].append(place | said)


def _named(views: Sequence[View], view: View, name: str) -> str:
    return name if len(views) == 1 else f'{escape(view.label)}: {name}'
