"""Report on many comparisons: a line for each family, and all findings by name."""

import json
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

from rich.box import SIMPLE_HEAD
from rich.table import Table

from benchmarks.common import BenchError
from benchmarks.verify.compare import Comparison
from cmpsp_ros.mpsp.qp import QPStatus


class Line(NamedTuple):
    """Counts of one family, and the largest errors of the programs that were solved."""

    family: str
    programs: int
    solved: int
    infeasible: int
    agree: int
    explained: int
    mismatches: int
    residual: float
    gap: float
    difference: float


_HEADERS = (
    'family', 'QPs', 'solved', 'inf.', 'agree', 'expl.', 'wrong', 'KKT', 'gap', 'cost',
)  # fmt: skip


def lines(comparisons: Sequence[Comparison]) -> list[Line]:
    """A line for each family, in order, and one for the total."""
    families: dict[str, list[Comparison]] = {}
    for each in comparisons:
        families.setdefault(each.origin.family, []).append(each)
    return [_line(name, of_family) for name, of_family in families.items()] + [
        _line('all', comparisons)
    ]


def mismatches(comparisons: Sequence[Comparison]) -> list[Comparison]:
    """Comparisons with an unexplained finding."""
    return [each for each in comparisons if each.is_mismatch]


def to_json(comparisons: Sequence[Comparison], qp: str) -> str:
    """Everything as JSON: ``qp``, ``families`` (the lines) and ``findings``.

    Each finding has the ``case`` that reproduces it, ``about``, ``references`` (their verdict),
    ``check``, ``found`` and ``explanation``, empty for a mismatch.
    """
    findings = [
        {
            'case': str(each.origin),
            'about': each.about,
            'references': each.verdict.value,
            **finding._asdict(),
        }
        for each in comparisons
        for finding in each.findings
    ]
    content: dict[str, Any] = {
        'qp': qp,
        'families': [line._asdict() for line in lines(comparisons)],
        'findings': findings,
    }
    return json.dumps(content, indent=1) + '\n'


def table(comparisons: Sequence[Comparison], qp: str) -> Table:
    """The lines for a terminal."""
    title = f'{qp} against Clarabel and daqp'
    result = Table(*_HEADERS, title=title, box=SIMPLE_HEAD, padding=0, pad_edge=False)
    for line in lines(comparisons):
        cells = (f'{each:.0e}' if isinstance(each, float) else str(each) for each in line)
        result.add_row(*cells)
    return result


def describe(comparison: Comparison) -> str:
    """Everything about one comparison, in a line for each finding."""
    words = f'{comparison.origin}: {comparison.about}; {comparison.status.name}'
    if comparison.status is QPStatus.SOLVED:
        residual, gap = comparison.accuracy
        words += f', residual {residual:.1e}, gap {gap:.1e}'
    cold, warm = comparison.iterations
    words += f', iterations {cold} and with a warm start {warm}' if warm else f', iterations {cold}'
    parts = [words, comparison.verdict.value]
    for finding in comparison.findings:
        because = f' (explained: {finding.explanation})' if finding.explanation else ''
        parts.append(f'{finding.check}: {finding.found}{because}')
    return '\n  '.join(parts)


def new_file(path: Path) -> Path:
    """The path, if a new file can be made there."""
    if path.exists():
        raise BenchError(f'{path}: found something there, wanted a new file')
    if not path.parent.is_dir() or not os.access(path.parent, os.W_OK):
        raise BenchError(f'{path}: {path.parent} is no folder that can be written to')
    return path


def _line(name: str, of_family: Sequence[Comparison]) -> Line:
    solved = [each for each in of_family if each.status is QPStatus.SOLVED]
    infeasible = sum(each.status is QPStatus.INFEASIBLE for each in of_family)
    wrong = len(mismatches(of_family))
    agree = sum(not each.findings for each in of_family)
    return Line(
        name,
        len(of_family),
        len(solved),
        infeasible,
        agree,
        len(of_family) - agree - wrong,
        wrong,
        max((each.accuracy.residual for each in solved), default=0.0),
        max((abs(each.accuracy.gap) for each in solved), default=0.0),
        max((abs(each.difference) for each in solved), default=0.0),
    )
