"""Figures of a study among people: contacts with their reasons, and times beside other runs."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from rich.table import Table

from cmpsp_ros.studies.monte_carlo.contacts import ALL_HELD, CrowdOutcome
from cmpsp_ros.studies.monte_carlo.outcome import RunVerdict, StudyOutcome


def crowd_figures(outcomes: Sequence[StudyOutcome], tolerance: float) -> dict[str, Any]:
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


def crowd_tables(values: Mapping[str, Any]) -> list[Table]:
    """The figures to look at."""
    table = Table(
        'runs', 'number', 'active contact', 'all held', 'other contact', 'arrived',
        'arrived told', 'both', 'time by told', 'time by empty', title='among people',
        title_justify='left',
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
    """Counts of runs, and medians of their times by those of others."""
    arrived = [each.verdict(tolerance) is RunVerdict.ARRIVED for each, _ in runs]
    told = [crowd.told_time is not None for _, crowd in runs]
    both = [(each, crowd) for (each, crowd), *good in zip(runs, arrived, told, strict=True)
            if all(good)]  # fmt: skip
    by_told = [each.time / crowd.told_time for each, crowd in both if crowd.told_time]
    by_empty = [each.time / crowd.empty_time for each, crowd in both if crowd.empty_time]
    return {
        'runs': len(runs),
        'active_contact': sum(bool(crowd.active) for _, crowd in runs),
        'all_held': sum(any(met.reason == ALL_HELD for met in crowd.active) for _, crowd in runs),
        'other_contact': sum(len(crowd.contacts) > len(crowd.active) for _, crowd in runs),
        'arrived': sum(arrived),
        'arrived_told': sum(told),
        'arrived_both': len(both),
        'time_by_told': float(np.median(by_told)) if by_told else None,
        'time_by_empty': float(np.median(by_empty)) if by_empty else None,
    }
