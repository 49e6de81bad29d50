"""All runs as one table for other programs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from cmpsp_ros.studies.monte_carlo.outcome import Outcome


def write(
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
    table = pa.Table.from_pylist(rows)
    # A column of nothing but None has no type of its own.
    for name, kind in types.items():
        place = table.column_names.index(name)
        table = table.set_column(place, name, table.column(name).cast(kind))
    parquet.write_table(table, path)
    return True
