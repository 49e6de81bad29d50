"""An audit as a table for the terminal."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from rich.table import Table
from rich.text import Text

from cmpsp_ros.bags.audit.finding import Finding, Outcome

_STYLES = {Outcome.PASSED: 'green', Outcome.FAILED: 'bold red', Outcome.SKIPPED: 'dim'}


def table(findings: Sequence[Finding], title: str) -> Table:
    """One row a check; what comes from a bag is shown as it is, without markup."""
    rows = Table('', 'check', 'worst', 'limit', 'at', title=Text(title))
    for each in findings:
        rows.add_row(
            _outcome(each),
            each.title,
            each.worst_text,
            each.limit_text,
            '' if each.at is None else f'{each.at:.2f} s',
        )
    return rows


def remarks(findings: Sequence[Finding]) -> Iterator[Text]:
    """A sentence on each check that has not been passed."""
    for each in findings:
        if each.outcome is not Outcome.PASSED:
            yield _outcome(each).append(f' {each.title}: {each.sentence}')


def _outcome(finding: Finding) -> Text:
    return Text.assemble((finding.outcome.value, _STYLES[finding.outcome]))
