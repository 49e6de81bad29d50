"""The audit of the promise: a stop that is clear of all that may come, after each command."""

import math
from dataclasses import replace

import numpy as np
import pytest
from bag_messages import cloud, grid
from drives import AGAIN, LATENCY, SECOND, START, drive_settings

from cmpsp_ros.bags.audit import CheckOutcome
from cmpsp_ros.bags.audit.legs import Commands
from cmpsp_ros.bags.audit.promise_checks import _stop, _stops
from cmpsp_ros.bags.decision_record import decision_message
from cmpsp_ros.bags.runs.odometry import arc_steps
from cmpsp_ros.bags.runs.run import Planned
from cmpsp_ros.guidance.messages import Track
from cmpsp_ros.robots.motion import arc_ends
from cmpsp_ros.sensing import REMEMBERED

PASSED, FAILED, SKIPPED, NOT_JUDGED = CheckOutcome


def beside(drive, seconds, distance, speed=0.0):
    """An obstacle to the left of the robot at a time, which comes at it; seen then alone."""
    stamp = START + round(seconds * SECOND)
    x, y, heading = next(each.pose for each in drive.odometry if each.stamp == stamp)
    out = np.array([-math.sin(heading), math.cos(heading)])
    place = np.array([x, y]) + distance * out
    drive.obstacles = [(stamp, [(7, *place, *(-speed * out), 0.3)])]
    return drive


def test_what_is_too_far_to_reach_the_robot_is_no_matter(drive, outcomes):
    found = outcomes(beside(drive, 4.0, 2.5))['promise']
    assert found.outcome is PASSED
    assert found.worst > 0.0
    assert 'moving obstacle 7' in found.sentence


def test_what_could_reach_the_robot_before_the_next_command_is_caught(drive, outcomes):
    found = outcomes(beside(drive, 4.0, 0.4, 1.6))['promise']
    assert found.outcome is FAILED
    assert found.at == pytest.approx(4.0, abs=0.3)
    assert 'moving obstacle 7 could be' in found.sentence


def ahead(drive, seconds, distance):
    """Stamp of a time, and a place and direction ahead of the robot then."""
    stamp = START + round(seconds * SECOND)
    x, y, heading = next(each.pose for each in drive.odometry if each.stamp == stamp)
    direction = np.array([math.cos(heading), math.sin(heading)])
    return stamp, np.array([x, y]) + distance * direction, direction


@pytest.mark.parametrize(
    ('speed', 'stddev', 'outcome'),
    [(2.5, 0.1, FAILED), (1.7, 0.2, PASSED)],
    ids=['faster than the limit', 'perhaps no faster'],
)
def test_one_that_was_seen_to_be_faster_than_the_limit_keeps_its_speed(
    drive, outcomes, speed, stddev, outcome
):
    stamp, place, direction = ahead(drive, 4.0, 1.05)
    comes = 7, *place, *(-speed * direction), 0.3, 0.0, stddev
    drive.obstacles = [(stamp, [comes]), (stamp + 1, [(7, 50.0, 50.0, 0.0, 0.0, 0.3)])]
    found = outcomes(drive)['promise']
    assert found.outcome is outcome
    assert 'moving obstacle 7' in found.sentence


@pytest.mark.parametrize(
    ('until', 'outcome'), [(4.3, PASSED), (4.5, FAILED), (None, FAILED)],
    ids=['seen to be gone', 'between two scans', 'without decisions'],
)  # fmt: skip
def test_people_count_between_scans_as_long_as_decisions_used_them(drive, outcomes, until, outcome):
    stamp, place, direction = ahead(drive, 4.0, 1.75)
    person = Track(Track.SEEN + 1, stamp, 0.3, *place.tolist(), *(-1.5 * direction).tolist())
    drive.obstacles = [(stamp, [(person.id, *place, person.vx, person.vy, 0.3)])]
    first, last = drive.at(4.0), drive.at(until or 4.0)
    for k in range(first, last):
        drive.decisions[k] = drive.decisions[k]._replace(tracks=(person,))
    drive.decisions = drive.decisions if until else []
    findings = outcomes(drive)
    found = findings['promise']
    assert found.outcome is outcome
    assert (findings['moving'].outcome is FAILED) == (until == 4.5)
    assert found.at == pytest.approx(4.4 if outcome is FAILED else 4.2)


@pytest.mark.parametrize(
    ('distance', 'speed', 'outcome'),
    [(-1.5, -1.5, PASSED), (-1.5, 1.5, FAILED), (1.5, -1.5, FAILED)],
    ids=['leaves behind', 'comes from behind', 'ahead'],
)
def test_a_robot_may_leave_somebody_out_of_sight(drive, outcomes, distance, speed, outcome):
    stamp, place, direction = ahead(drive, 4.0, distance)
    drive.obstacles = [(stamp, [(7, *place, *(speed * direction), 0.3, 0.4, 0.3)])]
    assert outcomes(drive)['promise'].outcome is outcome


@pytest.mark.parametrize(('limit', 'outcome'), [(0.0, PASSED), (1.6, PASSED), (20.0, FAILED)])
def test_the_limit_of_acceleration_is_that_of_the_parameters(drive, outcomes, limit, outcome):
    drive.parameters['people.max_acceleration'] = limit
    assert outcomes(beside(drive, 4.0, 0.4))['promise'].outcome is outcome


@pytest.mark.parametrize(('fraction', 'outcome'), [(1.0, SKIPPED), (0.9, FAILED)])
def test_a_stop_as_hard_as_the_wheels_can_may_turn_as_promised(drive, outcomes, fraction, outcome):
    beside(drive, 4.0, 0.4, 1.6)
    robot, first, change = drive_settings(drive).robot, drive.at(4.0), 4.0
    drive.parameters['robot.max_wheel_acceleration'] = change / drive.parameters['control_period']
    fastest = np.abs(robot.wheel_speeds(drive.commands[first - 1].twist)).max()
    for each in drive.commands[first:]:
        fastest = max(fastest - fraction * change, 0.0)
        # The plan that was braked along bends to the other side.
        each.twist = robot.twist(np.array([0.7, 1.0]) * fastest)
    assert outcomes(drive)['promise'].outcome is outcome


@pytest.mark.parametrize(('turn_rate', 'outcome'), [(0.0, FAILED), (20.0, PASSED)])
def test_a_stop_bends_with_each_period_as_the_plan_does(drive, outcomes, turn_rate, outcome):
    """A robot that is slowed down to half of its plan turns no later for it."""
    k, period, change = drive.at(4.0), drive.parameters['control_period'], 4.0
    drive.parameters['people.max_acceleration'] = 0.0
    drive.parameters['robot.max_wheel_acceleration'] = change / period
    for each in drive.commands[k - 1 : k + 1]:
        each.twist = np.array([1.0, 0.0])
    near = 0.3 + drive_settings(drive).robot_radius + 1.5 * period
    stamp, place, _ = ahead(drive, 4.0, near)
    stands, gone = (7, *place, 0.0, 0.0, 0.3), (7, 50.0, 50.0, 0.0, 0.0, 0.3)
    drive.obstacles = [(stamp, [stands]), (stamp + 1, [gone])]
    poses = drive.decisions[k].plan.poses.copy()
    for i, turns in enumerate([0.0, *[turn_rate] * (len(poses) - 2)]):
        twist = np.array([[2.0, turns]])
        poses[i + 1] = arc_ends(poses[i : i + 1], twist, np.array([period]))[0]
    plan = drive.decisions[k].plan._replace(poses=poses)
    drive.decisions[k] = drive.decisions[k]._replace(plan=plan)
    assert outcomes(drive)['promise'].outcome is outcome


@pytest.mark.parametrize('away', [2.5, -2.5], ids=['left', 'right'])
@pytest.mark.parametrize('is_near', [0, 1], ids=['before', 'after'])
def test_after_time_has_jumped_back_other_obstacles_are_there(drive, outcomes, is_near, away):
    places = [beside(drive.copy(), 4.0, *each).obstacles[0] for each in ((away,), (0.4, 1.6))]
    drive = drive.again()
    drive.obstacles = [places[1 - is_near]]
    stamp, *said = places[is_near]
    drive.records = [('/moving_obstacles', stamp + AGAIN, cloud(stamp, *said))]
    assert outcomes(drive)['promise'].outcome is FAILED


@pytest.mark.parametrize('lasts', [0.5, 1.0, 1.5])
def test_the_last_interval_of_a_plan_is_shorter_or_longer_than_a_period(drive, lasts):
    """It is driven as fast as the others, whose speed falls by a fifth a period."""
    settings = drive_settings(drive)
    period, robot = settings.control_period, settings.robot
    change = 0.2 * np.abs(robot.wheel_speeds(np.array([1.0, 0.0]))).max()
    robot = replace(robot, max_wheel_acceleration=change / period)
    times = np.array([0.0, 1.0, 2.0, 2.0 + lasts]) * period
    poses = np.column_stack([times, np.zeros((4, 2))])
    plan = Planned(0, np.round(times * SECOND).astype(np.int64), poses)
    stamps = np.array([0])
    commands = Commands(stamps, stamps, np.array([[1.0, 0.0]]), stamped=True)
    stop = [*_stops(replace(settings, robot=robot), np.zeros(3), commands, 0, plan)][1]
    assert stop[1][-1] == pytest.approx([3.0 * period, 0.0, 0.0])


@pytest.mark.parametrize(
    ('wheels', 'slowed'),
    [((13.2, 8.3), 0.711), ((8.3, 10.9), 0.541), ((-2.0, 9.0), 0.656)],
    ids=['turns the other way', 'goes straight on', 'turns one wheel round'],
)
def test_a_stop_takes_what_every_wheel_can_do(drive, wheels, slowed):
    settings = drive_settings(drive)
    robot = settings.robot
    change, period = 5.0, settings.control_period
    limited = replace(robot, max_wheel_acceleration=change / period)
    twists = np.array([robot.twist(np.array(each)) for each in ((8.3, 10.9), wheels)])
    _, poses = _stop(replace(settings, robot=limited), np.zeros(3), twists, period)
    twist = arc_steps(poses[20:21], poses[21:22])[0, ::2] / 0.01
    assert twist == pytest.approx(slowed * twists[1], rel=1e-2)


def test_obstacles_that_decisions_used_and_the_bag_lacks_leave_it_open(drive, outcomes):
    beside(drive, 4.0, 2.5)
    used, lost = drive.decisions[20], drive.obstacles[0][1][0]
    drive.decisions[20] = used._replace(tracks=(Track(8, used.stamp, 0.3, *lost[1:5]),))
    found = outcomes(drive)['promise']
    assert found.outcome is NOT_JUDGED
    assert 'such as 8' in found.sentence


SCANNER = {
    'sensors.names': ['front'],
    'sensors.front.topic': 'scan',
    'sensors.front.frame_id': 'base_scan',
}


def in_a_grid_of(drive, value, moves_from=4.0):
    """The drive in a grid whose cells all have a value, where something moves from some time on."""
    drive.parameters |= SCANNER
    drive.sightings = [(START, np.full((900, 900), value, np.int8), (-20.0, -20.0))]
    first = drive.at(moves_from)
    if first < len(drive.decisions):
        used = drive.decisions[first]
        track = Track(8, used.stamp, 0.3, 50.0, 50.0, 0.0, 0.0)
        drive.decisions[first] = used._replace(tracks=(track,))
    return drive


def test_fast_commands_out_of_sight_are_caught_from_when_anything_moves(drive, outcomes):
    found = outcomes(in_a_grid_of(drive, REMEMBERED))['unseen']
    assert found.outcome is FAILED
    assert found.at >= 4.0
    assert found.worst > 0.5


def test_slow_commands_out_of_sight_pass(drive, outcomes):
    for each in in_a_grid_of(drive, REMEMBERED).commands:
        each.twist = each.twist * 0.05 / max(abs(each.twist[0]), 0.05)
    assert outcomes(drive)['unseen'].outcome is PASSED


@pytest.mark.parametrize(
    ('value', 'sight', 'moves_from', 'outcome'),
    [
        (0, 'stationary', 4.0, PASSED),
        (REMEMBERED, 'off', 4.0, SKIPPED),
        (REMEMBERED, 'stationary', 10.0, SKIPPED),
    ],
    ids=['in sight', 'not asked for', 'before anything moves'],
)
def test_other_fast_commands_are_not(drive, outcomes, value, sight, moves_from, outcome):
    drive.parameters['safety.stop_within_sight'] = sight
    assert outcomes(in_a_grid_of(drive, value, moves_from))['unseen'].outcome is outcome


@pytest.mark.parametrize(
    ('since', 'value', 'outcome'),
    [(99.0, 0, NOT_JUDGED), (6.0, 0, NOT_JUDGED), (6.0, REMEMBERED, FAILED), (3.0, 0, PASSED)],
    ids=['none', 'some', 'some, and fast out of sight', 'before anything moves'],
)
def test_commands_without_a_grid_of_what_is_in_sight_leave_it_open(
    drive, outcomes, since, value, outcome
):
    drive = in_a_grid_of(drive, value)
    late = round(since * SECOND)
    drive.sightings = [(at + late, *said) for at, *said in drive.sightings if since < 99.0]
    found = outcomes(drive)['unseen']
    assert found.outcome is outcome
    if outcome is NOT_JUDGED:
        assert '/guidance/sighting' in found.sentence


def test_what_moves_after_time_has_jumped_back_had_not_moved_before(drive, outcomes):
    drive = in_a_grid_of(drive, REMEMBERED, 99.0)
    decisions, again = drive.decisions, drive.again()
    again.decisions = decisions
    for each in decisions:
        tracks = (Track(8, each.stamp, 0.3, 50.0, 50.0, 0.0, 0.0),)
        later = each._replace(run=1, tracks=tracks)
        said = decision_message(later, '/guidance')
        again.records.append(('/guidance/decision', each.stamp + LATENCY + AGAIN, said))
    stamp, cells, *origin = drive.sightings[0]
    visible = grid(stamp, 0 * cells, *origin)
    again.records.append(('/guidance/sighting', stamp + LATENCY + AGAIN, visible))
    assert outcomes(again)['unseen'].outcome is PASSED


@pytest.mark.parametrize('lost', [False, True])
def test_moving_obstacles_that_the_bag_lacks_leave_their_clearance_open(drive, outcomes, lost):
    beside(drive, 4.0, 2.5)
    used, (_, *place) = drive.decisions[20], drive.obstacles[0][1][0]
    number, stamp = (8, used.stamp) if lost else (7, drive.obstacles[0][0])
    drive.decisions[20] = used._replace(tracks=(Track(number, stamp, 0.3, *place[:4]),))
    found = outcomes(drive)['moving']
    assert found.outcome is (NOT_JUDGED if lost else PASSED)
    assert ('such as 8' in found.sentence) == lost
