"""Free space and penalties of plans: for samples, at the goal, and between samples."""

from dataclasses import replace

import numpy as np
import pytest
from scenarios import CASES, FIRST, ROAD, SECOND, clearance, closed_loop, settings, start_of

from cmpsp_ros.guidance import FallbackLevel, Goal, Safety
from cmpsp_ros.guidance.formulation import OcpFormulation, goal_space, sample_space
from cmpsp_ros.guidance.formulation.ocp_formulation import path_space, terminal_penalty
from cmpsp_ros.guidance.goals import Target
from cmpsp_ros.guidance.mission.goal_manager import GoalManager
from cmpsp_ros.world import outside
from cmpsp_ros.world.inter_sample_margin import inside
from cmpsp_ros.world.obstacles import Obstacle
from cmpsp_ros.world.roads import Annulus, Corridor, OpenFloor

TARGET = settings().target
GUESS = np.tile([45.0, 44.0], (11, 1))
WORLD = CASES['case 3'].world


def space_of(given, *arguments):
    return OcpFormulation(given, given.world).space(given.world, *arguments)


def test_samples_keep_what_the_fastest_arcs_need():
    given = CASES['case 3']
    limits, space = given.robot.twist_limits(), sample_space(given, given.world)
    # At least: the steps beside a late odometry are longer than a period.
    assert (space.radii >= [outside(r, limits, 0.2) for r in (0.7, 0.5)]).all()
    assert space.annulus.inner >= outside(9.0, limits, 0.2)
    assert space.annulus.outer <= inside(11.0, limits, 0.2)


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
    for safety in (Safety(margin=0.06), Safety(between_samples=False)):
        assert goal_space(replace(near, safety=safety), near.world, TARGET) is None
    assert goal_space(CASES['case 3'], WORLD, TARGET) is None


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


def test_an_obstacle_outranks_the_edge_and_the_edge_the_goal():
    given = settings((FIRST, SECOND))
    formulation = OcpFormulation(given, given.world)
    edges, obstacles = formulation.penalty_path[:2], formulation.penalty_path[2:]
    assert obstacles.shape == terminal_penalty(2).shape == (2,)
    assert terminal_penalty(2).max() < edges.min()
    assert edges.max() < obstacles.min()


LINE = Corridor(((0.0, -9.0), (9.0, 0.0), (0.0, 9.0)), (1.0, 1.0, 1.0), (1.5, 1.5, 1.5))


@pytest.mark.parametrize('road', [Annulus(), LINE, OpenFloor()])
def test_each_sample_keeps_what_the_longer_of_its_two_steps_asks_for(road):
    given = replace(CASES['case 3'], road=road)
    lengths = [0.27, 0.2, 0.05, 0.2, 0.2, 0.295]
    asked = [0.27, 0.27, 0.2, 0.2, 0.2, 0.3, 0.3]
    space = space_of(given, GUESS, np.array(lengths), TARGET)
    assert space.radii.shape == (7, 2)
    for k, longest in enumerate(asked):
        wanted = sample_space(given, given.world, longest)
        np.testing.assert_array_equal(space.radii[k], wanted.radii)
        np.testing.assert_array_equal(space.road.kept[k], wanted.road.kept[0])


def test_without_a_wheel_limit_the_guess_says_what_room_its_arcs_need():
    durations = np.full(10, 0.2)
    slow, fast = (space_of(CASES['case 2'], each, durations, TARGET) for each in (GUESS / 2, GUESS))
    assert slow.radii.shape == fast.radii.shape == (11, 2)
    assert (fast.radii >= slow.radii).all()
    assert fast.radii.max() > slow.radii.max()
    at_samples_alone = replace(CASES['case 2'], safety=Safety(between_samples=False))
    space = space_of(at_samples_alone, GUESS, durations, TARGET)
    np.testing.assert_array_equal(space.radii, [FIRST.radius, SECOND.radius])


NEAR = Obstacle('near', (10.323, -0.143), 0.283)


def test_the_last_sample_may_be_as_near_as_the_path_where_the_goal_is():
    """Seven centimetres from an obstacle, where samples have to keep more."""
    given = settings((NEAR,), 51.0)
    samples, path = sample_space(given, given.world), path_space(given, given.world)
    away = np.hypot(0.323, 0.143)
    assert path.radii[0] < away < samples.radii[0]
    space = space_of(given, GUESS, np.full(10, 0.2), TARGET)
    assert space.radii[:, 0].tolist() == [samples.radii[0]] * 10 + [path.radii[0]]
    assert set(space.annulus.outer.tolist()) == set(samples.annulus.outer.tolist())


def test_after_a_longer_last_step_the_goal_counts_as_near_from_farther_away():
    given = settings((replace(NEAR, radius=0.22),), 51.0)
    durations = np.full(10, 0.2)
    assert space_of(given, GUESS, durations, TARGET).radii.shape == (1,)
    durations[-1] = 0.29
    space = space_of(given, GUESS, durations, TARGET)
    longer = sample_space(given, given.world, 0.29)
    np.testing.assert_array_equal(space.radii[-2:, 0], [longer.radii[0], 0.22])


@pytest.mark.parametrize('margin', [0.0, 0.05])
def test_a_goal_near_an_obstacle_is_passed_and_the_obstacle_missed(margin):
    given = settings((NEAR,), 51.0, ROAD, safety=Safety(margin=margin))
    run = closed_loop(given)
    assert run.miss() < 1e-6
    assert clearance(run.path, given) >= margin
    assert {decision.level for decision in run.moves} == {FallbackLevel.NOMINAL}


def test_a_goal_nearer_than_the_margin_is_no_reason_to_give_it_up():
    given = settings((NEAR,), 51.0, safety=Safety(margin=0.08))
    space = space_of(given, GUESS, np.full(10, 0.2), TARGET)
    np.testing.assert_array_equal(space.radii, sample_space(given, given.world).radii)
