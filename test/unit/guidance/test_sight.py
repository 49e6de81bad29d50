"""The guidance law with a scanner: what is seen is passed, what is not seen is come near slowly."""

import math
from functools import cache

import numpy as np
import pytest
from seeing import Drive

from cmpsp_ros.guidance import FallbackLevel

FAST = {
    'robot.max_wheel_speed': 42.0,
    'robot.max_wheel_acceleration': 100.0,
    'final_time': 8.0,
    'sim.obstacles.names': [],
}
"""At most 1.5 m/s, on an empty road."""


@pytest.fixture(scope='module')
def unknown():
    return Drive()


def test_obstacles_that_only_a_scanner_sees_are_passed(unknown):
    assert unknown.clearance > 0.03
    assert math.dist(unknown.pose[:2], unknown.settings.goal) < 0.01
    assert all(each.level != FallbackLevel.STOP for each in unknown.decisions[:-1])


def test_the_same_scans_lead_to_the_same_decisions(unknown):
    again = Drive(end=6.0)
    for one, other in zip(again.decisions, unknown.decisions, strict=False):
        assert np.array_equal(one.wheel_speeds, other.wheel_speeds)
        assert (one.reason, one.sighting) == (other.reason, other.sighting)


def test_a_decision_says_what_it_knew(unknown):
    # There is a scan to every decision, of the time of its odometry.
    assert [each.sighting for each in unknown.decisions] == [
        each.stamp for each in unknown.decisions
    ]


def speeds(drive):
    return [each.twist[0] for each in drive.decisions]


def test_the_robot_can_stop_within_what_it_has_seen():
    reach = {'sensors.front.reach': 1.0, 'sim.scan.range_max': 1.0}
    blind = Drive(**FAST, **reach, **{'safety.stop_within_sight': 'off'}, end=5.0)
    assert max(speeds(blind)) > 1.2
    careful = Drive(**FAST, **reach, end=5.0)
    # A metre from the scanner, 0.86 m from the footprint, less the margin: in 0.7 s and on.
    assert 0.4 < max(speeds(careful)) < 0.86 / 0.7
    assert any('has not been seen yet' in each.reason for each in careful.decisions)


def test_it_can_stop_before_anything_that_may_come_from_where_it_has_not_seen():
    reach = {'sensors.front.reach': 1.0, 'sim.scan.range_max': 1.0}
    drives = [
        Drive(**FAST, **reach, **{'safety.stop_within_sight': given}, end=5.0)
        for given in ('stationary', 'moving')
    ]
    careful, more_careful = (max(speeds(each)) for each in drives)
    # Less than 1 m to the edge, from where somebody may come at 1.6 m/s until it is at rest.
    assert 0.1 < more_careful < careful
    assert any('no sensor looks' in each.reason for each in drives[1].decisions)


CLOUD = {
    'sensors.front.type': 'cloud',
    'sensors.front.reach': 5.0,
    'sensors.front.heights': [-0.25, 0.1],
    'sim.scan.dropout': 0.0,
}
"""A depth camera 0.3 m above the floor: 5 cm above the floor and more is an obstacle."""


def test_a_cloud_with_points_on_the_floor_lets_the_robot_drive_at_speed():
    drive = Drive(**FAST, **CLOUD, end=5.0)
    assert max(speeds(drive)) > 1.2
    assert not any('has not been seen yet' in each.reason for each in drive.decisions[5:])


def test_a_cloud_without_points_on_the_floor_shows_no_free_space():
    drive = Drive(**FAST, **CLOUD, sees_floor=False, end=5.0)
    assert max(speeds(drive)) < 0.1
    # After three seconds it looks for other ways.
    assert all('has not been seen yet' in each.reason for each in drive.decisions[:15])


@pytest.mark.slow
def test_obstacles_that_only_a_depth_camera_sees_are_passed():
    drive = Drive(**CLOUD)
    assert drive.clearance > 0.03
    assert math.dist(drive.pose[:2], drive.settings.goal) < 0.01
    assert all(each.level != FallbackLevel.STOP for each in drive.decisions[:-1])


WALL = {
    'sim.obstacles.names': ['wall'],
    'sim.obstacles.wall.type': 'capsule',
    'sim.obstacles.wall.radius': 0.05,
}


@cache
def on_an_empty_road():
    """Place of a robot at 1 m/s after four seconds [m], its radius, and its margin added."""
    empty = Drive(**{**FAST, 'final_time': 11.0}, end=4.0)
    assert speeds(empty)[-1] == pytest.approx(1.0, abs=0.15)
    return empty.pose[0] + empty.settings.robot_radius + empty.settings.safety.margin


def wall_a_metre_ahead(seed):
    """A run in which a wall appears, across a part of the road or all of it."""
    random = np.random.default_rng(seed)
    reach, tilt, aside = random.uniform([0.2, -0.5, -0.3], [1.5, 0.5, 0.3])
    # No end of it is nearer than a metre.
    x = on_an_empty_road() + 1.0 + 0.05 + reach * abs(math.sin(tilt))
    along, across = reach * math.sin(tilt), reach * math.cos(tilt)
    ends = {'start': [x - along, aside - across], 'end': [x + along, aside + across]}
    wall = {f'sim.obstacles.wall.{key}': list(map(float, each)) for key, each in ends.items()}
    noise = {'sim.scan.stddev': 0.01, 'noise.seed': seed}
    return Drive(**{**FAST, 'final_time': 11.0, **noise, **WALL, **wall}, appears=4.0, end=6.5)


@pytest.mark.parametrize('seed', range(5))
def test_a_wall_that_appears_a_metre_ahead_is_not_touched(seed):
    assert wall_a_metre_ahead(seed).clearance > 0.0


@pytest.mark.slow
@pytest.mark.timeout(1800)
def test_two_hundred_walls_that_appear_a_metre_ahead():
    clearances = [wall_a_metre_ahead(seed).clearance for seed in range(200)]
    assert min(clearances) > 0.0, np.flatnonzero(np.array(clearances) <= 0.0)


@pytest.mark.parametrize('seed', range(3))
def test_who_stands_within_noise_of_a_wall_starts(seed):
    wall = {
        'sim.obstacles.wall.start': [-0.5, 0.26],
        'sim.obstacles.wall.end': [1.0, 0.26],
        'sim.scan.stddev': 0.01,
        'noise.seed': seed,
    }
    beside = Drive(**{**FAST, **WALL, **wall}, end=4.0)
    assert beside.clearance > 0.0
    assert beside.pose[0] > 1.0


def test_no_control_step_after_the_first_searches_the_grid():
    drive = Drive('clutter', end=6.0)
    assert drive.clearance > 0.0
    assert drive.law.world.map_search(drive.settings) is not None
    assert not any(drive.searches[1:])


def test_a_robot_turns_to_what_is_behind_it_and_out_of_sight():
    ahead_only = {'sim.scan.angle_min': -2.356, 'sim.scan.angle_max': 2.356}
    behind = {'goal.position': [-4.0, -0.2], 'final_time': 14.0, 'sim.obstacles.names': []}
    drive = Drive('clutter', **ahead_only, **behind)
    speed, turn_rate = drive.decisions[1].twist
    assert abs(speed) < 1e-3 < abs(turn_rate)
    assert math.dist(drive.pose[:2], drive.settings.goal) < 0.02


def test_a_control_step_searches_nothing_and_improves_one_plan():
    """Other plans, and the first one where the final time may move, are made after a step."""
    drive = Drive('clutter', end=3.0, **{'goal.when': 'soonest'})
    first, *later = drive.decisions
    assert (first.level, first.twist.any()) == (FallbackLevel.STOP, False)
    assert 'while the first plan is made' in first.reason
    assert later[0].level is FallbackLevel.NOMINAL
    assert set(drive.searches) == {0}
    assert (drive.improved[0], set(drive.improved[1:])) == (0, {1})
    assert drive.looked[0] > 9
    assert sum(drive.looked[1:]) > 15
