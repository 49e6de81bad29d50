"""The audit of people: judged by where the simulator truly had them."""

import math

import numpy as np
import pytest
from drives import SECOND, START
from test_promise import SCANNER

from cmpsp_ros.bags.audit import CheckOutcome
from cmpsp_ros.bags.runs.sensor_clearance import Encounter, driven_into

PASSED, FAILED, SKIPPED, NOT_JUDGED = CheckOutcome


def beside(drive, distance, begin=3.0, end=5.0):
    """Somebody who keeps at a distance to the left of the robot for a while, and of another."""
    for each in drive.odometry:
        if begin <= (each.stamp - START) / 1e9 <= end:
            x, y, heading = each.pose
            place = x - distance * math.sin(heading), y + distance * math.cos(heading)
            drive.people.append((each.stamp, [(0, *place, 0.0, 0.0, 0.25)]))
    return drive


@pytest.mark.parametrize(('distance', 'outcome'), [(0.6, PASSED), (0.2, FAILED)])
def test_people_are_judged_by_their_true_positions(drive, outcomes, distance, outcome):
    found = outcomes(beside(drive, distance))['people']
    assert found.outcome is outcome
    assert found.worst == pytest.approx(distance - 0.25, abs=0.03)
    assert 'person 0' in found.sentence


def test_who_walks_into_a_robot_at_rest_is_not_driven_into(drive, outcomes):
    last = drive.odometry[-1].pose
    place = np.add(last[:2], [0.1, 0.0])
    stamps = [each.stamp for each in drive.odometry if (each.stamp - START) / 1e9 > 10.2]
    drive.people = [(each, [(0, *place, 0.0, 0.0, 0.25)]) for each in stamps]
    found = outcomes(drive)['people']
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
