"""Warnings before a run of tasks that no plan can fulfil."""

import math
from dataclasses import replace

import numpy as np
import pytest

from cmpsp_ros.guidance import Follow, GuidanceSettings, Safety
from cmpsp_ros.guidance.mission import infeasibility_warnings, shortest_time
from cmpsp_ros.robots import DifferentialDrive, covered
from cmpsp_ros.world.obstacles import Capsule, Obstacle
from cmpsp_ros.world.obstacles.shapes import Polygon
from cmpsp_ros.world.roads import Annulus, Corridor

START = (0.0, -9.25)
ROCK = Obstacle('rock', (8.0, -6.0), 0.7)


def warnings_of(given, start):
    return infeasibility_warnings(given, given.world, start)


def time_of(given, start):
    return shortest_time(given, given.road, start)


def settings(**changes):
    robot = DifferentialDrive(max_wheel_speed=51.0)
    return GuidanceSettings(robot=robot, road=Annulus(), goal=(10.0, 0.0), **changes)


def test_the_shortest_time_is_that_of_a_taut_string_at_full_speed():
    tangents = math.sqrt(9.25**2 - 81.0) + math.sqrt(100.0 - 81.0)
    turned = math.pi / 2.0 - math.acos(9.0 / 9.25) - math.acos(0.9)
    expected = (tangents + 9.0 * turned - 0.01) / (0.035 * 51.0)
    assert time_of(settings(), START) == pytest.approx(expected, rel=1e-12)


def test_a_wider_robot_goes_a_longer_way_and_one_without_limit_needs_no_time():
    assert time_of(settings(robot_radius=0.2), START) > time_of(settings(), START)
    unlimited = replace(settings(), robot=DifferentialDrive())
    assert time_of(unlimited, START) == 0.0
    assert warnings_of(unlimited, START) == []


def test_of_a_robot_with_corners_only_what_is_around_its_reference_point_counts():
    """The point is near one side of it here, and may come nearer to an edge than its discs do."""
    footprint, radius = covered([(-0.1, -0.02), (0.1, -0.02), (0.1, 0.3), (-0.1, 0.3)])
    given = settings(robot_radius=radius, footprint=footprint)
    expected = time_of(settings(robot_radius=0.02), START)
    assert time_of(given, START) == pytest.approx(expected)
    (said,) = warnings_of(replace(given, obstacles=(replace(ROCK, radius=1.5),)), START)
    assert "(twice its discs' radius and safety.margin)" in said


def test_a_goal_out_of_reach_is_told_with_the_time_that_it_takes():
    needed = time_of(settings(), START)
    assert warnings_of(settings(final_time=needed + 1e-6), START) == []
    (said,) = warnings_of(settings(final_time=needed - 0.5), START)
    assert said.startswith(f'The goal is out of reach by {0.5 * 0.035 * 51.0:.2f} m: ')
    assert f'have to be {math.ceil(10.0 * needed) / 10.0:.1f} s or more.' in said


@pytest.mark.parametrize(('radius', 'margin'), [(0.15, 0.0), (0.1, 0.05)])
def test_a_gap_too_narrow_is_told_and_one_just_wide_enough_is_not(radius, margin):
    narrow = settings(
        obstacles=(ROCK,), robot_radius=radius + 1e-6, safety=Safety(margin), final_time=20.0
    )
    (said,) = warnings_of(narrow, START)
    assert said.startswith('There is no way past obstacle rock: the wider gap beside it is 0.300 m')
    wide = replace(narrow, robot_radius=radius - 1e-6)
    assert warnings_of(wide, START) == []


@pytest.mark.parametrize('away', [0.02, 0.045])
def test_a_goal_nearer_to_an_obstacle_than_the_margin_is_told_unless_its_tolerance_helps(away):
    given = settings(robot_radius=0.05, safety=Safety(margin=0.05), obstacles=(ROCK,))
    beside = ROCK.radius + given.robot_radius + away
    goal = (ROCK.center[0] + 0.8 * beside, ROCK.center[1] - 0.6 * beside)
    said = warnings_of(replace(given, goal=goal), START)
    expected = 'At the goal the robot is 0.020 m from obstacle rock, nearer than safety.margin'
    assert [each.startswith(expected) for each in said] == [True] * (away < 0.04)


def test_an_obstacle_that_fills_the_road_stops_even_a_point():
    (said,) = warnings_of(settings(obstacles=(replace(ROCK, radius=1.5),)), START)
    assert 'the wider gap beside it is 0.000 m, and this robot needs 0.000 m' in said


def test_obstacles_before_the_start_and_behind_the_goal_are_not_in_the_way():
    beside = [replace(ROCK, center=center) for center in ((-8.0, -6.0), (8.0, 6.0))]
    assert warnings_of(settings(obstacles=tuple(beside), robot_radius=0.2), START) == []


def test_obstacles_that_close_the_road_together_are_told_and_those_that_leave_a_gap_are_not():
    inner = Obstacle('inner', (6.7, -6.7), 0.3)
    middle, outer = Obstacle('middle', (7.1, -7.1), 0.1), Obstacle('outer', (7.6, -7.6), 0.1)
    given = settings(obstacles=(outer, inner, middle), robot_radius=0.15, final_time=20.0)
    gaps = [
        11.0 - math.hypot(*outer.center) - 0.1,
        math.dist(outer.center, middle.center) - 0.2,
        math.dist(middle.center, inner.center) - 0.4,
        math.hypot(*inner.center) - 9.0 - 0.3,
    ]
    (said,) = warnings_of(replace(given, robot_radius=0.5001 * max(gaps)), START)
    assert said.startswith('There is no way past obstacles outer, middle, inner: the widest gap is')
    assert f' is {max(gaps):.3f} m, ' in said
    assert warnings_of(replace(given, robot_radius=0.4999 * max(gaps)), START) == []


def test_walls_close_a_road_too():
    across = Capsule('wall', (6.3, -6.3), (7.8, -7.8), 0.05)
    box = Polygon('box', ((6.3, -6.3), (7.8, -7.8), (7.9, -7.7), (6.4, -6.2)))
    for shape in (across, box):
        (said,) = warnings_of(settings(obstacles=(shape,), final_time=20.0), START)
        assert said.startswith(f'There is no way past obstacle {shape.name}: ')


@pytest.fixture
def bend():
    """A corridor round a corner, 2 m wide."""
    points = ((0.0, 0.0), (10.0, 0.0), (14.0, 4.0), (14.0, 14.0))
    corridor = Corridor(points, (1.0,) * 4, (1.0,) * 4)
    return replace(settings(), road=corridor, goal=(14.0, 14.0), final_time=60.0)


def test_a_corridor_is_closed_by_two_beside_each_other_and_not_by_two_one_after_the_other(bend):
    straight = Corridor(((0.0, 0.0), (20.0, 0.0)), (1.0, 1.0), (1.0, 1.0))
    given = replace(bend, road=straight, goal=(20.0, 0.0), robot_radius=0.3)
    left, right = Obstacle('left', (5.0, 0.6), 0.3), Obstacle('right', (5.2, -0.5), 0.3)
    given = replace(given, obstacles=(left, right))
    (said,) = warnings_of(given, (0.0, 0.0))
    assert said.startswith('There is no way past obstacles ')
    later = replace(right, center=(8.0, -0.5))
    assert warnings_of(replace(given, obstacles=(left, later)), (0.0, 0.0)) == []


def test_the_length_of_a_corridor_is_that_of_the_road_and_never_too_long(bend):
    """No path is longer than it is said to be: not even one along the inner edge of the curve."""
    length = bend.road.shortest_length((0.0, 0.0), (14.0, 14.0))
    inner = bend.road.edges()[0]
    driven = float(np.hypot(*np.diff(inner, axis=0).T).sum())
    assert math.dist((0.0, 0.0), (14.0, 14.0)) + 0.5 < length <= driven
    needed = time_of(bend, (0.0, 0.0))
    assert warnings_of(replace(bend, final_time=needed + 0.1), (0.0, 0.0)) == []
    (said,) = warnings_of(replace(bend, final_time=needed - 0.1), (0.0, 0.0))
    assert said.startswith('The goal is out of reach by ')


def test_the_shorter_way_round_a_closed_corridor_counts():
    points = tuple((5.0 * math.cos(a), 5.0 * math.sin(a)) for a in np.arange(12) * math.tau / 12)
    ring = Corridor(points, (0.5,) * 12, (0.5,) * 12, closed=True)
    quarter = ring.shortest_length((5.0, 0.0), (0.0, -5.0))
    assert math.dist((5.0, 0.0), (0.0, -5.0)) <= quarter <= 5.0 * math.pi / 2.0


WIDE = DifferentialDrive(wheel_radius=0.1, half_track=0.3, max_wheel_speed=10.0)


def followed(speed, horizon=2.0, robot=WIDE):
    """Round a narrow circle, 5 cm of it on either side for the robot's centre."""
    road = Annulus(inner_radius=0.8, outer_radius=1.2)
    follow = Follow(speed, horizon)
    return replace(settings(), road=road, robot=robot, robot_radius=0.15, follow=follow)


@pytest.mark.parametrize('direction', [1.0, -1.0])
def test_a_speed_that_the_outer_wheel_does_not_allow_is_foretold(direction):
    # Along the innermost circle of 0.95 m the outer wheel is at its limit.
    largest = 1.0 / (0.95 + 0.3)
    assert warnings_of(followed(0.999 * direction * largest), START) == []
    (said,) = warnings_of(followed(1.001 * direction * largest), START)
    assert said.startswith('follow.speed is out of reach: round this road the wheels allow 0.8 m/s')


def test_an_acceleration_that_is_too_small_to_set_out_is_foretold():
    # All of two seconds to speed up, along the innermost circle.
    needed = 0.5 * 2.0 * 0.95
    for gain, expected in ((1.01, 0), (0.99, 1)):
        robot = replace(WIDE, max_wheel_acceleration=gain * needed / 2.0 / 0.1)
        said = warnings_of(followed(0.5, robot=robot), START)
        assert len(said) == expected
        assert all(each.startswith('follow.horizon is too short to set out: ') for each in said)
