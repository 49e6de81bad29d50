"""Segments of scans: what is one object, and what is not."""

import math

import numpy as np
import pytest
from scanned_rooms import RADIUS, ROOM

from cmpsp_ros.sensing.segments import segments_of
from cmpsp_ros.simulator.laser import cast


@pytest.mark.parametrize(('apart', 'count'), [(0.5, 1), (2.0, 2)])
def test_edges_on_both_sides_of_the_sensor_are_no_legs_of_one(apart, count):
    """Two ends of walls nearer to it than a stride, `apart` seen from it [rad]."""
    middles = np.array([-apart, apart])[:, None] / 2.0
    angles = (middles + np.linspace(-0.1, 0.1, 23)).ravel()
    points = 0.3 * np.column_stack([np.cos(angles), np.sin(angles)])
    labels, nobody = np.full(len(points), 2), np.empty((0, 4))
    view = 0.2 / 22, -2.0, 2.0
    found = segments_of(np.zeros(2), points, labels, nobody, view)
    assert len(found) == count
    assert max(each.radius for each in found) < 0.6


@pytest.mark.parametrize('unknown', [1, 8])
@pytest.mark.parametrize('first', range(0, 720, 24))
def test_who_stands_before_a_scanner_all_around_is_one(first, unknown):
    """No returns are missing but a few in a row, in the middle of him or elsewhere."""
    angles = np.linspace(-math.pi, math.pi, 720, endpoint=False)
    angles = np.delete(angles, np.arange(first, first + unknown))
    count = len(angles)
    ranges = np.empty(count)
    rays = np.column_stack([np.ones(count), np.full(count, 3.0), angles])
    body = np.array([[0.6, 3.0, 0.0, 0.0, RADIUS]])
    cast(ranges, rays, np.zeros(count), np.array(ROOM), body)
    points = ranges[:, None] * np.column_stack([np.cos(angles), np.sin(angles)])
    labels, nobody = np.zeros(count, int), np.empty((0, 4))
    found = segments_of(np.zeros(2), points, labels, nobody, (math.tau / 720, math.nan, math.nan))
    (seen,) = [each for each in found if math.hypot(*each.front) < 0.3]
    assert seen.radius == pytest.approx(RADIUS, abs=0.05)


AROUND = math.tau / 720, math.nan, math.nan


def hits_around(x, y, people):
    """Hits of a scanner all around at a place in the room, ``(720, 2)`` from there [m]."""
    angles = np.linspace(-math.pi, math.pi, 720, endpoint=False)
    rays, ranges = np.column_stack([np.full(720, x), np.full(720, y), angles]), np.empty(720)
    bodies = [(*each, 0.0, 0.0, RADIUS) for each in people]
    cast(ranges, rays, np.zeros(720), np.array(ROOM), np.array(bodies))
    return ranges[:, None] * np.column_stack([np.cos(angles), np.sin(angles)])


@pytest.mark.parametrize('gap', [0.3, 0.45, 0.6])
@pytest.mark.parametrize('bearing', [math.radians(150.0), math.radians(210.0)])
def test_wall_beside_somebody_all_around_goes_on_behind(bearing, gap):
    """Two people 3 m away, `gap` [rad] between them: the wall there is no body."""
    half = gap / 2.0 + math.asin(RADIUS / 3.0)
    places = bearing + np.array([-half, half])
    people = np.column_stack([4.0 + 3.0 * np.cos(places), 3.0 + 3.0 * np.sin(places)])
    points = hits_around(4.0, 3.0, people)
    labels, nobody = np.zeros(720, int), np.empty((0, 4))
    found = segments_of(np.zeros(2), points, labels, nobody, AROUND)
    assert sum(each.is_body for each in found) == 2


@pytest.mark.parametrize('are_known', [False, True])
def test_two_side_by_side_close_to_the_scanner_are_two(are_known):
    """They take up a third of its view; who is known and has long stood there looks static."""
    points, labels = hits_around(6.0, 3.0, [(6.39, 2.8), (6.4, 3.18)]), np.full(720, 1)
    movers = np.array([(0.39, -0.2, RADIUS, 1.0), (0.4, 0.18, RADIUS, 1.0)])
    if not are_known:
        labels[np.hypot(*points.T) < 1.0], movers = 2, movers[:0]
    found = segments_of(np.zeros(2), points, labels, movers, AROUND)
    assert [math.hypot(*each.front) < 0.3 for each in found] == [True, True]


def test_two_in_one_track_close_to_the_scanner_are_two():
    """They have long stood there, and were taken for one, whose disc covers both."""
    points, labels = hits_around(6.0, 3.0, [(6.39, 2.8), (6.4, 3.18)]), np.full(720, 1)
    found = segments_of(np.zeros(2), points, labels, np.array([(0.58, 0.0, 0.44, 1.0)]), AROUND)
    assert [math.hypot(*each.front) < 0.3 for each in found if each.is_body] == [True, True]


def test_two_whom_a_segment_shows_are_two_though_it_is_not_wide():
    """One has long stood there, and looks static; the other has just come to stand beside him."""
    points, labels = hits_around(6.0, 3.0, [(6.36, 3.24), (6.65, 2.94)]), np.full(720, 1)
    movers = np.array([(0.36, 0.24, RADIUS, 1.0), (0.65, -0.06, RADIUS, 0.0)])
    labels[np.hypot(*(points - movers[1, :2]).T) < RADIUS + 0.01] = 2
    found = segments_of(np.zeros(2), points, labels, movers, AROUND)
    places = [each.center(np.zeros(2), RADIUS) for each in found]
    assert len(places) == 2
    assert all(min(math.dist(each, mover[:2]) for each in places) < 0.2 for mover in movers)
