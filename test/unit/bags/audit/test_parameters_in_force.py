"""Every part of a recording is judged by the parameters that were in force there."""

import numpy as np
import pytest
from bag_messages import parameter_event
from drives import AGAIN, SECOND, START, failed

from cmpsp_ros.bags.audit import CheckOutcome
from cmpsp_ros.guidance import FallbackLevel

PASSED, FAILED, SKIPPED, _ = CheckOutcome
CENTER = 'obstacles.a.center'
FAR = [90.0, 90.0]


def changed(drive, leg, seconds, key, value):
    """The drive twice, with a live change in the first or in the second."""
    drive, stamp = drive.again(), START + round(seconds * SECOND)
    event = parameter_event('/guidance', {key: value}, stamp)
    drive.records = [('/parameter_events', stamp + leg * AGAIN, event)]
    return drive


def place(drive, seconds):
    return drive.odometry[round(50 * seconds)].pose[:2].tolist()


def test_an_obstacle_that_came_before_time_jumped_back_is_there_from_its_new_beginning(
    drive, outcomes
):
    drive = changed(drive, 0, 5.0, CENTER, place(drive, 3.0))
    found = outcomes(drive)
    assert {'obstacles', 'commanded'} <= failed(found)
    assert found['obstacles'].at == pytest.approx(3.0, abs=0.1)


def test_an_obstacle_that_goes_after_time_jumped_back_was_there_before(drive, outcomes):
    drive.parameters[CENTER] = place(drive, 3.0)
    assert {'obstacles', 'commanded'} <= failed(outcomes(changed(drive, 1, 1.0, CENTER, FAR)))


def test_an_obstacle_that_comes_after_time_jumped_back_was_not_there_before(drive, outcomes):
    drive = changed(drive, 1, 9.9, CENTER, place(drive, 3.0))
    assert outcomes(drive)['obstacles'].outcome is PASSED


@pytest.mark.parametrize(('leg', 'exceeds'), [(0, True), (1, False)])
def test_a_limit_holds_for_the_commands_after_it(drive, outcomes, leg, exceeds):
    drive = changed(drive, leg, 9.9, 'robot.max_wheel_speed', 30.0)
    assert ('wheel_limits' in failed(outcomes(drive))) == exceeds


@pytest.mark.parametrize('offset', [0, 5 * SECOND - START], ids=['wall clock', 'simulation time'])
def test_a_node_started_anew_is_judged_by_its_new_parameters_in_any_time(drive, outcomes, offset):
    drive.restarts = [(START + SECOND, {**drive.parameters, CENTER: place(drive, 6.0)})]
    drive.stamped, drive.decisions = True, []
    for each in (*drive.odometry, *drive.commands):
        each.stamp += offset
    found = outcomes(drive)
    assert {'obstacles', 'commanded'} <= failed(found)
    assert found['obstacles'].at == pytest.approx(6.0, abs=0.1)


def test_obstacles_of_the_simulator_are_those_of_their_part(drive, outcomes):
    key = 'sim.obstacles.crate'
    drive.sim = {'sim.obstacles.names': ['crate'], f'{key}.radius': 0.2}
    drive.sim[f'{key}.center'] = place(drive, 3.0)
    twice, stamp = drive.again(), START + SECOND
    event = parameter_event('/sim', {f'{key}.center': FAR}, stamp)
    twice.records = [('/parameter_events', stamp + AGAIN, event)]
    assert 'obstacles' in failed(outcomes(twice))


def restarted(drive, seconds, **keys):
    """The node is started anew with other parameters, whose dots are written as ``__``."""
    values = {key.replace('__', '.'): value for key, value in keys.items()}
    drive.restarts = [(START + round(seconds * SECOND), {**drive.parameters, **values})]
    return drive


@pytest.mark.parametrize(
    ('check', 'limits'),
    [
        ('acceleration', {'robot__max_wheel_acceleration': 1.0}),
        ('jerk', {'robot__max_wheel_acceleration': 1e3, 'robot__max_wheel_jerk': 1.0}),
        ('lateral_acceleration', {'robot__max_lateral_acceleration': 0.01}),
    ],
)
@pytest.mark.parametrize(('seconds', 'exceeds'), [(0.1, True), (10.1, False)])
def test_a_limit_of_a_node_started_anew_holds_from_then_on(
    drive, outcomes, check, limits, seconds, exceeds
):
    finding = outcomes(restarted(drive, seconds, **limits))[check]
    assert finding.outcome is (FAILED if exceeds else PASSED)
    assert finding.at >= seconds


@pytest.mark.parametrize(('seconds', 'outcome'), [(1.0, FAILED), (6.0, PASSED)])
def test_odometry_of_a_node_started_anew_may_no_longer_jump(drive, outcomes, seconds, outcome):
    jumped = drive.odometry[250]
    jumped.pose = np.add(jumped.pose, [0.4, 0.0, 0.0])
    drive.parameters['safety.max_odom_jump'] = 0.0
    drive = restarted(drive, seconds, safety__max_odom_jump=0.1)
    assert outcomes(drive)['jumps'].outcome is outcome


@pytest.mark.parametrize(('first', 'then', 'outcome'), [(5.0, 0.5, FAILED), (0.5, 5.0, PASSED)])
def test_odometry_may_be_as_old_as_the_parameters_in_force_allow(
    drive, outcomes, first, then, outcome
):
    drive.decisions, drive.stamped = [], True
    drive.parameters['odom_timeout'] = first
    for each in drive.commands:
        each.received += SECOND * (each.stamp > START + 6 * SECOND)
    drive = restarted(drive, 5.0, odom_timeout=then)
    assert outcomes(drive)['age'].outcome is outcome


@pytest.mark.parametrize(('first', 'then', 'outcome'), [(5.0, 0.5, FAILED), (0.5, 5.0, PASSED)])
def test_odometry_may_be_silent_for_as_long_as_the_parameters_in_force_allow(
    drive, outcomes, first, then, outcome
):
    drive.decisions, drive.parameters['odom_timeout'] = [], first
    low, high = START + 6 * SECOND, START + 7 * SECOND
    drive.odometry = [each for each in drive.odometry if not low < each.stamp < high]
    drive = restarted(drive, 5.0, odom_timeout=then)
    assert outcomes(drive)['silence'].outcome is outcome


@pytest.mark.parametrize(('first', 'then', 'outcome'), [(9, 1, FAILED), (1, 9, PASSED)])
def test_old_plans_are_followed_for_as_long_as_the_parameters_in_force_allow(
    drive, outcomes, first, then, outcome
):
    drive.parameters['failure_tolerance'] = first
    for k in range(30, 33):
        level = FallbackLevel.PREVIOUS_PLAN
        drive.decisions[k] = drive.decisions[k]._replace(level=level, failures=1)
    drive = restarted(drive, 5.0, failure_tolerance=then)
    assert outcomes(drive)['previous_plan'].outcome is outcome


@pytest.mark.parametrize(('seconds', 'outcome'), [(0.1, FAILED), (9.5, PASSED)])
def test_a_margin_is_asked_for_while_it_is_in_force(drive, outcomes, seconds, outcome):
    """The robot comes nearest to an obstacle, to 0.063 m, after 8.5 s."""
    drive.parameters['safety.margin'] = 0.01
    drive.changes = [(START + round(seconds * SECOND), 'safety.margin', 0.1)]
    found = outcomes(drive)['margin']
    assert found.outcome is outcome
    assert found.worst == pytest.approx(0.063, abs=1e-3)
    assert found.limit == (0.1 if outcome is FAILED else 0.01)


@pytest.mark.parametrize(('seconds', 'outcome'), [(2.0, FAILED), (6.0, PASSED)])
def test_commands_are_obeyed_as_the_parameters_in_force_ask(drive, outcomes, seconds, outcome):
    drive.parameters['robot.max_wheel_speed'] = 0.0
    index = drive.at(4.0)
    drive.commands[index].twist = np.add(drive.commands[index].twist, [0.0, 4.0])
    drive = restarted(drive, seconds, robot__max_wheel_speed=51.0)
    assert outcomes(drive)['obeyed'].outcome is outcome
