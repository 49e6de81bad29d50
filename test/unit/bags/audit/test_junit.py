"""The audit as JUnit XML."""

from dataclasses import replace
from xml.etree import ElementTree as ET

import pytest

from cmpsp_ros.bags import BagError
from cmpsp_ros.bags.audit import CheckOutcome, audit_record, read_record, write_junit


@pytest.fixture
def record(drive, tmp_path):
    drive.parameters['goal.position'] = [10.0, 0.1]
    return read_record(drive.write(tmp_path / 'bag'))


def test_one_case_a_check_with_what_was_found(record, tmp_path):
    findings = audit_record(record)
    write_junit(tmp_path / 'audit.xml', findings, record)
    suite = ET.parse(tmp_path / 'audit.xml').getroot()
    assert suite.tag == 'testsuite'
    assert {key: suite.get(key) for key in ('tests', 'failures', 'errors', 'skipped')} == {
        'tests': str(len(findings)),
        'failures': '1',
        'errors': '0',
        'skipped': '10',
    }
    assert suite.get('timestamp') == '2023-11-14T22:13:20'
    assert float(suite.get('time')) == pytest.approx(10.4)
    # The schema is strict about what comes first.
    kinds = [each.tag for each in suite]
    assert kinds == ['properties', *['testcase'] * len(findings), 'system-out', 'system-err']
    for case, finding in zip(suite.iter('testcase'), findings, strict=True):
        assert case.get('classname') == f'audit.{finding.check}'
        assert case.get('name') == finding.title
        assert float(case.get('time')) == 0.0
    (failure,) = suite.iter('failure')
    assert 'm from the goal' in failure.get('message')
    assert failure.get('type') == 'goal'
    assert 'worst 0.1 m, limit 0.01 m, at 10.000 s' in failure.text


def test_what_is_not_judged_is_an_error(drive, tmp_path):
    record = read_record(drive.until(4.1).write(tmp_path / 'bag'))
    write_junit(tmp_path / 'audit.xml', audit_record(record), record)
    suite = ET.parse(tmp_path / 'audit.xml').getroot()
    assert (suite.get('failures'), suite.get('errors'), suite.get('skipped')) == ('0', '2', '10')
    errors = [each.find('error') for each in suite.iter('testcase')]
    said = [each.get('message') for each in errors if each is not None]
    assert said[0] == 'The recording ends 5.9 s before the final time.'


def test_whatever_a_bag_says_is_valid_xml(record, tmp_path):
    said = 'a <b> & "c" \x00\x1b[31m \ud800 ]]> \U0001f600'
    findings = [
        replace(each, sentence=said, outcome=outcome)
        for each, outcome in zip(audit_record(record), CheckOutcome, strict=False)
    ]
    write_junit(tmp_path / 'audit.xml', findings, record)
    suite = ET.parse(tmp_path / 'audit.xml').getroot()
    (failure,) = suite.iter('failure')
    assert failure.get('message') == 'a <b> & "c" ��[31m � ]]> \U0001f600'


def test_a_file_that_cannot_be_written_is_named(record, tmp_path):
    with pytest.raises(BagError, match=r'audit\.xml: cannot be written'):
        write_junit(tmp_path / 'no' / 'audit.xml', audit_record(record), record)
