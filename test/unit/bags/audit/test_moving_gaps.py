"""The audit of all that moves beside the robot, where the bag does not have all of it."""

import math
from dataclasses import replace

import numpy as np
import pytest
from drives import AGAIN, SECOND, START
from test_people_met import beside, scanned

from cmpsp_ros.bags.audit import CheckOutcome, Sources
from cmpsp_ros.world.obstacles import Obstacle

PASSED, FAILED, SKIPPED, NOT_JUDGED = CheckOutcome


def with_other(drive, away=2.0, begin=0.0, end=10.4):
    """Another robot, which keeps at a distance [m] and is recorded for a while."""
    drive.parameters |= {'others.namespaces': ['/r2'], 'others.radius': 0.3}
    drive.other = [
        replace(each, pose=np.add(each.pose, [0.0, -away, 0.0]))
        for each in drive.odometry
        if begin <= (each.stamp - START) / SECOND <= end
    ]
    return drive


@pytest.mark.parametrize(('away', 'outcome'), [(2.0, PASSED), (0.2, FAILED)])
def test_another_robot_is_judged_by_its_path(drive, outcomes, away, outcome):
    found = outcomes(with_other(drive, away))['others']
    assert found.outcome is outcome
    assert found.worst == pytest.approx(away - 0.3, abs=0.01)


@pytest.mark.parametrize('is_near', [0, 1], ids=['before', 'after'])
def test_after_time_has_jumped_back_another_robot_is_elsewhere(drive, outcomes, is_near):
    ways = [with_other(drive.copy(), away).other for away in (2.0, 0.2)]
    drive = with_other(drive).again()
    later = [replace(each, received=each.received + AGAIN) for each in ways[is_near]]
    drive.other = ways[1 - is_near] + later
    found = outcomes(drive)['others']
    assert found.outcome is FAILED
    assert found.worst == pytest.approx(-0.1, abs=0.01)


@pytest.mark.parametrize(
    ('begin', 'end', 'lost'), [(0.0, 3.0, '3.00 to 10.40 s'), (2.0, 10.4, '0.00 to 2.00 s')]
)
def test_another_robot_that_is_recorded_for_a_part_leaves_the_rest_open(
    drive, outcomes, begin, end, lost
):
    found = outcomes(with_other(drive, 2.0, begin, end))['others']
    assert found.outcome is NOT_JUDGED
    assert f'The path of /r2 is not recorded from {lost}' in found.sentence


def test_another_robot_that_is_recorded_while_this_one_stands_leaves_the_rest_open(drive, outcomes):
    assert outcomes(with_other(drive, 2.0, 10.2))['others'].outcome is NOT_JUDGED


def test_another_robot_in_another_frame_is_not_judged(drive, outcomes):
    drive = with_other(drive)
    drive.other_frame_id = 'r2/odom'
    found = outcomes(drive)['others']
    assert found.outcome is NOT_JUDGED
    assert '/r2/odom' in found.sentence
    assert "in frame 'r2/odom', wanted 'odom'" in found.sentence


def test_another_robot_whose_path_is_not_finite_is_not_judged(drive, outcomes):
    drive = with_other(drive)
    drive.other[100] = replace(drive.other[100], pose=np.array([math.nan, 0.0, 0.0]))
    found = outcomes(drive)['others']
    assert found.outcome is NOT_JUDGED
    assert 'not finite' in found.sentence


def test_another_robot_that_is_not_recorded_is_not_judged(drive, outcomes):
    found = outcomes(with_other(drive, 2.0, 99.0))['others']
    assert found.outcome is NOT_JUDGED
    assert 'The path of /r2 is not known' in found.sentence


@pytest.mark.parametrize(
    ('begin', 'end', 'lost'), [(4.0, 6.0, '4.00 to 6.00 s'), (4.0, 99.0, '4.00 to 10.40 s')]
)
@pytest.mark.parametrize('away', [0.6, 9.0])
def test_people_who_are_not_recorded_for_a_while_leave_it_open(
    drive, outcomes, begin, end, lost, away
):
    drive = beside(drive, away, 3.0, 7.0)
    low, high = START + round(begin * SECOND), START + round(end * SECOND)
    drive.people = [each for each in drive.people if not low < each[0] < high]
    found = outcomes(drive)['people']
    assert found.outcome is NOT_JUDGED
    assert f'People are not recorded from {lost}' in found.sentence


def test_people_are_no_longer_where_they_were_before_a_hole(drive, outcomes):
    stamp = START + 4 * SECOND
    x, y, heading = next(each.pose for each in drive.odometry if each.stamp == stamp)
    drive = beside(drive, 9.0)
    drive.people = [each for each in drive.people if not stamp - 1 < each[0] < stamp + SECOND]
    ahead = x + 1.2 * math.cos(heading), y + 1.2 * math.sin(heading)
    drive.people.append((stamp, [(0, *ahead, 0.0, 0.0, 0.25)]))
    assert outcomes(drive)['people'].outcome is NOT_JUDGED


@pytest.mark.parametrize('preset', ['case3', None], ids=['frame known', 'frame not told'])
@pytest.mark.parametrize('refused', [1, 100])
def test_moving_obstacles_in_another_frame_leave_it_open(
    drive, outcomes, tmp_path, preset, refused
):
    known = tmp_path / 'robot.yaml'
    known.write_text(
        '/**:\n  ros__parameters:\n    control_period: 0.2\n    robot:\n'
        '      wheel_radius: 0.035\n      half_track: 0.055\n      max_wheel_speed: 51.0\n'
    )
    stamps = [each.stamp for each in drive.odometry[:100]]
    far = [(7, 50.0, 50.0, 0.0, 0.0, 0.3)]
    drive.obstacles = [(each, far, 'map') for each in stamps[:refused]]
    drive.obstacles += [(each, far) for each in stamps[refused:]]
    sources = Sources(params_file=preset or known)
    found = outcomes(drive.without_node(), sources)
    assert found['moving'].outcome is NOT_JUDGED
    said = f'{refused} of 100 messages in /moving_obstacles cannot be used'
    assert said in found['moving'].sentence
    assert "in frame 'map', wanted 'odom'" in found['moving'].sentence
    # With messages of another frame alone nothing would be known to move.
    if refused == 100:
        assert found['promise'].outcome is NOT_JUDGED
        assert said in found['promise'].sentence


def test_people_in_another_frame_leave_it_open(drive, outcomes):
    drive.people = [(each, rows, 'map') for each, rows in beside(drive, 0.2).people]
    found = outcomes(drive)['people']
    assert found.outcome is NOT_JUDGED
    assert '/sim/people cannot be used' in found.sentence


RADIUS = 'robot.radius'


def met_beside(drive, kind):
    """Something 0.15 m beside the outline of a point, from 4 to 6 s; no scan is of that time."""
    if kind == 'others':
        return with_other(drive, 0.45)
    if kind == 'obstacles':
        index = next(k for k, each in enumerate(drive.odometry) if each.stamp > START + 5 * SECOND)
        x, y, heading = drive.odometry[index].pose
        place = x - 0.25 * math.sin(heading), y + 0.25 * math.cos(heading)
        for each in drive.parameters['obstacles.names']:
            drive.parameters[f'obstacles.{each}.center'] = [90.0, 90.0]
        drive = scanned(drive, Obstacle('crate', place, 0.1))
        low, high = START + 3.5 * SECOND, START + 6.0 * SECOND
        drive.scans = [each for each in drive.scans if not low < each[0] < high]
        return drive
    drive = beside(drive, 0.4, 4.0, 6.0)
    if kind == 'moving':
        drive.obstacles, drive.people = drive.people, []
    return drive


@pytest.mark.parametrize(
    ('since', 'hits'),
    [(None, False), (0.1, True), (3.9, True), (8.0, False)],
    ids=['small', 'large from the start', 'large before they meet', 'large after they met'],
)
@pytest.mark.parametrize('kind', ['moving', 'people', 'others', 'obstacles'])
def test_all_that_is_met_is_judged_by_the_outline_of_that_time(drive, outcomes, kind, since, hits):
    drive = met_beside(drive, kind)
    drive.parameters[RADIUS] = 0.0
    if since is not None:
        drive.changes = [(START + round(since * SECOND), RADIUS, 0.3)]
    if kind == 'others':
        # It is as near all the time.
        hits = since is not None
    found = outcomes(drive)[kind]
    assert (found.outcome is FAILED) == hits, found
    if hits:
        assert found.worst == pytest.approx(-0.15, abs=0.06)
        assert found.at >= since
