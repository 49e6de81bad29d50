"""The page: one HTML file that needs no other files and no network.

Only the two scripts whose hashes are in its Content-Security-Policy can run. Data from a bag are
text in the page and data in its JSON.
"""

from __future__ import annotations

import base64
import gzip
import hashlib
import json
from collections.abc import Sequence
from html import escape
from importlib.resources import files
from string import Template
from typing import Any

from cmpsp_ros.bags.errors import BagError
from cmpsp_ros.bags.report import charts, tables
from cmpsp_ros.bags.report.path_chart import panels, path
from cmpsp_ros.bags.report.slider import moving
from cmpsp_ros.bags.report.view import View


def page(views: Sequence[View]) -> str:
    """The report of one or several bags as HTML.

    Raises:
        BagError: plotly, whose script goes into the page, is not installed.
    """
    script, library = _asset('page.js'), _plotly()
    return Template(_asset('page.html')).substitute(
        policy=_policy(script, library),
        title=escape(', '.join(view.label for view in views)),
        style=_asset('page.css'),
        verdicts=tables.verdicts(views),
        summary=tables.summary(views),
        levels=tables.sections(views, 'levels'),
        audit=tables.sections(views, 'findings'),
        parameters=tables.parameters(views),
        end=f'{max(view.end for view in views):.3f}',
        data=_json(_data(views)),
        library=_packed(library),
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
    """A policy under which these scripts run, and nothing else."""
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
    for character in '<>&':
        text = text.replace(character, f'\\u{ord(character):04x}')
    return text


def _packed(text: str) -> str:
    """Text as a browser unpacks it: a third of the size."""
    return base64.b64encode(gzip.compress(text.encode(), 6, mtime=0)).decode()


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
