"""Results in a file or a folder: JSON, pictures, and a page that says how to make them again."""

from __future__ import annotations

import json
import os
from dataclasses import asdict
from itertools import cycle
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.figure import Figure

from benchmarks.common import BenchError
from benchmarks.results import Results, targets
from benchmarks.tables import tables
from cmpsp_ros.studies import WIDTH, plot_style

if TYPE_CHECKING:
    from benchmarks.over_dds.latency import Latency

_BINS = 60
_HEIGHT = 3.6
_COLORS = (
    '#1a1a1a', '#0072b2', '#d55e00', '#009e73', '#cc79a7', '#e69f00', '#56b4e9', '#8c564b',
    '#9467bd', '#7f7f7f', '#bcbd22', '#e377c2',
)  # fmt: skip
_MARKERS = 'osD^vP*X<>ph'


def pictures(results: Results) -> dict[str, Figure]:
    """All pictures, by name."""
    drawn = {'horizons': _horizons(results), 'steps': _steps(results), 'tails': _tails(results)}
    if results.latency is not None:
        drawn['latency'] = _latency(results.latency)
    return drawn


def _horizons(results: Results) -> Figure:
    figure = Figure(figsize=(WIDTH, _HEIGHT + 0.6), layout='constrained')
    axes = figure.add_subplot()
    for each, color, marker in zip(results.growth, cycle(_COLORS), cycle(_MARKERS), strict=False):
        exponent = '' if each.exponent is None else f'  ($N^{{{each.exponent:.2f}}}$)'
        axes.loglog(each.steps, each.times, marker=marker, ms=4, color=color,
                    label=f'{each.name}{exponent}')  # fmt: skip
    axes.set(xlabel='steps $N$ of the horizon', ylabel='first step [µs]')
    axes.set_xticks(results.order.horizons, [str(each) for each in results.order.horizons])
    axes.minorticks_off()
    axes.grid()
    axes.legend(loc='upper left', bbox_to_anchor=(1.01, 1.0))  # beside the axes
    return figure


def _steps(results: Results) -> Figure:
    """One row a method, for histograms on top of one another hide one another."""
    timed = results.comparison.timed
    figure = Figure(figsize=(WIDTH, 0.6 + 0.55 * len(timed)), layout='constrained')
    every = np.concatenate([each.times.ravel() for each in timed])
    bins = np.geomspace(every.min() / 1.05, every.max() * 1.05, _BINS + 1)
    rows = figure.subplots(len(timed), 1, sharex=True, squeeze=False)[:, 0]
    for axes, each, color in zip(rows, timed, cycle(_COLORS), strict=False):
        axes.hist(each.times.ravel(), bins=bins, color=color, alpha=0.8)
        axes.axvline(float(np.median(each.times)), color='0.35', lw=0.8)
        axes.set_ylabel(each.name, rotation=0, ha='right', va='center')
        axes.set_yticks([])
        axes.set_xscale('log')
    rows[-1].set_xlabel('step of the closed loop [µs]; the line is the median')
    return figure


def _tails(results: Results) -> Figure:
    figure = Figure(figsize=(WIDTH, _HEIGHT), layout='constrained')
    axes = figure.add_subplot()
    # The baseline, which has no tail, keeps the first colour.
    for each, color in zip(results.tails, cycle(_COLORS[1:]), strict=False):
        longest_first = np.sort(each.times)[::-1]
        share = np.arange(1, len(longest_first) + 1) / len(longest_first)
        axes.loglog(longest_first, share, color=color, drawstyle='steps-pre', label=each.name)
        axes.axvline(float(np.median(each.times)), color=color, lw=0.8, ls=':')
    axes.set(xlabel='step of the closed loop [µs]; the dotted line is the median',
             ylabel='fraction of steps that take at least as long')  # fmt: skip
    axes.grid()
    if results.tails:
        axes.legend()
    return figure


def _latency(found: Latency) -> Figure:
    figure = Figure(figsize=(WIDTH, _HEIGHT), layout='constrained')
    times, jitter = figure.subplots(1, 2)
    for sample, name, color in (
        (found.total, 'odometry to command', _COLORS[1]),
        (found.own, 'of it in the node', _COLORS[2]),
    ):
        bins = np.linspace(0.0, float(found.total.max()) * 1.02, _BINS + 1)
        times.hist(sample, bins=bins, alpha=0.7, color=color, label=name)
    times.set(xlabel='latency [ms]', ylabel='control steps')
    times.legend()
    jitter.hist(found.jitter, bins=_BINS, color=_COLORS[3], alpha=0.8)
    jitter.set(xlabel='jitter: change from one control step to the next [ms]')
    return figure


_DPI = 160
_SUFFIX = '.json'
_CAPTIONS = {
    'horizons': 'First step of Case 3 over the number of steps.',
    'steps': 'Steps of the closed loop, method by method.',
    'tails': 'How many steps of the closed loop take longer than some time.',
    'latency': 'From odometry to command through the node, and how much that varies.',
}
_INTRODUCTION = """\
# Performance

How long a control step takes, on long horizons first; what other solvers take for the same problem,
how that grows with the horizon and with the size of the system, how long the longest steps are, and
what becomes of it between two processes. This page is written by one command:

```sh
{command}
```

Absolute times differ from machine to machine and from day to day; ratios are steadier.
"""


def check_output(output: Path) -> None:
    """Check that results can be written there, before the long measurements."""
    try:
        if output.suffix == _SUFFIX:
            if output.exists():
                raise BenchError(f'{output}: found an existing file, wanted a new one')
            folder = output.parent
            folder.mkdir(parents=True, exist_ok=True)
        else:
            if output.exists() and (not output.is_dir() or any(output.iterdir())):
                raise BenchError(f'{output}: found something there, wanted a new or empty folder')
            folder = output
            folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise BenchError(f'{output}: {error.strerror or error}') from error
    if not os.access(folder, os.W_OK | os.X_OK):
        raise BenchError(f'{folder}: found a folder that cannot be written to, wanted another one')


def write(results: Results, output: Path) -> None:
    """Write results to a file, or to a folder with pictures and the page `performance.md`."""
    text = json.dumps(content(results), default=_plain, allow_nan=False, ensure_ascii=False) + '\n'
    try:
        if output.suffix == _SUFFIX:
            output.write_text(text, encoding='utf-8')
            return
        (output / f'bench{_SUFFIX}').write_text(text, encoding='utf-8')
        with plot_style():
            for name, figure in pictures(results).items():
                figure.savefig(output / f'{name}.png', dpi=_DPI, metadata={'Software': None})
        (output / 'performance.md').write_text(page(results), encoding='utf-8')
    except OSError as error:
        raise BenchError(f'{output}: {error.strerror or error}') from error


def content(results: Results) -> dict[str, Any]:
    """Results as JSON: the content of the tables, and all samples.

    Returns:
        - `command`: command line that was given.
        - `targets`: a list of `what`, `at_most`, `found` and `holds`; the last two are null if
          nothing was measured.
        - `tables`: a list of `title`, `columns` and `rows`, whose cells are text.
        - The fields of `Results`; sequences are lists.
    """
    shown = [
        {'title': each.title, 'columns': each.columns, 'rows': each.rows}
        for each in tables(results)
    ]
    return {
        'command': results.order.command,
        'targets': [{**asdict(each), 'holds': each.holds} for each in targets(results)],
        'tables': shown,
        **asdict(results),
    }


def _plain(value: object) -> object:
    """Arrays as lists, paths as text."""
    return value.tolist() if isinstance(value, np.ndarray) else str(value)


def page(results: Results) -> str:
    """Results as a page in Markdown, beside their pictures."""
    machine = '\n'.join(f'- {name}: {value}' for name, value in results.machine.items())
    parts = [_INTRODUCTION.format(command=results.order.command), f'## Machine\n\n{machine}']
    parts += [table.markdown() for table in tables(results)]
    drawn = [name for name in _CAPTIONS if name != 'latency' or results.latency is not None]
    parts += ['## Pictures', *(f'{_CAPTIONS[name]}\n\n![{name}]({name}.png)' for name in drawn)]
    return '\n\n'.join(part.strip('\n') for part in parts) + '\n'
