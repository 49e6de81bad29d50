"""Every part of a recording is judged by the parameters that were in force there."""

import pytest
from bag_messages import parameter_event
from drives import AGAIN, SECOND, START, failed

from cmpsp_ros.bags.audit import CheckOutcome

PASSED = CheckOutcome.PASSED
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
