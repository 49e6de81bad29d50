"""Fusion of sensors by the odometry of their own times, and its interpolation."""

import subprocess
import sys

import numpy as np
import pytest

from cmpsp_ros.robots import Footprint
from cmpsp_ros.sensing import Sensor, Sight, SightSettings, Surroundings
from cmpsp_ros.sensing.surroundings import PoseHistory
from cmpsp_ros.world.grids import Cell

MS = 1_000_000
FRONT, REAR = Sensor('front', 'a'), Sensor('rear', 'b', (0.0, 0.0, np.pi))
SETTINGS = SightSettings((FRONT, REAR), size=6.0, resolution=0.1, memory=5.0, timeout=0.5)


def seen(sensor, milliseconds, *ends):
    ends = np.array(ends, dtype=float)
    stamps = np.full(len(ends), milliseconds * MS)
    hits = np.ones(len(ends), dtype=bool)
    return Sight(sensor, milliseconds * MS, stamps, np.zeros_like(ends), ends, hits, is_sweep=True)


def surroundings():
    return Surroundings(SETTINGS, 0.2)


def drive(known, until, step=20):
    """At 1 m/s along x, with odometry until a time [ms]; what is known then."""
    for milliseconds in range(0, until + 1, step):
        stamp, pose = milliseconds * MS, np.array([1e-3 * milliseconds, 0.0, 0.0])
        known.update(stamp, pose)
    return known.at(stamp, pose)


def test_beams_are_those_of_where_the_robot_was():
    known = surroundings()
    # Half way between two odometry messages.
    known.add(seen(FRONT, 90, (1.0, 0.0)))
    sighting = drive(known, 400)
    assert sighting.stamp == 400 * MS
    points = np.array([[1.09, 0.05], [1.45, 0.05], [0.7, 0.05]])
    assert sighting.grid.at(points).tolist() == [Cell.OCCUPIED, Cell.UNKNOWN, Cell.FREE]


def test_what_odometry_has_not_caught_up_with_waits():
    known = surroundings()
    known.add(seen(FRONT, 300, (1.0, 0.0)))
    assert drive(known, 280) is None
    known.update(300 * MS, np.array([0.3, 0.0, 0.0]))
    sighting = known.at(300 * MS, np.array([0.3, 0.0, 0.0]))
    assert sighting.grid.at(np.array([1.3, 0.05])) == Cell.OCCUPIED


def test_the_order_in_which_messages_come_makes_no_difference():
    random = np.random.default_rng(0)
    messages = [
        seen(sensor, time, *random.uniform(-2.0, 2.0, (20, 2)))
        for time in (50, 100, 150)
        for sensor in (FRONT, REAR)
    ]
    grids = []
    for order in (messages, messages[::-1], [messages[k] for k in (3, 1, 5, 0, 4, 2)]):
        known = surroundings()
        for each in order:
            known.add(each)
        grids.append(drive(known, 200).grid)
    for each in grids[1:]:
        assert np.array_equal(each.cells, grids[0].cells)
        assert each.origin == grids[0].origin


def test_a_message_older_than_one_before_it_or_than_odometry_is_left_out():
    known = surroundings()
    known.add(seen(FRONT, -10, (1.0, 0.0)))
    assert drive(known, 100) is None
    known.add(seen(FRONT, 100, (1.0, 0.0)))
    first = drive(known, 100)
    known.add(seen(FRONT, 60, (0.5, 0.0)))
    assert drive(known, 120) is first


def test_the_robot_stands_on_free_ground_and_sensors_agree():
    known = surroundings()
    known.add(seen(FRONT, 0, (1.05, 0.0)))
    known.add(seen(REAR, 0, (1.05, 0.0)))
    grid = drive(known, 0).grid
    points = np.array([[1.05, 0.05], [-1.05, 0.05], [0.0, 0.3], [0.0, -0.3], [0.0, 0.55]])
    assert grid.at(points).tolist() == [
        Cell.OCCUPIED,
        Cell.OCCUPIED,
        Cell.FREE,
        Cell.FREE,
        Cell.UNKNOWN,
    ]


def test_a_sensor_that_shows_nothing():
    known = surroundings()
    waiting = 'Waiting for the first usable message of sensor {} on scan.'
    assert known.blindness(0) == waiting.format('front')
    known.add(seen(FRONT, 0, (1.0, 0.0)))
    drive(known, 20)
    assert known.blindness(20 * MS) == waiting.format('rear')
    known.add(seen(REAR, 20, (1.0, 0.0)))
    drive(known, 40)
    assert known.blindness(500 * MS) == ''
    assert known.blindness(501 * MS) == (
        'Sensor front has shown nothing for 0.501 s (sight.timeout).'
    )


def test_the_same_is_known_until_a_sensor_shows_more():
    known = surroundings()
    known.add(seen(FRONT, 0, (1.0, 0.0)))
    first = drive(known, 20)
    assert drive(known, 200) is first
    known.add(seen(FRONT, 210, (1.0, 0.0)))
    assert drive(known, 220).stamp == 220 * MS
    known.forget()
    assert known.at(0, np.zeros(3)) is None
    assert known.blindness(0) != ''


LONG = Footprint(centers=((0.0, 0.0), (0.5, 0.0)))
WEDGE = ((0.6, 0.0), (-0.2, 0.15), (-0.2, -0.15))
NORTH = np.array([0.0, 0.0, np.pi / 2.0])


def around(footprint):
    """State of the grid under a robot that faces north, when two things were seen there."""
    known = Surroundings(SETTINGS, 0.2, footprint)
    known.update(0, NORTH)
    known.add(seen(FRONT, 0, (0.51, 0.01), (0.51, 0.16), (0.51, 0.34), (0.51, -2.0)))
    known.update(20 * MS, NORTH)
    points = np.array([[0.01, 0.51], [-0.16, 0.51], [-0.34, 0.51], [0.01, 0.65], [0.71, 0.01]])
    return known.at(20 * MS, NORTH).grid.at(points).tolist()


def test_a_long_robot_stands_on_all_of_its_discs():
    """Nothing is under its front, which no sensor sees; beside it something may be."""
    expected = [Cell.FREE, Cell.FREE, Cell.OCCUPIED, Cell.FREE, Cell.UNKNOWN]
    assert around(LONG) == expected


def test_what_is_seen_in_a_disc_but_beside_the_corners_stays():
    footprint = Footprint(WEDGE, LONG.centers)
    expected = [Cell.FREE, Cell.OCCUPIED, Cell.OCCUPIED, Cell.FREE, Cell.UNKNOWN]
    assert around(footprint) == expected


def history(*poses, span=1000):
    known = PoseHistory(span)
    for stamp, *pose in poses:
        known.add(stamp, np.array(pose, dtype=float))
    return known


def test_poses_between_two_of_them():
    known = history((100, 0.0, 0.0, 0.0), (200, 1.0, 2.0, 0.5))
    assert known.at(np.array([100, 150, 200])).tolist() == [
        [0.0, 0.0, 0.0],
        [0.5, 1.0, 0.25],
        [1.0, 2.0, 0.5],
    ]


def test_headings_go_the_short_way():
    known = history((0, 0.0, 0.0, 3.0), (100, 0.0, 0.0, -3.0), (200, 0.0, 0.0, 3.0))
    turned = known.at(np.array([50, 150]))[:, 2]
    assert turned == pytest.approx([np.pi, np.pi])


def test_old_poses_are_forgotten_but_for_the_last_one_before_the_span():
    known = history(*((100 * k, k, 0, 0) for k in range(20)), span=250)
    assert known.is_after(1599)
    assert not known.is_after(1600)
    assert not history().is_after(0)
    assert known.at(np.array([1650]))[0, 0] == 16.5


def test_a_pose_that_is_not_newer_is_left_out():
    known = history((100, 1, 0, 0), (100, 2, 0, 0), (50, 3, 0, 0))
    assert known.at(np.array([100]))[0, 0] == 1.0


@pytest.mark.parametrize('count', [1, 2, 5])
def test_no_instants_have_no_poses(count):
    known = history(*((100 * k, k, 0, 0) for k in range(count)))
    assert known.at(np.array([], dtype=np.int64)).shape == (0, 3)


def test_who_tracks_nobody_loads_no_optimiser():
    """It takes as long to load as the rest of scipy and numpy together."""
    code = 'import sys, cmpsp_ros.guidance.law; print("scipy.optimize" in sys.modules)'
    asked = [sys.executable, '-c', code]
    done = subprocess.run(asked, capture_output=True, text=True, check=True, timeout=100)
    assert done.stdout == 'False\n'
