"""Measures of several runs, compared in tables and numbers."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import combinations
from typing import Any

import numpy as np

from cmpsp_ros.arrays import Array, BoolArray
from cmpsp_ros.studies.paper.claims import Table
from cmpsp_ros.studies.paper.drives import Drive, Path

ARRIVED = 1e-6
"""Distance from the goal up to which a run counts as having met it [m]."""

TOUCHED = -1e-6
"""Clearance down to which an active constraint counts as met [m]: rounding of a linearisation."""

_COLUMNS = (
    'run',
    'held clear',
    'miss [m]',
    'clearance at samples [mm]',
    'between samples [mm]',
    'largest right / left [rad/s]',
    'cost (95)',
    'steps with slack',
)


def runs_table(heading: str, *panels: Sequence[Drive]) -> Table:
    """The figures of runs, one row each."""
    rows = [_row(drive) for drives in panels for drive in drives]
    return Table(heading, _COLUMNS, rows)


def numbers(panels: Sequence[Sequence[Drive]], series: Sequence[str]) -> dict[str, Any]:
    """Runs as numbers for `results.json`, by panel and by name.

    Args:
        panels: Samples only first, then clear between samples too.
        series: Which of the series of a run a picture shows.
    """
    return {
        name: {
            drive.experiment.key: {
                **{each: drive.series()[each] for each in series},
                'measures': drive.measures(),
            }
            for drive in drives
        }
        for name, drives in zip(('samples_only', 'between_samples'), panels, strict=True)
    }


def worst_miss(drives: Iterable[Drive]) -> float:
    """Largest miss [m]."""
    return max(drive.path.miss for drive in drives)


def least_clearance(drives: Iterable[Drive], *, between_samples: bool) -> float:
    """Least clearance from road edges and obstacles [m]."""
    return min(
        float(drive.path.clearance(between_samples=between_samples).min()) for drive in drives
    )


def within_limits(drives: Iterable[Drive]) -> bool:
    """Whether no wheel is ever faster than its limit."""
    return all(
        np.abs(drive.path.controls).max() <= drive.path.settings.robot.max_wheel_speed
        for drive in drives
    )


def apart(paths: Sequence[Path]) -> Array:
    """Largest distance at equal times between each two paths, in the order of pairs [m]."""
    return np.array(
        [
            np.linalg.norm(one.poses[:, :2] - other.poses[:, :2], axis=1).max()
            for one, other in combinations(paths, 2)
        ]
    )


def wheels_apart(paths: Sequence[Path]) -> Array:
    """Largest difference of a wheel speed at equal times, in the order of pairs [rad/s]."""
    return np.array(
        [np.abs(one.controls - other.controls).max() for one, other in combinations(paths, 2)]
    )


def spans(active: BoolArray) -> int:
    """Number of uninterrupted spans in which a flag is set."""
    padded = np.concatenate([[False], active])
    return int(np.count_nonzero(~padded[:-1] & padded[1:]))


def saturated(path: Path) -> BoolArray:
    """Whether each wheel is at its limit at each step, shape ``(N, 2)``."""
    at_limit: BoolArray = np.abs(path.controls) >= path.settings.robot.max_wheel_speed - 1e-6
    return at_limit


def millimetres(metres: float) -> str:
    """A clearance with its sign, without a negative zero."""
    return f'{round(metres * 1e3, 2) + 0.0:+.2f}'


def _row(drive: Drive) -> tuple[str, ...]:
    measures = drive.measures()
    slack = sum(count for level, count in measures['levels'].items() if level != 'nominal')
    return (
        drive.experiment.label,
        'between samples too' if drive.between_samples else 'at samples',
        f'{measures["miss_m"]:.1e}',
        millimetres(measures['clearance_at_samples_m']),
        millimetres(measures['clearance_between_samples_m']),
        f'{measures["max_right_rad_s"]:.2f} / {measures["max_left_rad_s"]:.2f}',
        f'{measures["cost"]:.2f}',
        str(slack),
    )
