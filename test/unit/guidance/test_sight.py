"""The guidance law with a scanner: what is seen is passed, what is not seen is come near slowly."""

from __future__ import annotations

import math

import numpy as np
import pytest
from seeing import Drive

from cmpsp_ros.guidance.decision import FallbackLevel

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
    blind = Drive(**FAST, **reach, **{'safety.stop_within_sight': False}, end=5.0)
    assert max(speeds(blind)) > 1.2
    careful = Drive(**FAST, **reach, end=5.0)
    # A metre from the scanner, 0.86 m from the footprint, less the margin: in 0.7 s and on.
    assert 0.4 < max(speeds(careful)) < 0.86 / 0.7
    assert any('has not been seen yet' in each.reason for each in careful.decisions)


WALL = {
    'sim.obstacles.names': ['wall'],
    'sim.obstacles.wall.type': 'capsule',
    'sim.obstacles.wall.radius': 0.05,
}


def wall_ahead(x, reach):
    ends = {'start': [x, -reach], 'end': [x, reach]}
    return {**WALL, **{f'sim.obstacles.wall.{key}': place for key, place in ends.items()}}


@pytest.mark.parametrize('seed', range(3))
@pytest.mark.parametrize('reach', [0.5, 1.5])
def test_a_wall_that_appears_a_metre_ahead_is_not_touched(reach, seed):
    """Across a part of the road, or all of it, before a robot at 1 m/s."""
    given = {**FAST, 'final_time': 11.0, 'sim.scan.stddev': 0.01, 'noise.seed': seed}
    empty = Drive(**given, end=4.0)
    assert speeds(empty)[-1] == pytest.approx(1.0, abs=0.15)
    x = empty.pose[0] + empty.settings.robot_radius + 0.05 + 1.0
    drive = Drive(**{**given, **wall_ahead(x, reach)}, appears=4.0, end=7.0)
    assert drive.clearance > 0.0
