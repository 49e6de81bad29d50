"""What no plan can bring about, told before a run."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from cmpsp_ros.guidance.mission.feasibility_precheck import infeasibility_warnings, shortest_time
from cmpsp_ros.guidance.settings import GuidanceSettings, Safety
from cmpsp_ros.robots.differential_drive import DifferentialDrive
from cmpsp_ros.world.obstacles.shapes import Obstacle
from cmpsp_ros.world.roads.annulus import Annulus

START = (0.0, -9.25)
ROCK = Obstacle('rock', (8.0, -6.0), 0.7)


def settings(**changes):
    robot = DifferentialDrive(0.035, 0.055, 51.0)
    return GuidanceSettings(robot=robot, road=Annulus(), goal=(10.0, 0.0), **changes)


def test_the_shortest_time_is_that_of_a_taut_string_at_full_speed():
    tangents = math.sqrt(9.25**2 - 81.0) + math.sqrt(100.0 - 81.0)
    turned = math.pi / 2.0 - math.acos(9.0 / 9.25) - math.acos(0.9)
    expected = (tangents + 9.0 * turned - 0.01) / (0.035 * 51.0)
    assert shortest_time(settings(), START) == pytest.approx(expected, rel=1e-12)


def test_a_wider_robot_goes_a_longer_way_and_one_without_limit_needs_no_time():
    assert shortest_time(settings(robot_radius=0.2), START) > shortest_time(settings(), START)
    unlimited = replace(settings(), robot=DifferentialDrive(0.035, 0.055))
    assert shortest_time(unlimited, START) == 0.0
    assert infeasibility_warnings(unlimited, START) == []


def test_a_goal_out_of_reach_is_told_with_the_time_that_it_takes():
    needed = shortest_time(settings(), START)
    assert infeasibility_warnings(settings(final_time=needed + 1e-6), START) == []
    (said,) = infeasibility_warnings(settings(final_time=needed - 0.5), START)
    assert said.startswith(f'The goal is out of reach by {0.5 * 0.035 * 51.0:.2f} m: ')
    assert f'have to be {math.ceil(10.0 * needed) / 10.0:.1f} s or more.' in said


@pytest.mark.parametrize(('radius', 'margin'), [(0.15, 0.0), (0.1, 0.05)])
def test_a_gap_too_narrow_is_told_and_one_just_wide_enough_is_not(radius, margin):
    narrow = settings(
        obstacles=(ROCK,), robot_radius=radius + 1e-6, safety=Safety(margin), final_time=20.0
    )
    (said,) = infeasibility_warnings(narrow, START)
    assert said.startswith('There is no way past obstacle rock: the wider gap beside it is 0.300 m')
    wide = replace(narrow, robot_radius=radius - 1e-6)
    assert infeasibility_warnings(wide, START) == []


def test_an_obstacle_that_fills_the_road_stops_even_a_point():
    (said,) = infeasibility_warnings(settings(obstacles=(replace(ROCK, radius=1.5),)), START)
    assert 'the wider gap beside it is 0.000 m, and this robot needs 0.000 m' in said


def test_obstacles_before_the_start_and_behind_the_goal_are_not_in_the_way():
    beside = [replace(ROCK, center=center) for center in ((-8.0, -6.0), (8.0, 6.0))]
    assert infeasibility_warnings(settings(obstacles=tuple(beside), robot_radius=0.2), START) == []
