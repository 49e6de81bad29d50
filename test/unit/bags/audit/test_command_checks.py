"""Checks of the commands and of the fallback levels catch what is wrong with them."""

import numpy as np
import pytest
from drives import ODOM_PERIOD, SECOND, START, Command, Sample, drive_case, drive_settings, failed

from cmpsp_ros.bags.audit import CheckOutcome
from cmpsp_ros.guidance import FallbackLevel

PASSED, FAILED, *_ = CheckOutcome


def commanding(seconds, *change):
    def tamper(drive):
        drive.commands[drive.at(seconds)].twist += change

    return tamper


def deciding(index, **change):
    def tamper(drive):
        drive.decisions[index] = drive.decisions[index]._replace(**change)

    return tamper


def lose_commands(drive):
    first = drive.at(3.0)
    del drive.commands[first : first + 3], drive.decisions[first : first + 3]


def delay_commands(seconds, first=0):
    def tamper(drive):
        for each in drive.commands[first:]:
            each.received += round(seconds * SECOND)

    return tamper


def delay_odometry(drive):
    for each in drive.odometry:
        each.received += SECOND


@pytest.mark.parametrize(
    ('tamper', 'checks', 'at', 'said'),
    [
        (commanding(4.0, 0.0, 4.0), ['as_decided', 'obeyed'], 4.0, '1 of 53 commands are not'),
        (commanding(5.2, 0.0, -6.0), ['commanded'], 5.2, 'obstacle a'),
        (commanding(3.0, 0.3, 0.0), ['wheel_limits'], 3.0, 'rad/s of a wheel'),
        (commanding(3.0, 0.0, np.nan), ['finite', 'as_decided'], 3.0, '1 of 53'),
        (commanding(3.0, 0.0, np.inf), ['finite', 'as_decided'], 3.0, '1 of 53'),
        (lose_commands, ['rate'], 2.8, 'for 0.8 s'),
        (delay_commands(0.6), ['rate'], 0.0, 'for 0.6'),
        (delay_commands(0.6, 50), ['rate'], 9.803, 'for 0.597'),
        (delay_commands(2.0), ['rate', 'age'], 0.0, 'for 2'),
        (delay_commands(2.0), ['age'], None, 'that is 2'),
        (delay_odometry, ['age'], None, 'that is 1'),
        (deciding(7, reason=' '), ['reasons'], 1.4, 'without a reason'),
        (deciding(7, level=FallbackLevel.STOP), ['reasons'], 1.4, 'with wheels that turn'),
        (deciding(7, finished=True), ['reasons'], 1.4, 'after the final time'),
    ],
)
def test_what_is_wrong_is_caught_by_its_check(drive, outcomes, tamper, checks, at, said):
    tamper(drive)
    findings = outcomes(drive)
    assert set(checks) <= failed(findings)
    finding = findings[checks[0]]
    assert said in finding.sentence
    assert abs(finding.worst) > finding.limit or finding.worst < finding.limit == 0.0
    if at is not None:
        assert finding.at == pytest.approx(at)


def test_a_wrong_command_is_caught_even_if_the_decision_says_the_same(drive, outcomes):
    index = drive.at(4.0)
    robot = drive_settings(drive).robot
    twist = np.add(drive.commands[index].twist, [0.0, 4.0])
    drive.commands[index].twist = twist
    drive.decisions[index] = drive.decisions[index]._replace(
        wheel_speeds=robot.wheel_speeds(twist), twist=twist
    )
    findings = outcomes(drive)
    assert 'as_decided' not in failed(findings)
    assert 'obeyed' in failed(findings)


@pytest.mark.parametrize(('held', 'judged'), [(0.08, False), (0.12, True)])
def test_a_command_that_is_held_only_briefly_cannot_be_seen_to_be_obeyed(
    drive, outcomes, held, judged
):
    index = drive.at(4.0)
    follower = drive.commands[index]
    before = round(held * SECOND)
    other = Command(
        follower.received - before, follower.stamp - before, np.add(follower.twist, [0.0, 4.0])
    )
    drive.commands.insert(index, other)
    # Commands with stamps need no decisions to say what they answer.
    drive.stamped = True
    assert ('obeyed' in failed(outcomes(drive))) == judged


@pytest.mark.parametrize(('spread', 'outcome'), [(0.0, FAILED), (0.05, CheckOutcome.NOT_JUDGED)])
def test_odometry_that_admits_any_error_does_not_show_obedience(drive, outcomes, spread, outcome):
    for each in drive.odometry:
        each.spread = spread
    for each in drive.commands:
        each.twist = 0.5 * each.twist
    assert outcomes(drive)['obeyed'].outcome is outcome


def standing(drive, seconds, speed):
    """The robot after its last command, from a second later at a speed."""
    last = drive.odometry[-1]
    for k in range(1, round(seconds * SECOND / ODOM_PERIOD)):
        after = k * ODOM_PERIOD
        way = speed * max(after / SECOND - 1.0, 0.0)
        pose = np.add(last.pose, [way * np.cos(last.pose[2]), way * np.sin(last.pose[2]), 0.0])
        # Each twice, as where a command takes effect.
        drive.odometry += [Sample(last.received + after, last.stamp + after, pose)] * 2


@pytest.mark.parametrize(('speed', 'outcome'), [(0.0, PASSED), (0.4, FAILED)])
def test_a_robot_that_drives_on_after_its_last_stop_is_caught(drive, outcomes, speed, outcome):
    standing(drive, 4.0, speed)
    finding = outcomes(drive)['obeyed']
    assert finding.outcome is outcome
    assert (finding.at > 11.0) == (outcome is FAILED)


def test_a_robot_that_is_set_somewhere_else_after_its_last_stop_has_obeyed(drive, outcomes):
    standing(drive, 4.0, 0.0)
    last = drive.odometry[-1]
    elsewhere = np.add(last.pose, [1.0, 0.0, 0.0])
    drive.odometry.append(Sample(last.received + 1, last.stamp, elsewhere))
    later = last.stamp + ODOM_PERIOD
    drive.odometry.append(Sample(last.received + ODOM_PERIOD, later, elsewhere))
    assert outcomes(drive)['obeyed'].outcome is PASSED


@pytest.mark.parametrize(('speed', 'outcome'), [(0.0, PASSED), (1.0, CheckOutcome.NOT_JUDGED)])
def test_a_robot_that_drives_without_commands_after_the_clock_jumped_back_is_told(
    drive, outcomes, speed, outcome
):
    first = len(drive.odometry)
    standing(drive, 6.0, speed)
    for each in drive.odometry[first::2]:
        each.stamp -= 9 * SECOND
    finding = outcomes(drive)['rate']
    assert finding.outcome is outcome
    assert ('moves from 1.42 to 7.38 s (5.96 s) without' in finding.sentence) == (speed > 0.0)


@pytest.mark.parametrize(('said', 'least'), [(0.06, 0.064), (0.0, 0.002)])
def test_a_command_is_judged_from_where_it_takes_effect(outcomes, said, least):
    delayed = drive_case(actuation_delay=0.06, command_delay=0.06)
    # Without the delay from the pose that it answers, where the robot is not any more.
    delayed.parameters['command_delay'] = said
    findings = outcomes(delayed)
    assert not failed(findings)
    assert findings['commanded'].worst == pytest.approx(least, abs=1e-3)


def test_a_command_is_obeyed_when_it_has_taken_effect(outcomes):
    findings = outcomes(drive_case(actuation_delay=0.3, command_delay=0.3, rest=0.6))
    assert not failed(findings)
    assert findings['obeyed'].worst < 0.1


@pytest.mark.parametrize(('count', 'outcome'), [(3, PASSED), (4, FAILED)])
def test_an_old_plan_is_not_followed_for_long(drive, outcomes, count, outcome):
    for index in range(10, 10 + count):
        for at, failures in ((index, 1), (20 + index, 0)):
            # A plan that came too late was made anew: no step has failed.
            decision = drive.decisions[at]
            level = FallbackLevel.PREVIOUS_PLAN
            drive.decisions[at] = decision._replace(level=level, failures=failures)
    findings = outcomes(drive)
    assert findings['previous_plan'].outcome is outcome
    assert findings['previous_plan'].worst == count


def test_commands_without_a_decision_are_not_judged_by_those_that_have_one(drive, outcomes):
    del drive.decisions[:10]
    findings = outcomes(drive)
    assert findings['as_decided'].outcome is CheckOutcome.NOT_JUDGED
    assert '10 others have no decision' in findings['as_decided'].sentence


def test_a_start_that_the_recorder_missed_is_no_wrong_command(drive, outcomes):
    del drive.commands[:2]
    findings = outcomes(drive)
    assert findings['as_decided'].outcome is PASSED


@pytest.fixture(scope='module')
def gentle():
    """A drive that keeps a limit of acceleration, until it is at rest."""
    return drive_case(rest=1.4, **{'robot.max_wheel_acceleration': 100.0})


def test_a_drive_within_the_acceleration_passes(gentle, outcomes):
    findings = outcomes(gentle)
    assert not failed(findings)
    assert findings['acceleration'].outcome is PASSED
    assert findings['acceleration'].worst == pytest.approx(20.0)


@pytest.mark.parametrize('seconds', [0.0, 4.0, 10.0])
def test_a_jump_of_the_command_is_caught(gentle, outcomes, seconds):
    """At the start, on the way, and where the robot should only brake."""
    drive = gentle.copy()
    drive.commands[drive.at(seconds)].twist = np.array([-0.2, 0.0])
    findings = outcomes(drive)
    assert 'acceleration' in failed(findings)
    assert findings['acceleration'].at == pytest.approx(seconds, abs=0.21)


def test_commands_of_another_program_are_judged_alike(gentle, outcomes):
    drive = gentle.without_node()
    drive.parameters = gentle.parameters
    assert outcomes(drive)['acceleration'].worst == pytest.approx(20.0)


def test_a_halt_may_be_sudden(gentle, outcomes):
    drive = gentle.copy()
    index = drive.at(4.0)
    drive.commands[index].twist = np.zeros(2)
    stop = {'wheel_speeds': np.zeros(2), 'twist': np.zeros(2), 'level': FallbackLevel.STOP}
    drive.decisions[index] = drive.decisions[index]._replace(halted=True, **stop)
    for each in drive.commands[index + 1 :]:
        each.twist = np.zeros(2)
    drive.decisions[index + 1 :] = [each._replace(**stop) for each in drive.decisions[index + 1 :]]
    assert 'acceleration' not in failed(outcomes(drive))


@pytest.fixture(scope='module')
def smooth():
    """A drive that keeps a limit of jerk, until it is at rest."""
    limits = {'robot.max_wheel_acceleration': 60.0, 'robot.max_wheel_jerk': 100.0}
    return drive_case(rest=1.4, final_time=12.0, **limits)


def test_a_drive_within_the_jerk_passes_and_its_stop_is_exempt(smooth, outcomes):
    findings = outcomes(smooth)
    assert not failed(findings)
    assert findings['jerk'].outcome is PASSED
    assert findings['jerk'].worst == pytest.approx(4.0, abs=1e-3)
    speeds = [each.wheel_speeds for each in smooth.decisions]
    assert np.abs(np.diff(speeds, n=2, axis=0)).max() > 8.0


@pytest.mark.parametrize('seconds', [0.0, 4.0, 9.0])
def test_a_jerk_of_a_command_is_caught(smooth, outcomes, seconds):
    drive = smooth.copy()
    drive.commands[drive.at(seconds)].twist += np.array([0.2, 0.0])
    findings = outcomes(drive)
    assert {'jerk', 'as_decided'} <= failed(findings)
    assert 'acceleration' not in failed(findings)
    assert findings['jerk'].at == pytest.approx(seconds, abs=0.41)


def test_after_a_stop_the_acceleration_counts_as_none(smooth, outcomes):
    drive, index = smooth.copy(), smooth.at(0.4)
    level = FallbackLevel.STOP
    drive.decisions[index] = drive.decisions[index]._replace(level=level, halted=True)
    found = outcomes(drive)['jerk']
    # It speeds up by more there than it may at once.
    assert found.outcome is FAILED
    assert found.at == pytest.approx(0.6, abs=0.01)


@pytest.fixture(scope='module')
def upright():
    """A drive that keeps a limit of lateral acceleration."""
    return drive_case(**{'robot.max_lateral_acceleration': 1.0})


@pytest.mark.parametrize('ours', [True, False])
@pytest.mark.parametrize('sign', [1.0, -1.0])
def test_a_bend_that_is_too_fast_is_caught(upright, outcomes, ours, sign):
    drive = upright.copy() if ours else upright.without_node()
    drive.parameters = upright.parameters
    drive.commands[drive.at(4.0)].twist = np.array([-sign, 1.05])
    after = outcomes(drive)['lateral_acceleration']
    assert after.outcome is CheckOutcome.FAILED
    assert after.worst == pytest.approx(1.05)
    assert after.at == pytest.approx(4.0, abs=0.21)


def test_bends_within_the_limit_pass(upright, outcomes):
    found = outcomes(upright)['lateral_acceleration']
    assert found.outcome is PASSED
    assert 0.9 < found.worst <= found.limit == 1.0


def test_without_that_limit_it_is_not_checked(gentle, outcomes):
    assert outcomes(gentle)['lateral_acceleration'].outcome is CheckOutcome.SKIPPED


@pytest.fixture(scope='module')
def steered():
    """A car that changes lanes, and brakes to rest."""
    return drive_case('lane_change', rest=3.0)


def test_a_car_is_steered_as_far_and_as_fast_as_it_can_be(steered, outcomes):
    findings = outcomes(steered)
    assert findings['steering'].outcome is PASSED
    assert 0.0 < findings['steering'].worst <= findings['steering'].limit == 1.066


@pytest.mark.parametrize(('change', 'sentence'), [(0.045, 'from the one before'), (1.1, '1.1')])
def test_steering_that_cannot_follow_is_caught(steered, outcomes, change, sentence):
    drive, robot = steered.copy(), drive_settings(steered).robot
    index = drive.at(4.0)
    speed, steering = robot.controls(drive.commands[index].twist)
    drive.commands[index].twist = robot.twist(np.array([speed, steering + change]))
    findings = outcomes(drive)
    assert 'steering' in failed(findings)
    assert sentence in findings['steering'].sentence
    assert findings['steering'].at == pytest.approx(4.0, abs=0.11)


def test_a_robot_that_is_not_steered_has_no_such_check(gentle, outcomes):
    assert 'not steered' in outcomes(gentle)['steering'].sentence


@pytest.mark.parametrize('seconds', [0.1, 20.0])
def test_a_car_is_steered_as_far_as_the_parameters_in_force_allow(steered, outcomes, seconds):
    drive = steered.copy()
    less = {**drive.parameters, 'robot.max_steering_angle': 1e-3}
    drive.restarts = [(START + round(seconds * SECOND), less)]
    assert ('steering' in failed(outcomes(drive))) == (seconds < 1.0)
