"""An audit as a table for the terminal, and as JUnit XML for continuous integration."""

import re
from collections.abc import Iterator, Sequence
from datetime import UTC, datetime
from pathlib import Path
from xml.etree.ElementTree import Element, ElementTree, SubElement, indent

from rich.table import Table
from rich.text import Text

from cmpsp_ros.bags.audit.finding import CheckOutcome, Finding
from cmpsp_ros.bags.audit.record import AuditRecord
from cmpsp_ros.bags.errors import written
from cmpsp_ros.guidance import NANOSECONDS

_STYLES = {
    CheckOutcome.PASSED: 'green',
    CheckOutcome.FAILED: 'bold red',
    CheckOutcome.SKIPPED: 'dim',
    CheckOutcome.NOT_JUDGED: 'bold yellow',
}

# Characters that XML 1.0 cannot hold, not even escaped.
_NO_XML = re.compile('[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]')


def table(findings: Sequence[Finding], title: str) -> Table:
    """One row per check; text from a bag is shown without markup."""
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
        if each.outcome is not CheckOutcome.PASSED:
            yield _outcome(each).append(f' {each.title}: {each.sentence}')


def _outcome(finding: Finding) -> Text:
    return Text.assemble((finding.outcome.value, _STYLES[finding.outcome]))


def write_junit(path: Path, findings: Sequence[Finding], record: AuditRecord) -> None:
    """Write one test case a check; valid by the schema that Jenkins and GitLab read."""
    counts = {each: sum(one.outcome is each for one in findings) for each in CheckOutcome}
    start = datetime.fromtimestamp(record.start // NANOSECONDS, UTC)
    suite = Element(
        'testsuite',
        {
            'name': _text(f'audit of {record.path}'),
            'timestamp': f'{start:%Y-%m-%dT%H:%M:%S}',
            'hostname': 'localhost',
            'tests': str(len(findings)),
            'failures': str(counts[CheckOutcome.FAILED]),
            'errors': str(counts[CheckOutcome.NOT_JUDGED]),
            'skipped': str(counts[CheckOutcome.SKIPPED]),
            'time': f'{record.end:.3f}',
        },
    )
    SubElement(suite, 'properties')
    for each in findings:
        _add_case(suite, each)
    SubElement(suite, 'system-out')
    SubElement(suite, 'system-err')
    indent(suite)
    with written(path):
        ElementTree(suite).write(path, encoding='utf-8', xml_declaration=True)


def _add_case(suite: Element, finding: Finding) -> None:
    case = SubElement(
        suite,
        'testcase',
        {'name': finding.title, 'classname': f'audit.{finding.check}', 'time': '0'},
    )
    message = {'message': _text(finding.sentence)}
    if finding.outcome is CheckOutcome.SKIPPED:
        SubElement(case, 'skipped', message)
    elif finding.outcome is CheckOutcome.NOT_JUDGED:
        SubElement(case, 'error', message, type='not judged')
    elif finding.outcome is CheckOutcome.FAILED:
        failure = SubElement(case, 'failure', message, type=finding.check)
        when = '' if finding.at is None else f', at {finding.at:.3f} s'
        failure.text = _text(f'worst {finding.worst_text}, limit {finding.limit_text}{when}')


def _text(text: str) -> str:
    return _NO_XML.sub('\N{REPLACEMENT CHARACTER}', text)
