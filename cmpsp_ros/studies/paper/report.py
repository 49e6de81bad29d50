"""Sheets of the report: claims with their verdicts, tables, numbers and the picture."""

from __future__ import annotations

import tomllib
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from enum import Enum
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

from matplotlib.figure import Figure

from cmpsp_ros.studies.paper.drives import Drive, Laboratory, Panels

_INTRODUCTION = """\
# The paper's results, made again

Every figure and table of Sec. 5 of "Comprehensive MPSP for Fast Optimal Control: Algorithm
Development and Convergence Analysis", driven by this package's guidance law and an exact model of
the robot, two iterations at each control step. Each run is driven twice: with road and obstacles
held clear *at the samples* only, as the paper has it, and *between samples too*. What is given
here is measured on the path driven. All numbers are in `results.json`.
"""

_VERDICTS = """\
*Holds* and *does not hold* are measured here; *depends* names what it depends on; *not decidable*
means that the text does not say enough to tell.
"""

_CLAIM_COLUMNS = ('', 'where', 'the paper', 'here', 'verdict', 'why')
_RUN_COLUMNS = (
    'run', 'held clear', 'miss [m]', 'clearance at samples [mm]', 'between samples [mm]',
    'largest right / left [rad/s]', 'cost (95)', 'steps with slack',
)  # fmt: skip


class ClaimVerdict(Enum):
    """Answer to a claim."""

    HOLDS = 'holds'
    FAILS = 'does not hold'
    DEPENDS = 'depends'
    UNDECIDABLE = 'not decidable'

    @classmethod
    def of(cls, holds: bool) -> ClaimVerdict:
        """Verdict on a measurement that either agrees or does not."""
        return cls.HOLDS if holds else cls.FAILS


class Claim(NamedTuple):
    """One row of the report: the paper's words at a place, the result here, and why."""

    where: str
    says: str
    found: str
    verdict: ClaimVerdict
    reason: str


class Table(NamedTuple):
    """A table of the report: a heading, the columns' names and rows of text."""

    heading: str
    columns: Sequence[str]
    rows: Sequence[Sequence[str]]

    @classmethod
    def of_runs(cls, heading: str, drives: Sequence[Drive]) -> Table:
        """The figures of runs, one row each."""
        rows = [
            (
                drive.experiment.label,
                'between samples too' if drive.between_samples else 'at samples',
                f'{found["miss_m"]:.1e}',
                millimetres(found['clearance_at_samples_m']),
                millimetres(found['clearance_between_samples_m']),
                f'{found["max_right_rad_s"]:.2f} / {found["max_left_rad_s"]:.2f}',
                f'{found["cost"]:.2f}',
                str(drive.steps_with_slack),
            )
            for drive, found in ((drive, drive.measures()) for drive in drives)
        ]
        return cls(heading, _RUN_COLUMNS, rows)

    def markdown(self) -> str:
        """Rows in Markdown, without the heading."""
        rows = [self.columns, ['---'] * len(self.columns), *self.rows]
        cells = ([cell.replace('|', '\\|') for cell in row] for row in rows)
        return '\n'.join('| ' + ' | '.join(row) + ' |' for row in cells)


@dataclass
class Sheet:
    """A figure or table of the paper, with the runs that it shows, while its check fills it in."""

    title: str
    lab: Laboratory
    panels: Panels
    numbers: dict[str, Any] = field(default_factory=dict)  # for `results.json`
    claims: list[Claim] = field(default_factory=list)
    tables: list[Table] = field(default_factory=list)
    figure: Figure | None = None

    def claim(
        self, key: str, verdict: ClaimVerdict | bool, *, otherwise: bool = False, **values: object
    ) -> None:
        """Add a claim of `claims.toml`."""
        text = _claims()[key]
        chosen = verdict if isinstance(verdict, ClaimVerdict) else ClaimVerdict.of(verdict)
        reason = text['otherwise' if otherwise else 'reason']
        where, says, found, why = (
            each.format_map(values) for each in (text['where'], text['says'], text['found'], reason)
        )
        self.claims.append(Claim(where, says, found, chosen, why))

    def content(self) -> dict[str, Any]:
        """Title, claims and numbers, ready for JSON."""
        claims = [{**each._asdict(), 'verdict': each.verdict.value} for each in self.claims]
        return {'title': self.title, 'claims': claims, **self.numbers}


def write_report(sheets: Mapping[str, Sheet]) -> str:
    """The report in Markdown."""
    rows = [
        (name, claim.where, claim.says, claim.found, f'**{claim.verdict.value}**', claim.reason)
        for name, sheet in sheets.items()
        for claim in sheet.claims
    ]
    counts = Counter(claim.verdict for sheet in sheets.values() for claim in sheet.claims)
    counted = [f'{counts[verdict]} {verdict.value}' for verdict in ClaimVerdict if counts[verdict]]
    claims = Table('', _CLAIM_COLUMNS, rows)
    summary = f'{len(rows)} claims: {", ".join(counted)}.'
    parts = [_INTRODUCTION, '## Claims', summary, _VERDICTS, claims.markdown()]
    if tables := [table for sheet in sheets.values() for table in sheet.tables]:
        parts.append('## Figures in numbers')
        parts += [f'### {table.heading}\n\n{table.markdown()}' for table in tables]
    if pictures := [(name, sheet) for name, sheet in sheets.items() if sheet.figure is not None]:
        parts.append('## Pictures')
        parts += [f'**{name}** {sheet.title}.\n\n![{name}]({name}.png)' for name, sheet in pictures]
    return '\n\n'.join(part.strip('\n') for part in parts) + '\n'


def millimetres(metres: float) -> str:
    """A clearance with its sign, without a negative zero."""
    return f'{round(metres * 1e3, 2) + 0.0:+.2f}'


@cache
def _claims() -> dict[str, dict[str, str]]:
    return tomllib.loads(Path(__file__).with_name('claims.toml').read_text(encoding='utf-8'))
