"""The figures of a study: counts with confidence intervals, as tables and JSON, and all runs."""

import json
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from rich.markup import escape
from rich.table import Table
from scipy.stats import binomtest

from cmpsp_ros.studies.monte_carlo.contacts import ALL_HELD, CrowdOutcome
from cmpsp_ros.studies.monte_carlo.outcome import RunVerdict, StudyOutcome
from cmpsp_ros.studies.monte_carlo.study import Study

_LEVELS = ('nominal', 'elastic', 'previous_plan', 'stop')
_NEARLY = 0.03  # error of a delay that is told nearly right [s]
_SPREADS = {
    'miss [m], goal in reach': 'miss_in_reach_m',
    'clearance [m]': 'clearance_m',
    'time [s]': 'time_s',
    'mean speed, by the shortest path, of the nominal': 'pace',
}
_WITHIN = 0.05  # part of the least cost that a run may cost more
_QUANTILES = {'least': 0.0, '1 %': 0.01, 'median': 0.5, '99 %': 0.99, 'largest': 1.0}


def wilson_interval(count: int, total: int) -> tuple[float, float]:
    """Wilson's interval for 95 % of the share of so many runs; from 0 to 1 without any runs."""
    if not total:
        return 0.0, 1.0
    found = binomtest(count, total).proportion_ci(0.95, method='wilson')
    return float(found.low), float(found.high)


def shares(outcomes: Sequence[StudyOutcome]) -> dict[str, dict[str, Any]]:
    """All counts of runs by name, each `of` so many, with Wilson's interval for 95 %."""
    reachable = [each for each in outcomes if not each.out_of_reach]
    told = [each for each in outcomes if each.told_error is not None]
    nearly_right = [each for each in told if abs(each.told_error or 0.0) <= _NEARLY]
    obstructed = [each for each in outcomes if each.obstacle_clearance is not None]
    nearly = f'arrived within 5 cm, delay told within {1e3 * _NEARLY:.0f} ms'
    counted = [
        ('arrived within 1 mm, goal in reach', reachable, lambda each: each.miss <= 1e-3),
        ('arrived within 5 cm, goal in reach', reachable, lambda each: each.miss <= 0.05),
        *([(nearly, nearly_right, lambda each: each.miss <= 0.05)] if told else []),
        ('touched an obstacle, of runs with any', obstructed, lambda each: each.touched),
    ]
    runs: dict[str, Callable[[StudyOutcome], bool]] = {
        'left the road': lambda each: each.left_road,
        'exceptions': lambda each: bool(each.exception),
        'commands not finite': lambda each: each.not_finite > 0,
        'commands above the wheel limit': lambda each: each.too_fast > 0,
        'commands changed or steered too much': lambda each: each.over_limit > 0,
        'stopped on the way': lambda each: each.stop > 0,
        'nominal all the way': lambda each: not each.trouble,
        'elastic at some step': lambda each: each.elastic > 0,
        'previous plan at some step': lambda each: each.previous_plan > 0,
    }
    found = {}
    for name, group, holds in counted + [(name, outcomes, holds) for name, holds in runs.items()]:
        count, total = sum(map(holds, group)), len(group)
        found[name] = {'count': count, 'of': total, 'wilson_95': wilson_interval(count, total)}
    return found


def figures(
    study: Study,
    outcomes: Sequence[StudyOutcome],
    judged: Mapping[int, Mapping[str, Any]],
    compared: Mapping[int, Mapping[str, Any]],
) -> dict[str, Any]:
    """All figures of a study, ready for JSON."""
    verdicts = Counter(each.verdict(study.tolerance) for each in outcomes)
    reachable = [each for each in outcomes if not each.out_of_reach] or list(outcomes)
    tolerance = study.tolerance
    scored = study.kind.score_speed is not None
    scores = [each.score(tolerance) for each in outcomes if scored]
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
        'verdicts': {each.value: verdicts[each] for each in RunVerdict},
        'shares': shares(outcomes),
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
        **({'people': _crowd_figures(outcomes, tolerance)} if study.kind.has_people else {}),
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
        counts.add_row('mean score', f'{values["mean_score"]:.4f}', '0.5', '')
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
        rounded = (round(values[key][each], 6) for each in _QUANTILES)
        spreads.add_row(escape(name), *(f'{each:.4g}' for each in rounded))
    found = [counts, spreads, *(_crowd_tables(values['people']) if 'people' in values else [])]
    if not values['failures']:
        return found
    titles = ('run', 'verdict', 'miss [m]', 'clearance [m]', 'judge', 'first at the worst level')
    failures = Table(*map(escape, titles))
    for each in values['failures']:
        judge = each['judge']['answer'] if each['judge'] else ''
        time = '' if each['trouble_time_s'] is None else f'{each["trouble_time_s"]:.1f} s: '
        failures.add_row(
            str(each['run']), each['verdict'], f'{round(each["miss_m"], 6):.4g}',
            f'{each["clearance_m"]:+.4f}', judge,
            escape(each['exception'] or time + each['trouble']),
        )  # fmt: skip
    return [*found, failures]


def write_parquet(
    path: Path,
    outcomes: Sequence[StudyOutcome],
    tolerance: float,
    judged: Mapping[int, Mapping[str, Any]],
) -> None:
    """Write a row for each run [m, s, rad/s], where pyarrow is installed."""
    try:
        import pyarrow as pa  # type: ignore[import-untyped]  # noqa: PLC0415 (optional)
        from pyarrow import parquet  # noqa: PLC0415
    except ImportError:
        return
    rows = [
        {
            **asdict(each),
            'x': list(each.x),
            'y': list(each.y),
            'clearance': each.clearance,
            'verdict': each.verdict(tolerance).value,
            'judge': judged[each.number]['answer'] if each.number in judged else None,
            'crowd': None if each.crowd is None else json.dumps(asdict(each.crowd)),
        }
        for each in outcomes
    ]
    table = pa.Table.from_pylist(rows)
    # A column of nothing but None has no type of its own.
    for name in ('obstacle_clearance', 'trouble_time', 'told_error', 'judge', 'crowd'):
        kind = pa.string() if name in {'judge', 'crowd'} else pa.float64()
        place = table.column_names.index(name)
        table = table.set_column(place, name, table.column(name).cast(kind))
    parquet.write_table(table, path)


def _costs(compared: Mapping[int, Mapping[str, Any]]) -> dict[str, Any]:
    """Cost ratios of runs for which IPOPT found the minimum in their own homotopy class."""
    ratios = {
        number: each['cost'] / each['least']
        for number, each in compared.items()
        if each.get('same_class')
    }
    return {
        'compared': len(compared),
        'of_the_same_class': len(ratios),
        'at_most_5_percent_more': sum(each <= 1.0 + _WITHIN for each in ratios.values()),
        **({'ratio': _quantiles(list(ratios.values()))} if ratios else {}),
        'more': sorted(number for number, each in ratios.items() if each > 1.0 + _WITHIN),
    }


def _quantiles(numbers: Sequence[float]) -> dict[str, float]:
    at = np.quantile(numbers, list(_QUANTILES.values()))
    return dict(zip(_QUANTILES, at.tolist(), strict=True))


def _crowd_figures(outcomes: Sequence[StudyOutcome], tolerance: float) -> dict[str, Any]:
    """Figures of all runs, and of each scene and robot; arrival is within `tolerance` [m]."""
    runs = [(each, each.crowd) for each in outcomes if each.crowd is not None]
    groups: dict[str, list[tuple[StudyOutcome, CrowdOutcome]]] = {}
    for run in runs:
        _, crowd = run
        noise = ', noise' if crowd.is_noisy else ''
        for name in ('all', crowd.scene, f'{crowd.robot}{noise}'):
            groups.setdefault(name, []).append(run)
    reasons = Counter(met.reason for _, crowd in runs for met in crowd.active)
    return {
        'groups': {name: _group(group, tolerance) for name, group in groups.items()},
        'reasons': dict(reasons.most_common()),
    }


def _crowd_tables(values: Mapping[str, Any]) -> list[Table]:
    table = Table(
        'runs', 'number', 'active contact', 'all held', 'other contact', 'arrived',
        'arrived told', 'both', 'time by told', 'of nine in ten', 'time by empty',
        title='among people', title_justify='left',
    )  # fmt: skip
    for name, group in values['groups'].items():
        table.add_row(name, *('' if each is None else f'{each:.4g}' for each in group.values()))
    reasons = Table('reason of active contacts', 'contacts')
    for reason, count in values['reasons'].items():
        reasons.add_row(reason, str(count))
    return [table, reasons] if values['reasons'] else [table]


def _group(
    runs: Sequence[tuple[StudyOutcome, CrowdOutcome]], tolerance: float
) -> dict[str, float | None]:
    arrived = [each.verdict(tolerance) is RunVerdict.ARRIVED for each, _ in runs]
    told = [crowd.told_time is not None for _, crowd in runs]
    both = [(each, crowd) for (each, crowd), *good in zip(runs, arrived, told, strict=True)
            if all(good)]  # fmt: skip
    # Where comparison runs were skipped, their figures are unknown, not 0.
    is_compared = any(told) or any(crowd.empty_time is not None for _, crowd in runs)
    by_told = [each.time / crowd.told_time for each, crowd in both if crowd.told_time]
    by_empty = [each.time / crowd.empty_time for each, crowd in both if crowd.empty_time]
    return {
        'runs': len(runs),
        'active_contact': sum(bool(crowd.active) for _, crowd in runs),
        'all_held': sum(any(met.reason == ALL_HELD for met in crowd.active) for _, crowd in runs),
        'other_contact': sum(len(crowd.contacts) > len(crowd.active) for _, crowd in runs),
        'arrived': sum(arrived),
        'arrived_told': sum(told) if is_compared else None,
        'arrived_both': len(both) if is_compared else None,
        'time_by_told': float(np.median(by_told)) if by_told else None,
        'time_by_told_of_nine_in_ten': float(np.quantile(by_told, 0.9)) if by_told else None,
        'time_by_empty': float(np.median(by_empty)) if by_empty else None,
    }
