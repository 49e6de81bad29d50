"""A bag that cannot be audited is refused in one line that says why."""

from dataclasses import replace
from xml.etree import ElementTree as ET

import numpy as np
import pytest

from cmpsp_ros.bags import Bag, BagError
from cmpsp_ros.bags.audit import CheckOutcome, Sources, audit_record, read_record, write_junit
from cmpsp_ros.bags.audit.sources import find
from cmpsp_ros.parameters import ParameterError


def refusal(drive, path, sources=None, kind=BagError):
    bag = drive.write(path)
    with pytest.raises(kind) as caught:
        read_record(bag, sources)
    text = str(caught.value)
    assert '\n' not in text
    return text


@pytest.mark.parametrize(
    ('sources', 'said'),
    [
        (Sources(odom='/cmd_vel'), 'found geometry_msgs/msg/Twist in /cmd_vel'),
        (Sources(cmd_vel='/odom'), 'found nav_msgs/msg/Odometry in /odom'),
    ],
)
def test_a_topic_of_another_type_is_refused(drive, tmp_path, sources, said):
    assert said in refusal(drive, tmp_path / 'bag', sources)


def test_a_bag_without_a_drive_is_refused(drive, tmp_path):
    drive.odometry = drive.odometry[:1]
    assert 'wanted a drive' in refusal(drive, tmp_path / 'bag')


def test_several_robots_have_to_be_told_apart(drive, tmp_path):
    drive.namespace = '/r1'
    with Bag(drive.write(tmp_path / 'bag')) as bag:
        # As if a second robot's parameters had been recorded beside.
        bag.parameters = {**bag.parameters, '/r2/guidance': bag.parameters['/r1/guidance']}
        with pytest.raises(BagError, match=r'--odom /r1/odom'):
            find(bag, Sources())
        assert find(bag, Sources(odom='/r1/odom')).decision == '/r1/guidance/decision'


def test_parameters_of_a_file_that_cannot_be_used_are_named(drive, tmp_path):
    text = refusal(drive, tmp_path / 'bag', Sources(params_file='case99'), ParameterError)
    assert 'case99' in text


def test_a_position_beyond_all_measure_is_refused(drive, tmp_path):
    drive.odometry[7].pose = np.array([1e300, 0.0, 0.0])
    assert 'wanted one on Earth' in refusal(drive, tmp_path / 'bag')


def test_a_decision_beyond_all_time_is_refused(drive, tmp_path):
    drive.decisions[3] = drive.decisions[3]._replace(stamp=(1 << 62) + 1, plan=None)
    assert 'wanted one of a clock' in refusal(drive, tmp_path / 'bag')


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
