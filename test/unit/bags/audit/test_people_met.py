"""The audit of what is not told: people and crates, by the simulator and by sensors."""

import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from bag_messages import cloud, header, make
from drives import AGAIN, SECOND, START, drive_settings
from test_promise import SCANNER

from cmpsp_ros.bags.audit import CheckOutcome
from cmpsp_ros.bags.runs.sensor_clearance import EXACT, Encounter, driven_into
from cmpsp_ros.parameters import TABLE, laser_settings
from cmpsp_ros.sensing import stamp_of
from cmpsp_ros.simulator import Laser, Motion, discs_of, edges_of
from cmpsp_ros.world.obstacles import Obstacle

PASSED, FAILED, SKIPPED, NOT_JUDGED = CheckOutcome


def beside(drive, distance, begin=3.0, end=5.0, else_at=50.0):
    """Somebody who keeps at a distance to the left of the robot for a while, else far away."""
    for each in drive.odometry:
        x, y, heading = each.pose
        away = distance if begin <= (each.stamp - START) / 1e9 <= end else else_at
        place = x - away * math.sin(heading), y + away * math.cos(heading)
        drive.people.append((each.stamp, [(0, *place, 0.0, 0.0, 0.25)]))
    return drive


@pytest.mark.parametrize(('distance', 'outcome'), [(0.6, PASSED), (0.2, FAILED)])
def test_people_are_judged_by_their_true_positions(drive, outcomes, distance, outcome):
    found = outcomes(beside(drive, distance))['people']
    assert found.outcome is outcome
    assert found.worst == pytest.approx(distance - 0.25, abs=0.03)
    assert 'person 0' in found.sentence


@pytest.mark.parametrize('away', [50.0, -50.0], ids=['left', 'right'])
@pytest.mark.parametrize('is_met', [0, 1], ids=['before', 'after'])
def test_after_time_has_jumped_back_people_are_others(drive, outcomes, is_met, away):
    """The same instants come again, and the robot meets somebody in one of both legs only."""
    met = beside(drive.copy(), 0.2, else_at=away).people
    unmet = beside(drive.copy(), away, else_at=away).people
    legs = (unmet, met) if is_met else (met, unmet)
    drive = drive.again()
    drive.people = legs[0]
    drive.records = [('/sim/people', t + AGAIN, cloud(t, *said)) for t, *said in legs[1]]
    found = outcomes(drive)['people']
    assert found.outcome is FAILED
    assert found.worst == pytest.approx(-0.05, abs=0.03)


@pytest.mark.parametrize(('distance', 'outcome'), [(3.9, FAILED), (4.3, PASSED), (9.0, SKIPPED)])
def test_people_near_the_end_of_a_long_robot_are_judged(drive, outcomes, distance, outcome):
    sides = [[0.05, -0.05], [0.05, 3.7], [-0.05, 3.7], [-0.05, -0.05]]
    drive.parameters['robot.footprint'] = str(sides)
    assert outcomes(beside(drive, distance))['people'].outcome is outcome


def test_who_walks_into_a_robot_at_rest_is_not_driven_into(drive, outcomes):
    found = outcomes(beside(drive, 0.1, 10.2, 11.0))['people']
    assert found.outcome is SKIPPED
    assert 'stands while anything moves' in found.sentence


def test_a_robot_that_was_run_into_at_rest_may_leave_and_not_drive_on():
    clearance = np.array([0.1, -0.02, -0.015, -0.01, -0.03, 0.2, -0.01])
    stands = np.array([True, True, False, False, False, False, False])
    stamps, inf = np.arange(7), math.inf
    met = [Encounter('ann', stamps[k], clearance[k], stands[k]) for k in (slice(3, 7), slice(3))]
    kept = np.concatenate([each for _, each in driven_into(met)])
    np.testing.assert_array_equal(kept, [inf, inf, 0.005, 0.01, -0.01, 0.2, -0.01])


@pytest.mark.parametrize('is_known', [False, True])
def test_what_sensors_see_of_people_is_no_obstacle(drive, outcomes, is_known):
    drive.parameters |= {**SCANNER, 'robot.radius': 0.06}
    index = next(k for k, each in enumerate(drive.odometry) if each.stamp >= START + 4 * SECOND)
    place, stamp = drive.odometry[index].pose[:2], drive.odometry[index].stamp
    free = np.zeros((900, 900), np.int8)
    free[0, 0] = 100
    column, row = np.floor((place + 20.0) / 0.05).astype(int)
    cells = free.copy()
    cells[row - 1 : row + 2, column - 1 : column + 2] = 100
    around = [(-1, free), (0, cells), (1, free)]
    drive.sightings = [(stamp + k * SECOND // 5, each, (-20.0, -20.0)) for k, each in around]
    stamps = [each.stamp for each in drive.odometry if abs(each.stamp - stamp) < SECOND]
    drive.people = [(each, [(0, *place, 0.0, 0.0, 0.25)]) for each in stamps if is_known]
    assert (outcomes(drive)['obstacles'].outcome is FAILED) == (not is_known)


def test_people_who_are_not_in_the_bag_leave_it_open(drive, outcomes):
    drive.sim = {'sim.people.names': ['ann'], 'sim.people.ann.position': [1.0, 2.0]}
    found = outcomes(drive)['people']
    assert found.outcome is NOT_JUDGED
    assert '/sim/people' in found.sentence


def test_who_is_far_away_is_no_matter(drive, outcomes):
    found = outcomes(beside(drive, 5.0))['people']
    assert found.outcome is SKIPPED
    assert 'Nobody comes near' in found.sentence


@pytest.mark.parametrize(('away', 'outcome'), [(0.0, FAILED), (5.0, PASSED), (None, NOT_JUDGED)])
def test_what_only_the_simulator_knows_of_is_judged_by_its_parameters(
    drive, outcomes, away, outcome
):
    drive.parameters |= SCANNER
    if away is not None:
        x, y, _ = drive.odometry[len(drive.odometry) // 2].pose
        drive.sim = {'sim.obstacles.names': ['crate'], 'sim.obstacles.crate.radius': 0.1}
        drive.sim['sim.obstacles.crate.center'] = [float(x) - away, float(y) + away]
    assert outcomes(drive)['obstacles'].outcome is outcome


def scan_of(scan, scanner):
    """A scan of the simulator as a message."""
    angles = scanner.angle_min, scanner.angle_max, scanner.angle_increment
    rest = scanner.time_increment, 1.0 / scanner.rate, scanner.range_min, scanner.range_max
    ranges = scan.ranges.astype(np.float32)
    head = header(START + scan.stamp_ns, 'base_scan')
    return make('sensor_msgs/msg/LaserScan', head, *angles, *rest, ranges, np.zeros(0, np.float32))


def scanned(drive, *crates):
    """Record scans of the known obstacles, and of crates that only a scanner shows."""
    shapes = (*drive_settings(drive).obstacles, *crates)
    drive.parameters |= {**SCANNER, 'robot.radius': 0.06}
    scanner = laser_settings(TABLE.resolve({'sim.scan.rate': 10.0}))
    laser, around = Laser(scanner, 0), (edges_of(shapes), discs_of(shapes))
    for one, other in pairwise(drive.odometry):
        seconds = (other.stamp - one.stamp) / 1e9
        way, turn = math.dist(other.pose[:2], one.pose[:2]), other.pose[2] - one.pose[2]
        twist = np.array([way, math.remainder(turn, math.tau)]) / seconds
        laser.note(Motion(one.stamp - START, one.pose, np.zeros(2), twist))
        while laser.is_due(other.stamp - START):
            drive.scans.append((other.stamp, scan_of(laser.scan(*around), scanner)))
    return drive


@pytest.mark.parametrize(
    ('away', 'outcome'), [(0.0, FAILED), (0.1, FAILED), (0.6, PASSED), (None, PASSED)]
)
def test_crates_that_only_scans_show_count(drive, outcomes, away, outcome):
    x, y, heading = drive.odometry[len(drive.odometry) // 3].pose
    place = x - (away or 0.0) * math.sin(heading), y + (away or 0.0) * math.cos(heading)
    crates = () if away is None else (Obstacle('crate', place, 0.1),)
    assert outcomes(scanned(drive, *crates))['obstacles'].outcome is outcome


def test_a_time_without_scans_leaves_it_open(drive, outcomes):
    drive = scanned(drive)
    begin, end = START + 3 * SECOND, START + 6 * SECOND
    drive.scans = [each for each in drive.scans if not begin < each[0] < end]
    assert outcomes(drive)['obstacles'].outcome is not FAILED


REAR = {
    'sensors.names': ['front', 'rear'],
    'sensors.rear.topic': 'scan',
    'sensors.rear.frame_id': 'rear_scan',
}


@pytest.mark.parametrize(
    ('changes', 'said'),
    [
        ({'sensors.rear.topic': 'rear'}, 's): /rear is not in the bag.'),
        ({'sensors.rear.topic': 'odom'}, 's): found nav_msgs/msg/Odometry in /odom, wanted'),
        ({'sensors.rear.frame_id': 'elsewhere'}, "found 'base_scan', wanted 'elsewhere'"),
        ({}, 'Sensor rear shows nothing from 1.90 to 10.40 s (8.50 s)'),
    ],
)
def test_one_sensor_does_not_see_for_another(drive, outcomes, changes, said):
    drive = scanned(drive)
    drive.parameters |= REAR | changes
    for stamp, each in list(drive.scans):
        if stamp < START + 2 * SECOND:
            rear = header(stamp_of(each), 'rear_scan')
            drive.scans.append((stamp, replace(each, header=rear)))
    found = outcomes(drive)['obstacles']
    assert found.outcome is NOT_JUDGED
    assert said in found.sentence
    assert 'front' not in found.sentence


def test_what_the_node_saw_is_of_all_sensors(drive, outcomes):
    drive = scanned(drive)
    drive.parameters |= REAR
    cells = np.zeros((40, 40), np.int8)
    cells[0, 0] = 100
    drive.sightings = [
        (each.stamp, cells, (float(each.pose[0]) + 3.0, float(each.pose[1])))
        for each in drive.odometry[::5]
    ]
    assert outcomes(drive)['obstacles'].outcome is PASSED


def test_a_frame_that_is_not_the_sensor_s_is_the_reason(drive, outcomes):
    drive = scanned(drive)
    drive.parameters['sensors.front.frame_id'] = 'elsewhere'
    found = outcomes(drive)['obstacles']
    assert found.outcome is NOT_JUDGED
    assert "found 'base_scan', wanted 'elsewhere' (sensors.front.frame_id)" in found.sentence


def test_limits_are_lower_by_what_scans_may_be_off(drive, outcomes):
    x, y, heading = drive.odometry[len(drive.odometry) // 3].pose
    crate = Obstacle('crate', (x - 0.15 * math.sin(heading), y + 0.15 * math.cos(heading)), 0.1)
    found = outcomes(scanned(drive, crate))['obstacles']
    assert found.outcome is NOT_JUDGED
    assert found.limit == -EXACT


@pytest.mark.parametrize(('last', 'outcome'), [(5.75, FAILED), (0.5, NOT_JUDGED)])
def test_crates_are_still_there_after_the_last_scan(drive, outcomes, last, outcome):
    """It is hit after 6 s; the first scans do not show it yet."""
    x, y, _ = next(each.pose for each in drive.odometry if each.stamp == START + 6 * SECOND)
    drive = scanned(drive.until(6.2), Obstacle('crate', (x, y), 0.1))
    drive.scans = [each for each in drive.scans if each[0] <= START + last * SECOND]
    assert outcomes(drive)['obstacles'].outcome is outcome
