"""The page: one HTML file that needs no other files and no network.

Only the two scripts whose hashes are in its Content-Security-Policy can run. Data from a bag are
text in the page and data in its JSON.
"""

import base64
import gzip
import hashlib
import json
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from html import escape
from importlib.resources import files
from string import Template
from typing import Any

import numpy as np

from cmpsp_ros.bags.audit import CheckOutcome, overall
from cmpsp_ros.bags.errors import BagError
from cmpsp_ros.bags.report import charts
from cmpsp_ros.bags.report.path_chart import moving, panels, path
from cmpsp_ros.bags.report.view import View
from cmpsp_ros.parameters import TABLE, describe
from cmpsp_ros.view import LEVEL_COLORS, bag_color

_MOST_BANDS = 200

_HEADLINES = {
    CheckOutcome.PASSED: 'Audit clean',
    CheckOutcome.FAILED: 'Audit found something',
    CheckOutcome.NOT_JUDGED: 'Audit not complete: data are missing',
}


def summary(views: Sequence[View]) -> str:
    """Figures of each bag, one column each."""
    columns = [_figures(view) for view in views]
    names = dict.fromkeys(name for column in columns for name in column)
    rows = [[escape(name), *(escape(column.get(name, '')) for column in columns)] for name in names]
    return _table(['', *(_swatched(views, view) for view in views)], rows)


def findings(view: View) -> str:
    """Table of the audit's findings."""
    rows = [
        [
            f'<span class="{each.outcome.name.lower()}">{each.outcome.value}</span>',
            escape(each.title),
            escape(each.worst_text),
            escape(each.limit_text),
            '' if each.at is None else f'{each.at:.2f} s',
            escape(each.sentence),
        ]
        for each in view.findings
    ]
    return _table(['', 'check', 'worst', 'limit', 'at', 'what was found'], rows, stacked=True)


def levels(view: View) -> str:
    """The bands of the fallback levels with their sentences."""
    rows = [
        [
            f'{_swatch(LEVEL_COLORS.get(each.level, "#fff"))}{escape(each.level)}',
            f'{each.begin:.2f} to {each.end:.2f} s',
            str(each.steps),
            escape(each.reason),
        ]
        for each in view.bands[:_MOST_BANDS]
    ]
    if len(view.bands) > _MOST_BANDS:
        rows.append(['', '', '', f'and {len(view.bands) - _MOST_BANDS} more'])
    return _table(['level', 'time', 'steps', 'reason'], rows, stacked=True)


def parameters(views: Sequence[View]) -> str:
    """Parameters by key, those that differ between bags marked."""
    columns = [view.record.history.epochs[0].values for view in views]
    keys = dict.fromkeys(key for column in columns for key in column)
    rows, marks = [], []
    for key in keys:
        parameter = TABLE.find(key)
        values = [describe(column[key]) if key in column else '' for column in columns]
        unit = '' if parameter is None else parameter.unit
        rows.append([escape(key), *(escape(each) for each in values), escape(unit)])
        marks.append(len(set(values)) > 1)
    head = ['parameter', *(_swatched(views, view) for view in views), 'unit']
    return _table(head, rows, marks)


def sections(views: Sequence[View], build: Callable[[View], str]) -> str:
    """One table per bag, under its name if there are several."""
    if len(views) == 1:
        return build(views[0])
    return ''.join(f'<h3>{_swatched(views, view)}</h3>{build(view)}' for view in views)


def verdicts(views: Sequence[View]) -> str:
    """A word on each audit."""
    words = []
    for view in views:
        outcome, counts = overall(view.findings), Counter(each.outcome for each in view.findings)
        numbers = ', '.join(f'{counts[each]} {each.value}' for each in CheckOutcome if counts[each])
        words.append(
            f'<li class="{outcome.name.lower()}">{_swatched(views, view)}'
            f'<strong>{_HEADLINES[outcome]}</strong><span>checks: {numbers}</span></li>'
        )
    return ''.join(words)


def _figures(view: View) -> dict[str, str]:
    taken = view.steps[1]
    by_check = {each.check: each for each in view.findings}
    counts = Counter[str]()
    for band in view.bands:
        counts[band.level] += band.steps
    known = [float(each.min()) for each in view.clearance[1].values()]
    missed = len(view.missed_deadlines[0])
    peaks = ((each, np.abs(each.values).max(initial=0.0)) for each in view.commands[1])
    largest = {each.name: f'{peak:.4g} {each.unit}' for each, peak in peaks}
    quantiles = np.percentile(taken, [50, 99, 100]).tolist() if len(taken) else []
    return {
        'miss at the final time': by_check['goal'].worst_text or 'unknown',
        'least clearance': f'{min(known):.4g} m' if known else 'unknown',
        **{f'largest {name}': text.rstrip() for name, text in largest.items()},
        'step time p50 / p99 / max': ' / '.join(f'{each:.2f}' for each in quantiles) + ' ms'
        if len(taken)
        else 'unknown',
        'deadlines missed': f'{missed} of {len(taken)}' if len(taken) else 'unknown',
        'fallback levels': ', '.join(f'{count} {level}' for level, count in counts.items())
        or 'unknown',
        'recorded': f'{view.end:.1f} s, {len(view.record.odometry.stamps)} odometry messages',
        'recorded by': f'cmpsp_ros {view.version}' if view.version else 'another program',
    }


def _swatched(views: Sequence[View], view: View) -> str:
    return f'{_swatch(bag_color(views.index(view)))}{escape(view.label)} '


def _swatch(color: str) -> str:
    return f'<span class="swatch" style="background:{color}"></span>'


def _table(
    head: Sequence[str],
    rows: Iterable[Sequence[str]],
    marks: Sequence[bool] | None = None,
    *,
    stacked: bool = False,
) -> str:
    """A table; a stacked one becomes a paragraph per row on a narrow page."""
    cells = ''.join(f'<th scope="col">{each}</th>' for each in head)
    lines = [f'<tr>{cells}</tr>']
    for number, row in enumerate(rows):
        mark = ' class="differs"' if marks and marks[number] else ''
        lines.append(f'<tr{mark}>{"".join(f"<td>{each}</td>" for each in row)}</tr>')
    kind = 'table stacked' if stacked else 'table'
    return f'<div class="{kind}"><table>{"".join(lines)}</table></div>'


def page(views: Sequence[View]) -> str:
    """The report of one or several bags as HTML."""
    script, library = _asset('page.js'), _plotly()
    return Template(_asset('page.html')).substitute(
        policy=_policy(script, library),
        title=escape(', '.join(view.label for view in views)),
        style=_asset('page.css'),
        verdicts=verdicts(views),
        summary=summary(views),
        levels=sections(views, levels),
        audit=sections(views, findings),
        parameters=parameters(views),
        end=f'{max(view.end for view in views):.3f}',
        data=_json(_data(views)),
        # As a browser unpacks it: a third of the size.
        library=base64.b64encode(gzip.compress(library.encode(), 6, mtime=0)).decode(),
        script=script,
    )


def _data(views: Sequence[View]) -> dict[str, Any]:
    figures = {
        'path': path(views),
        'levels': charts.levels(views),
        'controls': charts.controls(views),
        'clearance': charts.clearance(views),
        'position': charts.position(views),
        'steps': charts.step_times(views),
        'histogram': charts.step_histogram(views),
    }
    axes = {k: charts.suffix(panel) for panel, members in enumerate(panels(views)) for k in members}
    return {
        'figures': figures,
        'bags': [
            {'label': view.label, 'axes': axes[number], **each}
            for number, (view, each) in enumerate(zip(views, moving(views), strict=True))
        ],
    }


def _policy(*scripts: str) -> str:
    allowed = ' '.join(
        f"'sha256-{base64.b64encode(hashlib.sha256(each.encode()).digest()).decode()}'"
        for each in scripts
    )
    return (
        f"default-src 'none'; script-src {allowed}; style-src 'unsafe-inline';"
        " img-src data: blob:; base-uri 'none'; form-action 'none'"
    )


def _json(value: Any) -> str:
    """JSON that ends no element of HTML."""
    text = json.dumps(value, allow_nan=False, separators=(',', ':'), ensure_ascii=True)
    return text.translate({ord(each): f'\\u{ord(each):04x}' for each in '<>&'})


def _plotly() -> str:
    try:
        script = files('plotly') / 'package_data' / 'plotly.min.js'
        return script.read_text(encoding='utf-8')
    except (ModuleNotFoundError, OSError) as error:
        raise BagError(
            'report: found no plotly, wanted it for its charts: pip install "cmpsp_ros[report]"'
        ) from error


def _asset(name: str) -> str:
    return (files('cmpsp_ros.bags.report') / 'assets' / name).read_text(encoding='utf-8')
