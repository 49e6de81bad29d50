"""Scenes in matplotlib's axes."""

from collections.abc import Iterable, Sequence
from html import unescape
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure, SubFigure
from matplotlib.patches import PathPatch
from matplotlib.path import Path
from matplotlib.patheffects import withStroke

from cmpsp_ros.arrays import Array
from cmpsp_ros.robots.motion import arc_ends
from cmpsp_ros.view.plotly_traces import Trace
from cmpsp_ros.view.scene import TEXT, frame

Look = dict[str, Any]

PER_ARC = 8  # points drawn on each arc
_POINT = 0.75  # points in a pixel of plotly
# Matplotlib's names for plotly's.
_SYMBOLS = {'circle': 'o', 'star': '*', 'square': 's'}
_DASHES = {'solid': '-', 'dash': '--', 'dot': ':', 'dashdot': '-.'}


def legend_below(figure: Figure | SubFigure, *keys: Sequence[Any], **options: Any) -> None:
    """Legend below all axes, or in free height for Matplotlib 3.6, which has no place outside."""
    if mpl.__version_info__ >= (3, 7):
        figure.legend(*keys, loc='outside lower center', **options)
        return
    legend = figure.legend(*keys, loc='lower center', **options)
    whole: Any = figure.figure
    whole.draw_without_rendering()
    below = legend.get_window_extent().height / figure.bbox.height
    whole.get_layout_engine().set(rect=(0.0, below, 1.0, 1.0 - below))


def draw(axes: Axes, traces: Iterable[Trace], above: float = 2.0) -> None:
    """Draw traces in plotly's terms, upwards from a z-order; each name is once in a legend."""
    for order, trace in enumerate(traces):
        if trace.get('visible') == 'legendonly' or set(trace['y']) <= {None}:
            continue
        known = axes.get_legend_handles_labels()[1]
        name = unescape(trace['name'])
        is_new = trace.get('showlegend', True) and name not in known
        kept: Look = {
            'label': plain_text(name) if is_new else None,
            'zorder': above + order / 1000.0,
        }
        if trace['type'] == 'bar':
            rows = [plain_text(unescape(each)) for each in trace['y']]
            bars = {'left': trace['base'], 'color': trace['marker']['color']}
            axes.barh(rows, trace['x'], trace['width'], **bars, **kept)
            continue
        points = np.array([trace['x'], trace['y']], dtype=float).T
        if 'lines' in trace['mode']:
            _draw_line(axes, trace, points, kept)
            kept['label'] = None
        if 'markers' in trace['mode']:
            color = trace.get('line', {}).get('color')
            _draw_markers(axes, {'color': color, **trace['marker']}, points, kept)
        if 'text' in trace['mode']:
            _draw_texts(axes, trace, points)


def _draw_line(axes: Axes, trace: Trace, points: Array, kept: Look) -> None:
    line = {'width': 0.0, 'color': 'none', 'dash': 'solid', 'shape': 'linear', **trace['line']}
    look = {'lw': _POINT * line['width'], 'ls': _DASHES[line['dash']], **kept}
    if 'fill' in trace:
        parts = np.split(points, np.flatnonzero(np.isnan(points[:, 0])))
        shape = Path.make_compound_path(*(Path(each[~np.isnan(each[:, 0])]) for each in parts))
        axes.add_patch(PathPatch(shape, fc=trace['fillcolor'], ec=line['color'], **look))
        return
    style = 'steps-post' if line['shape'] == 'hv' else 'default'
    axes.plot(*points.T, color=line['color'], drawstyle=style, **look)


def _draw_markers(axes: Axes, marker: Look, points: Array, kept: Look) -> None:
    symbol, color = marker.get('symbol', 'circle'), marker['color']
    edge = {'mfc': 'none' if symbol.endswith('open') else color, 'ms': _POINT * marker['size']}
    edge['mec'] = 'white' if symbol == 'triangle-up' else color
    shapes: list[tuple[Any, Array]] = [(_SYMBOLS.get(symbol.split('-')[0]), points)]
    if symbol == 'triangle-up':
        angles = zip(marker['angle'], points, strict=True)
        shapes = [((3, 0, -angle), point[None]) for angle, point in angles]
    for shape, some in shapes:
        axes.plot(*some.T, marker=shape, ls='', **edge, **kept)
        kept = {**kept, 'label': None}


def _draw_texts(axes: Axes, trace: Trace, points: Array) -> None:
    font = trace.get('textfont', {'color': TEXT, 'shadow': '#ffffff'})
    around = withStroke(linewidth=2.0, foreground=font['shadow'].split()[-1])
    beside = (6, 6) if trace.get('textposition') else (0, 0)
    center: Look = {} if trace.get('textposition') else {'ha': 'center', 'va': 'center'}
    for point, text in zip(points.tolist(), trace['text'], strict=True):
        axes.annotate(
            plain_text(unescape(text)), point, beside, textcoords='offset points', size='small',
            color=font['color'], zorder=6, path_effects=[around], **center,
        )  # fmt: skip


def plain_text(text: str) -> str:
    """Text with dollar signs escaped: they would begin a formula."""
    return text.replace('$', r'\$')


def along(poses: Array, twists: Array, durations: Array) -> Array:
    """Positions ``(K, 2)`` along arcs between poses ``(N + 1, 3)``, several on each."""
    parts = np.linspace(0.0, 1.0, PER_ARC, endpoint=False)
    begins = np.repeat(poses[:-1], PER_ARC, axis=0)
    since = (durations[:, None] * parts).ravel()
    points = arc_ends(begins, np.repeat(twists, PER_ARC, axis=0), since)
    return np.vstack([points[:, :2], poses[-1:, :2]])


def show(axes: Axes, points: Sequence[Array], room: float) -> None:
    """Show points and some room [m] around them, at one scale."""
    low, high = frame(points, (), room)
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), xlabel='x [m]', ylabel='y [m]')
    axes.set_aspect('equal')
