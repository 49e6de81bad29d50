"""The report: claim by claim, then the tables, then the pictures."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence

from cmpsp_ros.studies.paper.claims import Artefact, Claim, Table, Verdict

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


def write(artefacts: Mapping[str, Artefact]) -> str:
    """The report in Markdown."""
    claims = [claim for artefact in artefacts.values() for claim in artefact.claims]
    parts = [_INTRODUCTION, '## Claims', _count(claims), _VERDICTS, _claims(artefacts)]
    tables = [table for artefact in artefacts.values() for table in artefact.tables]
    if tables:
        parts.append('## Figures in numbers')
        parts += [f'### {table.heading}\n\n{_table(table)}' for table in tables]
    pictures = [(n, artefact) for n, artefact in artefacts.items() if artefact.figure is not None]
    if pictures:
        parts.append('## Pictures')
        parts += [f'**{n}** {artefact.title}.\n\n![{n}]({n}.png)' for n, artefact in pictures]
    return '\n\n'.join(part.strip('\n') for part in parts) + '\n'


def _count(claims: Sequence[Claim]) -> str:
    counts = Counter(claim.verdict for claim in claims)
    parts = [f'{counts[verdict]} {verdict.value}' for verdict in Verdict if counts[verdict]]
    return f'{len(claims)} claims: {", ".join(parts)}.'


def _claims(artefacts: Mapping[str, Artefact]) -> str:
    return _table(Table('', _CLAIM_COLUMNS, list(_claim_rows(artefacts))))


def _claim_rows(artefacts: Mapping[str, Artefact]) -> Iterator[tuple[str, ...]]:
    for name, artefact in artefacts.items():
        for claim in artefact.claims:
            yield (
                name,
                claim.where,
                claim.says,
                claim.found,
                f'**{claim.verdict.value}**',
                claim.reason,
            )


def _table(table: Table) -> str:
    rows = [table.columns, ['---'] * len(table.columns), *table.rows]
    return '\n'.join('| ' + ' | '.join(_cell(cell) for cell in row) + ' |' for row in rows)


def _cell(text: str) -> str:
    return text.replace('|', '\\|')
