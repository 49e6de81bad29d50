"""Parts of a recording that are missing, and the true path beside odometry."""

from dataclasses import replace

import numpy as np
import pytest
from drives import LATENCY, SECOND, START, failed

from cmpsp_ros.bags.audit import CheckOutcome, Sources

PASSED, FAILED, _, NOT_JUDGED = CheckOutcome

CENTER = 'obstacles.a.center'


def lost(drive, begin, end):
    """A recording without what was sent in between."""
    low, high = START + round(begin * SECOND), START + round(end * SECOND)
    for key in ('odometry', 'truth', 'commands', 'decisions'):
        kept = [each for each in getattr(drive, key) if not low < each.stamp < high]
        setattr(drive, key, kept)
    return drive


def silent(drive, begin, end):
    """Odometry drops out, and the recording says so: nothing else is missing."""
    truth, count = drive.odometry, len(drive.decisions)
    drive = lost(drive, begin, end)
    drive.truth, missing = truth, count - len(drive.decisions)
    drive.decisions = [
        each._replace(step=each.step - missing) if each.stamp > START + begin * SECOND else each
        for each in drive.decisions
    ]
    return drive


def test_a_robot_left_moving_without_odometry_is_caught(drive, outcomes):
    findings = outcomes(silent(drive, 3.0, 4.5))
    assert 'silence' in failed(findings)
    assert findings['silence'].worst == pytest.approx(1.5, abs=0.05)


def test_a_stop_in_time_is_all_that_is_asked_when_odometry_is_silent(drive, outcomes):
    drive = silent(drive, 3.0, 4.5)
    stop = drive.copy().decisions[-1]
    when = START + round(3.52 * SECOND)
    at = drive.at(3.5)
    said = stop._replace(stamp=when, step=16, finished=False, halted=True, reason='No odometry.')
    drive.decisions.insert(at, said)
    command = drive.copy().commands[-1]
    command.stamp, command.received = when, when + 1_000_000
    drive.commands.insert(at, command)
    findings = outcomes(drive)
    assert findings['silence'].outcome is PASSED
    assert 'stopped in time' in findings['silence'].sentence
    assert findings['rate'].outcome is PASSED


def test_what_lies_in_a_hole_of_the_recording_is_not_judged(drive, outcomes):
    findings = outcomes(lost(drive, 3.0, 6.0))
    assert failed(findings) == set()
    of_the_path = ('road', 'obstacles', 'nominal', 'obeyed')
    for check in (*of_the_path, 'rate', 'age', 'silence'):
        assert findings[check].outcome is NOT_JUDGED, check
        assert 'not recorded from 3.00 to 6.00 s (3.00 s)' in findings[check].sentence
    assert findings['goal'].outcome is PASSED
    assert findings['road'].worst == pytest.approx(0.4, abs=0.4)


def test_a_contact_beside_a_hole_is_one(drive, outcomes):
    drive.parameters[CENTER] = drive.odometry[100].pose[:2].tolist()
    findings = outcomes(lost(drive, 3.0, 6.0))
    assert 'obstacles' in failed(findings)
    assert findings['obstacles'].at == pytest.approx(2.0, abs=0.5)


def test_a_hole_in_odometry_is_none_where_the_true_path_is_known(drive, outcomes):
    drive.truth = list(drive.odometry)
    low, high = START + 3 * SECOND, START + 3.5 * SECOND
    drive.odometry = [each for each in drive.odometry if not low < each.stamp < high]
    findings = outcomes(drive)
    assert findings['road'].outcome is findings['obstacles'].outcome is PASSED
    # What was commanded there cannot be judged all the same.
    assert findings['commanded'].outcome is NOT_JUDGED


def test_a_robot_is_judged_by_where_it_really_was(drive, outcomes):
    aside = np.array([0.1, 0.0, 0.0])
    drive.truth = [replace(each, pose=each.pose + aside) for each in drive.odometry]
    findings = outcomes(drive)
    assert {'obstacles', 'goal'} <= failed(findings)
    assert 'by the true path' in findings['obstacles'].sentence
    assert findings['goal'].worst == pytest.approx(0.1)


@pytest.mark.parametrize('is_known', [True, False])
def test_the_stated_error_of_odometry_is_no_contact_where_the_true_path_is_known(
    drive, outcomes, is_known
):
    drive.truth = [replace(each) for each in drive.odometry] if is_known else []
    for each in drive.odometry:
        each.pose, each.spread = np.add(each.pose, [0.08, 0.0, 0.0]), 0.03
    assert ('obstacles' in failed(outcomes(drive))) != is_known


def test_a_recording_that_begins_late_is_not_judged_by_another_time_0(drive, outcomes):
    findings = outcomes(lost(drive, -1.0, 2.1))
    assert failed(findings) == set()
    assert findings['goal'].outcome is PASSED
    assert findings['goal'].at == pytest.approx(10.0)
    assert 'not recorded from 0.00 to 2.1' in findings['road'].sentence


@pytest.mark.parametrize(('stop', 'left', 'outcome'), [(0.3, 0.4, PASSED), (1.5, 1.6, FAILED)])
def test_odometry_may_be_silent_for_good(drive, outcomes, stop, left, outcome):
    drive.decisions, end = [], START + 3 * SECOND
    drive.odometry = [each for each in drive.odometry if each.stamp <= end]
    drive.commands = [each for each in drive.commands if each.stamp <= end + 2 * SECOND]
    for each in drive.commands:
        if each.stamp > end + stop * SECOND:
            each.twist = 0.0 * each.twist
    finding = outcomes(drive)['silence']
    assert finding.outcome is outcome
    assert finding.worst == pytest.approx(left, abs=0.01)
    assert finding.at == pytest.approx(3.0)


def test_odometry_that_decisions_used_to_the_end_is_not_recorded_rather_than_silent(
    drive, outcomes
):
    drive.odometry = [each for each in drive.odometry if each.stamp <= START + 3 * SECOND]
    findings = outcomes(drive)
    for check in ('silence', 'age'):
        assert findings[check].outcome is NOT_JUDGED, check
        assert 'Odometry is not recorded from 3.00' in findings[check].sentence


@pytest.mark.parametrize('every', [1, 5, 6, 8, 10, 17])
@pytest.mark.parametrize('is_late', [False, True])
def test_odometry_that_is_slow_excuses_no_command_that_is_late(drive, outcomes, every, is_late):
    drive.odometry, drive.decisions = drive.odometry[::every], []
    stamps = np.array([each.stamp for each in drive.odometry])
    for each in drive.commands:
        # It answers the first odometry from its time on.
        each.stamp = int(stamps[np.searchsorted(stamps, each.stamp).clip(max=len(stamps) - 1)])
        each.received = each.stamp + LATENCY
    latest = {each.stamp: each for each in drive.commands}
    low, high = START + 4 * SECOND, START + 6 * SECOND
    drive.commands = [
        each for stamp, each in latest.items() if not (is_late and low < stamp < high)
    ]
    finding = outcomes(drive)['rate']
    assert finding.outcome is (FAILED if is_late else PASSED), finding
    if is_late:
        assert finding.worst == pytest.approx(2.0, abs=0.4)


@pytest.mark.parametrize('seconds', [2.0, 4.5, 7.0])
@pytest.mark.parametrize(
    ('begin', 'end'), [(3.0, 6.0), (3.0, 99.0), (-1.0, 6.0), (99.0, 99.0)],
    ids=['lost for a while', 'lost for good', 'late', 'known'],
)  # fmt: skip
def test_the_stated_error_of_odometry_counts_where_the_true_path_is_not_known(
    drive, outcomes, seconds, begin, end
):
    low, high = START + begin * SECOND, START + end * SECOND
    drive.truth = [replace(each) for each in drive.odometry if not low < each.stamp < high]
    for each in drive.truth:
        heading = each.pose[2]
        each.pose = each.pose + 0.2 * np.array([-np.sin(heading), np.cos(heading), 0.0])
    drive.parameters |= {'obstacles.a.radius': 0.1, 'obstacles.b.center': [90.0, 90.0]}
    drive.parameters[CENTER] = drive.odometry[round(50 * seconds)].pose[:2].tolist()
    for each in drive.odometry:
        each.spread = 0.1
    assert ('obstacles' in failed(outcomes(drive))) == (begin < seconds < end)


@pytest.mark.parametrize('ahead', [0, 6, 1000])
def test_commands_stamped_by_another_clock_cut_off_no_path(drive, outcomes, ahead):
    drive.decisions, drive.stamped = [], True
    drive.parameters[CENTER] = drive.odometry[150].pose[:2].tolist()
    for each in drive.commands:
        each.stamp += ahead * SECOND
    findings = outcomes(drive)
    assert {'obstacles', 'commanded'} <= failed(findings)
    assert findings['obstacles'].at == pytest.approx(3.0, abs=0.1)
    assert findings['goal'].outcome is findings['rate'].outcome is PASSED


@pytest.mark.parametrize('is_stamped', [False, True])
def test_commands_from_before_any_odometry_begin_the_run(drive, outcomes, is_stamped):
    drive, drive.stamped = drive.without_node(), is_stamped
    drive.odometry = [each for each in drive.odometry if each.stamp >= START + 5 * SECOND]
    findings = outcomes(drive, Sources(params_file='case3'))
    for check in ('road', 'obstacles', 'commanded'):
        assert findings[check].outcome is NOT_JUDGED, check
    assert 'not recorded from 0.00 to 5.00 s' in findings['road'].sentence
    assert findings['goal'].outcome is PASSED
    assert findings['goal'].at == pytest.approx(10.0)


def test_commands_stamped_by_old_odometry_are_old(drive, outcomes):
    drive.decisions, drive.stamped = [], True
    for each in drive.commands:
        each.received += 2 * SECOND
    assert 'age' in failed(outcomes(drive))
