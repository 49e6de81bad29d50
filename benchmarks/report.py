"""Results in a file or a folder: JSON, pictures, and a page that says how to make them again."""

from __future__ import annotations

import json
import os
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.errors import BenchError
from benchmarks.pictures import pictures
from benchmarks.results import Results
from benchmarks.tables import tables
from benchmarks.targets import targets
from cmpsp_ros.studies import plot_style

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
    """See beforehand whether results can be written there, for they take long to come by.

    Raises:
        BenchError: Something is there already, or nothing can be written.
    """
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
    """Write results to a file, or to a folder with pictures and the page `performance.md`.

    Raises:
        BenchError: It cannot be written.
    """
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
    """Results as JSON has them: what is in the tables, and all samples.

    Returns:
        - `command`: command line that was given.
        - `targets`: a list of `what`, `at_most`, `found` and `holds`; the last two are null where
          nothing was measured.
        - `tables`: a list of `title`, `columns` and `rows`, whose cells are text.
        - The fields of `Results`; what is one or more values of a kind there is a list here.
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
