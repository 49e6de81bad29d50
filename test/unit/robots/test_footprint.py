"""Discs that cover a polygon, and how fast they are: for polygons and motions at random."""

import math

import numpy as np
import pytest

from cmpsp_ros.robots import (
    Ackermann,
    DifferentialDrive,
    Footprint,
    Omnidirectional,
    contains,
    covered,
    placed,
)
from cmpsp_ros.robots.motion import arc_from, arc_of_point, arc_part, point_of

WAFFLE = ((-0.205, -0.145), (0.077, -0.145), (0.077, 0.145), (-0.205, 0.145))
CAR = ((-0.831, -0.805), (3.677, -0.805), (3.677, 0.805), (-0.831, 0.805))
BOXES = [np.array([(-a, -b), (a, -b), (a, b), (-a, b)]) for a, b in ((1, 1), (0.2, 0.5), (3, 1))]
ROBOTS = (
    DifferentialDrive(max_wheel_speed=20.0, half_track=0.1),
    Ackermann(wheel_radius=1.0, wheel_base=2.5, max_steering_angle=0.6, max_wheel_speed=10.0),
    Omnidirectional.mecanum(0.13, 0.08, wheel_radius=0.05, max_wheel_speed=16.0),
)


def polygons(count):
    """Star-shaped around the origin, convex and not, in either sense of rotation."""
    rng = np.random.default_rng(4)
    for _ in range(count):
        angles = np.sort(rng.uniform(0.0, math.tau, rng.integers(5, 12)))
        if np.diff(angles, append=angles[0] + math.tau).max() < 3.0:
            radii = rng.uniform(0.2, 1.0, len(angles)) * rng.choice([0.3, 1.0, 5.0])
            points = np.column_stack([np.cos(angles), np.sin(angles)]) * radii[:, None]
            points *= rng.choice([1.0, 3.0], 2)
            yield points[:: rng.choice([-1, 1])]


def test_every_point_of_a_polygon_is_in_a_disc():
    rng, checked = np.random.default_rng(5), 0
    for corners in polygons(300):
        footprint, radius = covered(corners.tolist())
        assert 1 <= len(footprint.centers) <= 5
        after = np.roll(corners, -1, axis=0)
        edges = [corners + part * (after - corners) for part in np.linspace(0.0, 1.0, 40)]
        inside = [rng.uniform(0.0, 1.0) ** 0.5 * each for each in edges]
        points = np.vstack([*edges, *inside])
        away = np.hypot(*(points[:, None] - footprint.discs).transpose(2, 0, 1))
        assert away.min(axis=1).max() <= radius
        checked += 1
    assert checked > 200


@pytest.mark.parametrize('part', [0.05, 0.1])
def test_discs_reach_no_further_beyond_a_polygon_than_wanted(part):
    checked, rng = 0, np.random.default_rng(6)
    for corners in [np.array(WAFFLE), np.array(CAR), *BOXES]:
        excess = part * float(np.ptp(corners, axis=0).max())
        footprint, radius = covered(corners.tolist(), excess)
        after = np.roll(corners, -1, axis=0)
        outline = np.vstack([corners + s * (after - corners) for s in np.linspace(0.0, 1.0, 40)])
        away = np.hypot(*(outline[:, None] - footprint.discs).transpose(2, 0, 1))
        assert away.min(axis=1).max() <= radius
        angles = rng.uniform(0.0, math.tau, 30)
        around = radius * np.column_stack([np.cos(angles), np.sin(angles)])
        points = (footprint.discs[:, None] + around).reshape(-1, 2)
        outside = points[~contains(corners, points)]
        dense = np.hypot(*(outside[:, None] - outline).transpose(2, 0, 1)).min(axis=1)
        spacing = np.hypot(*(after - corners).T).max() / 39.0
        assert dense.max() <= excess + spacing
        checked += 1
    assert checked == 5


def test_discs_that_reach_no_further_may_be_too_many():
    with pytest.raises(ValueError, match='m or more'):
        covered(WAFFLE, 1e-4)


@pytest.mark.parametrize(('corners', 'count', 'axis'), [(WAFFLE, 2, 0), (CAR, 5, 0)])
def test_discs_stand_in_a_row_along_the_robot_and_are_little_wider(corners, count, axis):
    footprint, radius = covered(corners)
    low, high = np.min(corners, axis=0), np.max(corners, axis=0)
    assert len(footprint.centers) == count
    np.testing.assert_allclose(footprint.discs[:, 1 - axis], 0.0, atol=1e-12)
    half, length = high[1 - axis], high[axis] - low[axis]
    assert radius == pytest.approx(math.hypot(half, length / count / 2.0), rel=1e-8)
    assert radius <= 1.15 * half


def test_discs_of_a_wide_robot_stand_side_by_side():
    footprint, radius = covered([(-0.3, -1.5), (0.3, -1.5), (0.3, 1.5), (-0.3, 1.5)])
    np.testing.assert_allclose(footprint.discs[:, 0], 0.0, atol=1e-12)
    assert radius < 0.45


def test_a_square_is_covered_by_fewer_discs_than_a_bus():
    square, _ = covered([(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)])
    assert len(square.centers) == 2
    assert square.inscribed == 1.0
    assert covered([(-1.0, 1.0), (1.0, 1.0), (1.0, -1.0), (-1.0, -1.0)])[0].inscribed == 1.0


def test_an_outline_is_in_discs_around_its_points_that_hardly_reach_beyond():
    for corners in polygons(20):
        footprint, _ = covered(corners.tolist())
        points, radius = footprint.outline
        after = np.roll(corners, -1, axis=0)
        sides = np.vstack([corners + part * (after - corners) for part in np.linspace(0, 1, 777)])
        away = np.hypot(*(sides[:, None] - points).transpose(2, 0, 1)).min(axis=1)
        assert away.max() <= radius
        assert radius < 0.002 * np.hypot(*(after - corners).T).sum()


def test_points_inside_are_those_that_the_sides_go_around():
    rng = np.random.default_rng(7)
    for corners in polygons(100):
        points = rng.uniform(corners.min(axis=0), corners.max(axis=0), (20, 2))
        x, y = (corners - points[:, None]).transpose(2, 0, 1)
        angles = np.arctan2(y, x)
        turns = np.angle(np.exp(1j * np.diff(angles, append=angles[:, :1]))).sum(axis=1)
        inside = contains(corners, points)
        np.testing.assert_array_equal(inside, np.abs(turns) > math.pi)
        assert contains(corners, np.zeros(2))


def test_a_footprint_turns_with_the_robot():
    footprint, _ = covered(WAFFLE)
    turned = footprint.at(np.array([1.0, 2.0, math.pi / 2.0]))
    expected = [[1.0 - y, 2.0 + x] for x, y in footprint.corners]
    np.testing.assert_allclose(turned, expected, atol=1e-12)


@pytest.mark.parametrize('robot', ROBOTS, ids=lambda each: type(each).__name__)
@pytest.mark.parametrize('corners', [WAFFLE, CAR, ((-1.0, 0.1), (2.0, -3.0), (0.3, 2.0))])
def test_no_disc_is_faster_than_its_limits_say(robot, corners):
    footprint, _ = covered(corners)
    limits, plain = footprint.twist_limits(robot), robot.twist_limits()
    rng, fastest = np.random.default_rng(6), 0.0
    for _ in range(2000):
        turning = rng.uniform(0.0, plain.turn_rate)
        speed = max(plain.speed - plain.half_track * turning, 0.0)
        course = rng.choice([0.0, math.pi])
        if robot.drives_sideways:
            course = rng.uniform(-math.pi, math.pi)
        turning *= rng.choice([-1.0, 1.0])
        twist = np.array([[speed * math.cos(course), speed * math.sin(course), turning]])
        driven = footprint.speeds_and_turns(twist)[0, 0]
        allowed = limits.speed - limits.half_track * abs(turning)
        assert driven <= allowed * (1.0 + 1e-9)
        fastest = max(fastest, driven / allowed)
    assert fastest > 0.95
    assert limits.top_speed >= plain.top_speed


def test_one_disc_about_the_reference_point_has_the_limits_of_the_robot():
    for robot in ROBOTS:
        assert Footprint().twist_limits(robot) == robot.twist_limits()


@pytest.mark.parametrize(
    ('length', 'turn', 'course'),
    [(0.7, 1.3, 0.0), (-0.4, 0.8, 0.0), (0.0, -2.0, 0.0), (0.5, 0.0, 0.0), (0.6, 0.9, 1.1)],
)
def test_a_disc_drives_an_arc_about_the_same_centre(length, turn, course):
    """At any time it is where the footprint of a robot at that pose has it."""
    heading, points = 0.4, np.array([[0.0, 0.0], [0.5, -0.3], [-1.0, 0.2]])
    arc = arc_from(1.0, -2.0, heading + course, length, turn)
    for i in range(len(points)):
        own = arc_of_point(arc, heading, points, i)
        for part in np.linspace(0.0, 1.0, 7):
            x, y, _, _ = arc_part(arc, part)
            expected = placed(points, np.array([x, y, heading + part * turn]))[i]
            np.testing.assert_allclose(arc_part(own, part)[:2], expected, atol=1e-12)
        assert point_of(1.0, -2.0, heading, points, i) == pytest.approx((own.x, own.y), abs=1e-12)
    assert arc_of_point(arc, heading, points, 0) == arc
