"""Results in a file or a folder: JSON, pictures, and a page that says how to make them again."""

from __future__ import annotations

import json
import os
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from benchmarks.errors import BenchError
from benchmarks.families.long_horizons import COLD, WARM
from benchmarks.families.presets import PresetTiming
from benchmarks.families.spread import Spread
from benchmarks.families.timing import Ratios, Timed
from benchmarks.pictures import pictures
from benchmarks.results import Results
from benchmarks.tables import tables
from benchmarks.targets import targets
from cmpsp_ros.studies.plot_style import journal

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

    Args:
        output: A file that ends in `.json`, or a folder.

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

    Args:
        results: The results.
        output: As in `check_output`.

    Raises:
        BenchError: It cannot be written.
    """
    text = json.dumps(content(results), indent=1, allow_nan=False, ensure_ascii=False) + '\n'
    try:
        if output.suffix == _SUFFIX:
            output.write_text(text, encoding='utf-8')
            return
        (output / f'bench{_SUFFIX}').write_text(text, encoding='utf-8')
        with journal():
            for name, figure in pictures(results).items():
                figure.savefig(output / f'{name}.png', dpi=_DPI, metadata={'Software': None})
        (output / 'performance.md').write_text(page(results), encoding='utf-8')
    except OSError as error:
        raise BenchError(f'{output}: {error.strerror or error}') from error


def content(results: Results) -> dict[str, Any]:
    """Results as JSON has them.

    Args:
        results: The results.

    Returns:
        - `command`: command line that was given.
        - `machine`: processor, cores, kernel, versions of Python and of packages, as text.
        - `targets`: a list of `what`, `at_most`, `found` and `holds`; the last two are null where
          nothing was measured.
        - `robots_ms`: by robot spreads `first` and `every`, `steps`, `work` of each step in visits
          of a stage, `levels` with the steps at each fallback level, and `terminal_error` [m].
        - `long_horizons_us`: `steps`, by horizon a list of `steps`, `active`, `qp_iterations`,
          `work`, `times` with `warm`, `cold` and other solvers, and `ratios` of warm steps to
          those, and to their quadratic programs; `exponent_warm` and `exponent_cold`, which may be
          null.
        - `presets_ms`: by preset or run of the paper `first` and `every`, each a spread.
        - `hard_ms`: by hard case `first` and `every`, each a spread, `longest`, and in how many
          steps its plan was `elastic`.
        - `methods`: `steps`, `runs`, and `timed` by method: spreads `first_us` and `loop_us`,
          `first_ratio` and `loop_ratio` to the first method, and `outcome` with `cost`, `miss`
          [m], `violation` [m] and `wheel_speed` [rad/s].
        - `tails_us`: by method a `spread` and the `ratio` of its 99.9th percentile to its median,
          and `spread_again` and `ratio_again` of one and the same step.
        - `plans_us`: by number of plans `first` and `second`, each a spread.
        - `horizons_us`: by method `steps`, `times` and the fitted `exponent`, which may be null.
        - `general`: by size a list of `states`, `controls`, `iterations`, `active`, `time` [us]
          and `flops`.
        - `not_compared`: reasons by method.
        - `latency_ms`: null, or `runs`, the samples `total` and `own`, their spreads and that of
          the rest and without first steps, `jitter`, `miss` [m], and `starts_s`, how long the node
          takes to be active [s].
        - `resident_mb`: this process, and the guidance node when active and at the end.

        A spread has `count`, `median`, `p99`, `p999` and `largest`; percentiles for which there
        are too few values are null.
    """
    comparison, latency, long = results.comparison, results.latency, results.long_horizons
    resident = {'benchmark': results.resident}
    if latency is not None:
        resident |= {
            'guidance_active': latency.resident_active,
            'guidance_end': latency.resident_end,
        }
    return {
        'command': results.order.command,
        'machine': results.machine,
        'targets': [{**asdict(each), 'holds': each.holds} for each in targets(results)],
        'robots_ms': {
            each.name: {
                'first': asdict(Spread.of(each.times[:, 0])),
                'every': asdict(Spread.of(each.times)),
                'steps': each.times.shape[1],
                'work': each.work.tolist(),
                'levels': each.levels,
                'terminal_error': each.terminal_error,
            }
            for each in results.robots
        },
        'long_horizons_us': {
            'steps': [asdict(each) for each in long.found],
            'exponent_warm': long.exponent(WARM),
            'exponent_cold': long.exponent(COLD),
        },
        'presets_ms': _of_runs(results.presets),
        'hard_ms': {
            each.name: {
                'first': asdict(Spread.of(each.times[:, 0])),
                'every': asdict(Spread.of(each.times)),
                'longest': each.longest,
                'elastic': each.elastic,
            }
            for each in results.hard
        },
        'methods': {
            'steps': comparison.steps,
            'runs': comparison.runs,
            'timed': {each.name: _timed(each, comparison.timed[0]) for each in comparison.timed},
        },
        'tails_us': {
            each.name: {
                'spread': asdict(each.spread),
                'ratio': each.ratio,
                'spread_again': asdict(each.spread_again),
                'ratio_again': each.ratio_again,
            }
            for each in results.tails
        },
        'plans_us': {
            str(each.count): {
                'first': asdict(Spread.of(each.first)),
                'second': asdict(Spread.of(each.second)),
            }
            for each in results.plans
        },
        'horizons_us': {
            each.name: {'steps': each.steps, 'times': each.times, 'exponent': each.exponent}
            for each in results.growth
        },
        'general': [asdict(each) for each in results.general],
        'not_compared': {**comparison.left_out, **results.missing, **long.missing},
        'latency_ms': None
        if latency is None
        else {
            'runs': latency.runs,
            'miss': latency.miss,
            'starts_s': latency.starts.tolist(),
            'total': latency.total.tolist(),
            'own': latency.own.tolist(),
            'spread_total': asdict(Spread.of(latency.total)),
            'spread_own': asdict(Spread.of(latency.own)),
            'spread_rest': asdict(latency.rest),
            'spread_under_way': asdict(latency.under_way),
            'jitter': latency.jitter.tolist(),
        },
        'resident_mb': resident,
    }


def _of_runs(timings: Sequence[PresetTiming]) -> dict[str, Any]:
    return {
        each.name: {'first': asdict(each.first), 'every': asdict(each.every)} for each in timings
    }


def _timed(timed: Timed, baseline: Timed) -> dict[str, Any]:
    ratios = Ratios.of(timed.times, baseline.times)
    return {
        'first_us': asdict(timed.first),
        'loop_us': asdict(timed.loop),
        'first_ratio': ratios.first,
        'loop_ratio': ratios.loop,
        'outcome': asdict(timed.outcome),
    }


def page(results: Results) -> str:
    """Results as a page in Markdown, beside their pictures."""
    machine = '\n'.join(f'- {name}: {value}' for name, value in results.machine.items())
    parts = [_INTRODUCTION.format(command=results.order.command), f'## Machine\n\n{machine}']
    parts += [table.markdown() for table in tables(results)]
    drawn = [name for name in _CAPTIONS if name != 'latency' or results.latency is not None]
    parts += ['## Pictures', *(f'{_CAPTIONS[name]}\n\n![{name}]({name}.png)' for name in drawn)]
    return '\n\n'.join(part.strip('\n') for part in parts) + '\n'
