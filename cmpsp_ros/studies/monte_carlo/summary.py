"""The figures of a study: counts with confidence intervals, as tables and JSON, and all runs."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from rich.markup import escape
from rich.table import Table
from scipy.stats import binomtest

from cmpsp_ros.studies.monte_carlo.judging.costs import WITHIN
from cmpsp_ros.studies.monte_carlo.outcome import Outcome, Verdict
from cmpsp_ros.studies.monte_carlo.study import Study

_LEVELS = ('nominal', 'elastic', 'previous_plan', 'stop')
_NEARLY = 0.03
"""Error of a delay that is told nearly right [s]."""
_SPREADS = {
    'miss [m], goal in reach': 'miss_in_reach_m',
    'clearance [m]': 'clearance_m',
    'time [s]': 'time_s',
    'mean speed, by the shortest path, of the nominal': 'pace',
}
_QUANTILES = {'least': 0.0, '1 %': 0.01, 'median': 0.5, '99 %': 0.99, 'largest': 1.0}


@dataclass(frozen=True)
class Share:
    """A count and its total.

    Attributes:
        name: What was counted.
        count: Number of runs counted.
        total: Number of runs that could be.
    """

    name: str
    count: int
    total: int

    @property
    def interval(self) -> tuple[float, float]:
        """Wilson's, for 95 %; without any runs it may be anything."""
        if not self.total:
            return 0.0, 1.0
        found = binomtest(self.count, self.total).proportion_ci(0.95, method='wilson')
        return float(found.low), float(found.high)


def shares(outcomes: Sequence[Outcome]) -> list[Share]:
    """What is counted of runs."""
    total = len(outcomes)
    reachable = [each for each in outcomes if not each.out_of_reach]

    def runs(name: str, *holds: bool) -> Share:
        return Share(name, sum(holds), total)

    def in_reach(name: str, largest: float) -> Share:
        return Share(name, sum(each.miss <= largest for each in reachable), len(reachable))

    told = [each for each in outcomes if each.told_error is not None]
    nearly_right = [each for each in told if abs(each.told_error or 0.0) <= _NEARLY]
    touched = [each.touched for each in outcomes if each.obstacle_clearance is not None]
    return [
        in_reach('arrived within 1 mm, goal in reach', 1e-3),
        in_reach('arrived within 5 cm, goal in reach', 0.05),
        *(
            [
                Share(
                    f'arrived within 5 cm, delay told within {1e3 * _NEARLY:.0f} ms',
                    sum(each.miss <= 0.05 for each in nearly_right),
                    len(nearly_right),
                )
            ]
            if told
            else []
        ),
        Share('touched an obstacle, of runs with any', sum(touched), len(touched)),
        runs('left the road', *(each.left_road for each in outcomes)),
        runs('exceptions', *(bool(each.exception) for each in outcomes)),
        runs('commands not finite', *(each.not_finite > 0 for each in outcomes)),
        runs('commands above the wheel limit', *(each.too_fast > 0 for each in outcomes)),
        runs('commands changed or steered too much', *(each.over_limit > 0 for each in outcomes)),
        runs('stopped on the way', *(each.stop > 0 for each in outcomes)),
        runs('nominal all the way', *(not each.trouble for each in outcomes)),
        runs('elastic at some step', *(each.elastic > 0 for each in outcomes)),
        runs('previous plan at some step', *(each.previous_plan > 0 for each in outcomes)),
    ]


def figures(
    study: Study,
    outcomes: Sequence[Outcome],
    judged: Mapping[int, Mapping[str, Any]],
    compared: Mapping[int, Mapping[str, Any]],
) -> dict[str, Any]:
    """All figures of a study, ready for JSON."""
    verdicts = Counter(each.verdict(study.tolerance) for each in outcomes)
    reachable = [each for each in outcomes if not each.out_of_reach] or list(outcomes)
    speed, tolerance = study.kind.score_speed, study.tolerance
    scores = [] if speed is None else [each.score(tolerance, speed) for each in outcomes]
    paces = [each.pace for each in outcomes if each.pace is not None]
    free = study.kind.sees or study.kind.has_map
    return {
        'study': study.name,
        'seed': study.seed,
        'obstacles': study.most_obstacles,
        'robot': study.robot,
        'assignments': list(study.assignments),
        'runs': len(outcomes),
        'tolerance_m': study.tolerance,
        'verdicts': {each.value: verdicts[each] for each in Verdict},
        'shares': {
            each.name: {'count': each.count, 'of': each.total, 'wilson_95': each.interval}
            for each in shares(outcomes)
        },
        # Without an interval: the steps of a run hang together.
        'control_steps': {
            level: sum(getattr(each, level) for each in outcomes) for level in _LEVELS
        },
        'miss_in_reach_m': _quantiles([each.miss for each in reachable]),
        'clearance_m': _quantiles([each.clearance for each in outcomes]),
        **({'time_s': _quantiles([each.time for each in outcomes])} if free else {}),
        **({'pace': _quantiles(paces), 'mean_pace': float(np.mean(paces))} if paces else {}),
        **({'mean_score': float(np.mean(scores))} if scores else {}),
        **({'costs': _costs(compared)} if compared else {}),
        'max_wheel_speed_rad_s': max(each.max_wheel_speed for each in outcomes),
        'failures': [
            {
                'run': each.number,
                'verdict': each.verdict(study.tolerance).value,
                'miss_m': each.miss,
                'clearance_m': each.clearance,
                'trouble': each.trouble,
                'trouble_time_s': each.trouble_time,
                'exception': each.exception,
                'judge': judged.get(each.number),
                'command': study.command(each.number),
            }
            for each in outcomes
            if each.failed(study.tolerance)
        ],
    }


def to_json(values: Mapping[str, Any]) -> str:
    """The figures as text; floats read back bit for bit."""
    return json.dumps(values, indent=2) + '\n'


def tables(values: Mapping[str, Any]) -> list[Table]:
    """The figures to look at: counts, and each run that failed."""
    title = f'{values["study"]}: {values["runs"]} runs of seed {values["seed"]}'
    counts = Table('', 'count', 'of', '95 % interval', title=title, title_justify='left')
    for name, share in values['shares'].items():
        low, high = (f'{100.0 * each:.2f}' for each in share['wilson_95'])
        counts.add_row(name, str(share['count']), str(share['of']), f'{low} to {high} %')
    counts.add_section()
    steps = sum(values['control_steps'].values())
    for level, count in values['control_steps'].items():
        counts.add_row(f'control steps {level.replace("_", " ")}', str(count), str(steps), '')
    if 'mean_score' in values:
        counts.add_row('mean score', f'{values["mean_score"]:.4f}', '0.25', '')
    if 'costs' in values:
        costs = values['costs']
        count, total = costs['at_most_5_percent_more'], costs['of_the_same_class']
        counts.add_row('cost at most 5 % above the least', str(count), str(total), '')
    if 'mean_pace' in values:
        counts.add_row('mean speed', f'{values["mean_pace"]:.4f}', '1', '')
    counts.add_section()
    for name, count in values['verdicts'].items():
        counts.add_row(name, str(count), str(values['runs']), '')
    spreads = Table('', *_QUANTILES)
    for name, key in _SPREADS.items():
        if key not in values:
            continue
        spreads.add_row(escape(name), *(f'{values[key][each]:.4g}' for each in _QUANTILES))
    if not values['failures']:
        return [counts, spreads]
    titles = ('run', 'verdict', 'miss [m]', 'clearance [m]', 'judge', 'first at the worst level')
    failures = Table(*map(escape, titles))
    for each in values['failures']:
        judge = each['judge']['answer'] if each['judge'] else ''
        time = '' if each['trouble_time_s'] is None else f'{each["trouble_time_s"]:.1f} s: '
        failures.add_row(
            str(each['run']), each['verdict'], f'{each["miss_m"]:.4g}',
            f'{each["clearance_m"]:+.4f}', judge,
            escape(each['exception'] or time + each['trouble']),
        )  # fmt: skip
    return [counts, spreads, failures]


def write_parquet(
    path: Path,
    outcomes: Sequence[Outcome],
    tolerance: float,
    judged: Mapping[int, Mapping[str, Any]],
) -> bool:
    """Write a row for each run, lengths in [m], times in [s], wheel speeds in [rad/s].

    Args:
        path: The file; what is there is replaced.
        outcomes: By number.
        tolerance: Miss up to which a run has arrived [m].
        judged: What the judge found of runs, by number.

    Returns:
        Whether it was written: not without pyarrow.
    """
    try:
        import pyarrow as pa  # type: ignore[import-untyped]  # noqa: PLC0415 (optional)
        from pyarrow import parquet  # noqa: PLC0415
    except ImportError:
        return False
    rows = [
        {
            **asdict(each),
            'x': list(each.x),
            'y': list(each.y),
            'clearance': each.clearance,
            'verdict': each.verdict(tolerance).value,
            'judge': judged[each.number]['answer'] if each.number in judged else None,
        }
        for each in outcomes
    ]
    types = {'obstacle_clearance': pa.float64(), 'trouble_time': pa.float64(), 'judge': pa.string()}
    types['told_error'] = pa.float64()
    table = pa.Table.from_pylist(rows)
    # A column of nothing but None has no type of its own.
    for name, kind in types.items():
        place = table.column_names.index(name)
        table = table.set_column(place, name, table.column(name).cast(kind))
    parquet.write_table(table, path)
    return True


def _costs(compared: Mapping[int, Mapping[str, Any]]) -> dict[str, Any]:
    """Of runs of which IPOPT found the least cost in their own homotopy class."""
    ratios = {
        number: each['cost'] / each['least']
        for number, each in compared.items()
        if each.get('same_class')
    }
    return {
        'compared': len(compared),
        'of_the_same_class': len(ratios),
        'at_most_5_percent_more': sum(each <= 1.0 + WITHIN for each in ratios.values()),
        **({'ratio': _quantiles(list(ratios.values()))} if ratios else {}),
        'more': sorted(number for number, each in ratios.items() if each > 1.0 + WITHIN),
    }


def _quantiles(numbers: Sequence[float]) -> dict[str, float]:
    at = np.quantile(numbers, list(_QUANTILES.values()))
    return dict(zip(_QUANTILES, at.tolist(), strict=True))
