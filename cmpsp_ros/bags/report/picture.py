"""The report on one sheet, as a picture."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from cmpsp_ros.bags.errors import written
from cmpsp_ros.bags.report.charts import Figure as Chart
from cmpsp_ros.bags.report.charts import clearance, controls, levels, quantities, step_times, suffix
from cmpsp_ros.bags.report.path_chart import panels, path
from cmpsp_ros.bags.report.view import View
from cmpsp_ros.view import GRID, LIMIT, draw, seen, traces


def draw_report(views: Sequence[View], output: Path) -> Figure:
    """Draw paths, fallback levels, controls, clearance and step times; return the figure."""
    places, titles = panels(views), quantities(views)
    charts_ = [(levels(views), 0), *((controls(views), row) for row in range(len(titles)))]
    charts_ += [(clearance(views), 0), (step_times(views), 0)]
    height = 5.5 + 1.5 * max(len(titles) + 1, len(places))
    figure = Figure(figsize=(14.0, height), layout='constrained')
    halves = figure.add_gridspec(1, 2, width_ratios=[5, 6])
    grid = halves[0].subgridspec(len(places) + 1, 1, height_ratios=[6] * len(places) + [1])
    handles: dict[str, Any] = {}
    for number, members in enumerate(places):
        axes = figure.add_subplot(grid[number])
        chart, on = path(views), suffix(number)
        draw(axes, (each for each in chart['data'] if each['xaxis'] == f'x{on}'))
        x, y = (chart['layout'][f'{letter}axis{on}']['range'] for letter in 'xy')
        axes.set(xlim=x, ylim=y, xlabel='x [m]', ylabel='y [m]', aspect='equal')
        draw(axes, traces([seen([grid for _, grid in views[k].grids]) for k in members], ''))
        handles |= dict(zip(*axes.get_legend_handles_labels()[::-1], strict=True))
    keys = figure.add_subplot(grid[-1])
    keys.set_axis_off()
    keys.legend(handles.values(), handles.keys(), loc='center', ncols=2, fontsize='small')
    rows = halves[1].subgridspec(len(charts_), 1, height_ratios=[1] + [3] * (len(charts_) - 1))
    shown: Axes | None = None
    for row, (chart, number) in enumerate(charts_):
        axes = figure.add_subplot(rows[row], sharex=shown)
        _draw_chart(axes, chart, suffix(number))
        axes.tick_params(labelbottom=row == len(charts_) - 1)
        shown = axes
    if shown is not None:
        shown.set(xlabel='time [s]', xlim=(0.0, max(view.end for view in views)))
    with written(output):
        figure.savefig(output, dpi=110)
    return figure


def _draw_chart(axes: Axes, chart: Chart, on: str) -> None:
    draw(axes, (each for each in chart['data'] if each.get('yaxis', 'y') == f'y{on}'))
    style = chart['layout'][f'yaxis{on}']
    axes.set_ylabel(style.get('title', {}).get('text', ''))
    if style.get('type') == 'log':
        axes.set_yscale('log')
    for shape in chart['layout']['shapes']:
        if shape.get('xref') == 'paper' and shape['yref'] == f'y{on}':
            axes.axhline(shape['y0'], color=LIMIT, ls='--', lw=1.0)
    axes.grid(color=GRID)
    axes.set_axisbelow(True)
    above: dict[str, Any] = {'fontsize': 'small'}
    if style.get('autorange') == 'reversed':
        axes.invert_yaxis()
        above = {'ncols': len(chart['data']), 'loc': 'lower left', 'bbox_to_anchor': (0.0, 1.0)}
    if axes.get_legend_handles_labels()[1]:
        axes.legend(**above)
