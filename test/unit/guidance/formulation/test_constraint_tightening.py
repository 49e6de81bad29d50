"""What the robot's centre keeps to."""

from dataclasses import replace

import numpy as np
from scenarios import CASES, FIRST, SECOND, settings, start_of

from cmpsp_ros.guidance import Goal, Safety
from cmpsp_ros.guidance.formulation import goal_space, sample_space
from cmpsp_ros.guidance.formulation.ocp_formulation import path_space
from cmpsp_ros.guidance.goals import Target
from cmpsp_ros.guidance.mission.goal_manager import GoalManager
from cmpsp_ros.world import outside
from cmpsp_ros.world.inter_sample_margin import inside
from cmpsp_ros.world.roads import Corridor

TARGET = Target((10.0, 0.0))


def test_path_keeps_radius_and_margin():
    given = settings((FIRST, SECOND), robot_radius=0.1, safety=Safety(margin=0.05))
    space = path_space(given, given.world)
    np.testing.assert_allclose(space.radii, [0.85, 0.65])
    np.testing.assert_allclose(np.ravel([space.annulus.inner, space.annulus.outer]), [9.15, 10.85])


def test_samples_keep_what_the_fastest_arcs_need():
    given = CASES['case 3']
    limits, space = given.robot.twist_limits(), sample_space(given, given.world)
    # At least: the steps beside a late odometry are longer than a period.
    assert (space.radii >= [outside(r, limits, 0.2) for r in (0.7, 0.5)]).all()
    assert space.annulus.inner >= outside(9.0, limits, 0.2)
    assert space.annulus.outer <= inside(11.0, limits, 0.2)


def test_samples_are_the_path_without_a_limit_or_by_choice():
    by_choice = replace(CASES['case 3'], safety=Safety(between_samples=False))
    for given in (CASES['case 2'], by_choice):
        path, samples = path_space(given, given.world), sample_space(given, given.world)
        np.testing.assert_array_equal(samples.radii, path.radii)
        np.testing.assert_array_equal(samples.centers, path.centers)
        for mine, its in zip(samples.annulus, path.annulus, strict=True):
            np.testing.assert_array_equal(mine, its)


def test_at_the_goal_what_it_is_near_to_may_be_as_near_as_to_the_path():
    near = replace(FIRST, center=(10.75, 0.0))
    given = settings((near, SECOND), 51.0)
    end, samples = goal_space(given, given.world, TARGET), sample_space(given, given.world)
    np.testing.assert_array_equal(end.radii, [near.radius, samples.radii[1]])
    np.testing.assert_array_equal(end.annulus.outer, samples.annulus.outer)
    at_edge = goal_space(given, given.world, Target((9.03, 0.0)))
    np.testing.assert_array_equal(at_edge.radii, samples.radii)
    assert float(at_edge.annulus.inner[0]) == given.road.inner_radius


def test_on_a_line_through_points_a_goal_beside_the_edge_may_be_reached_as_well():
    line = Corridor(((0.0, 0.0), (10.0, 0.0)), left=(0.5, 0.5), right=(0.5, 0.5))
    given = settings((FIRST,), 51.0, road=line, goal=(9.0, 0.46))
    end, samples = goal_space(given, given.world, given.target), sample_space(given, given.world)
    pose = np.array([[9.0, 0.46, 0.0]])
    assert samples.at(pose).min() < 0.0 < end.at(pose).min()
    np.testing.assert_array_equal(end.radii, samples.radii)


def test_a_goal_that_is_not_near_or_too_near_changes_nothing():
    near = settings((replace(FIRST, center=(10.75, 0.0)),), 51.0)
    assert goal_space(CASES['case 3'], CASES['case 3'].world, TARGET) is None
    assert goal_space(replace(near, safety=Safety(margin=0.06)), near.world, TARGET) is None
    assert (
        goal_space(replace(near, safety=Safety(between_samples=False)), near.world, TARGET) is None
    )


def test_only_at_the_last_of_several_goals_the_robot_may_be_as_near():
    """It has somewhere to go from the others, and commands under way lead on."""
    last = Goal((9.0, 1.0), 10.0, None, 'last')
    near = settings((replace(FIRST, center=(10.75, 0.0)),), 51.0, goal=last.position)
    goals = GoalManager(
        replace(near, waypoints=(Goal((10.0, 0.0), 5.0, 1.6, 'first'),)), near.world
    )
    assert goals.target.drives_on
    assert goal_space(near, near.world, goals.target) is None
    assert goal_space(near, near.world, goals.target._replace(drives_on=False)) is not None
    assert goals.update(5_000_000_000, 5_000_000_000, start_of(near, (10.0, 0.0, 1.6)))
    assert not goals.target.drives_on
