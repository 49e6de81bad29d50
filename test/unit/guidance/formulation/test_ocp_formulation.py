"""What every plan is asked to do."""

from dataclasses import replace

import numpy as np
import pytest
from scenarios import CASES, FIRST, ROAD, SECOND, clearance, closed_loop, settings

from cmpsp_ros.guidance import FallbackLevel, Safety, SolverSettings
from cmpsp_ros.guidance.formulation import OcpFormulation, sample_space
from cmpsp_ros.guidance.formulation.ocp_formulation import path_space, terminal_penalty
from cmpsp_ros.world.obstacles import Obstacle
from cmpsp_ros.world.roads import Annulus, Corridor, OpenFloor

TARGET = settings().target
GUESS = np.tile([45.0, 44.0], (11, 1))
WORLD = CASES['case 3'].world


def space_of(given, *arguments):
    return OcpFormulation(given, given.world).space(given.world, *arguments)


def test_an_obstacle_outranks_the_edge_and_the_edge_the_goal():
    given = settings((FIRST, SECOND))
    formulation = OcpFormulation(given, given.world)
    edges, obstacles = formulation.penalty_path[:2], formulation.penalty_path[2:]
    assert obstacles.shape == terminal_penalty(2).shape == (2,)
    assert terminal_penalty(2).max() < edges.min()
    assert edges.max() < obstacles.min()


@pytest.mark.parametrize(('asked', 'found'), [(0.6, 0.6), (0.0, np.inf)])
def test_no_trust_region_is_an_infinite_one(asked, found):
    solver = SolverSettings(heading_trust_region=asked)
    assert OcpFormulation(settings(solver=solver), settings().world).heading_trust_region == found


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


def test_steps_that_are_none_too_long_ask_for_one_space():
    given = CASES['case 3']
    space, wanted = (
        space_of(given, GUESS, np.array([0.05, 0.2, 0.1]), TARGET),
        sample_space(given, given.world),
    )
    np.testing.assert_array_equal(space.annulus.outer, wanted.annulus.outer)
    np.testing.assert_array_equal(space.radii, wanted.radii)


def test_odometry_that_is_a_little_late_asks_for_no_other_space():
    formulation = OcpFormulation(CASES['case 3'], WORLD)
    first = formulation.space(WORLD, GUESS, np.full(10, 0.2), TARGET)
    assert formulation.space(WORLD, GUESS, np.append(np.full(9, 0.2), 0.19999), TARGET) is first
    assert formulation.space(WORLD, GUESS, np.append(np.full(9, 0.2), 0.191), TARGET) is first
    assert formulation.space(WORLD, GUESS, np.append(np.full(9, 0.2), 0.201), TARGET) is not first


def test_without_a_wheel_limit_the_guess_says_what_room_its_arcs_need():
    formulation, durations = (OcpFormulation(CASES['case 2'], WORLD), np.full(10, 0.2))
    slow, fast = (
        formulation.space(WORLD, GUESS / 2.0, durations, TARGET),
        formulation.space(WORLD, GUESS, durations, TARGET),
    )
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
    space, longer = (
        space_of(given, GUESS, durations, TARGET),
        sample_space(given, given.world, 0.29),
    )
    np.testing.assert_array_equal(space.radii[-2:, 0], [longer.radii[0], 0.22])


def test_another_goal_is_looked_at_afresh():
    given = settings((NEAR,), 51.0)
    formulation = OcpFormulation(given, given.world)
    world = given.world
    assert formulation.space(world, GUESS, np.full(10, 0.2), TARGET).radii.shape == (11, 1)
    other = given.target._replace(position=(9.6, 0.5))
    assert formulation.space(world, GUESS, np.full(10, 0.2), other).radii.shape == (1,)


@pytest.mark.parametrize('margin', [0.0, 0.05])
def test_a_goal_near_an_obstacle_is_passed_and_the_obstacle_missed(margin):
    given = settings((NEAR,), 51.0, ROAD, safety=Safety(margin=margin))
    run = closed_loop(given)
    assert run.miss() < 1e-6
    assert clearance(run.path, given) >= margin
    assert {decision.level for decision in run.moves} == {FallbackLevel.NOMINAL}


def test_a_goal_nearer_than_the_margin_is_no_reason_to_give_it_up():
    given = settings((NEAR,), 51.0, safety=Safety(margin=0.08))
    space, samples = (
        space_of(given, GUESS, np.full(10, 0.2), TARGET),
        sample_space(given, given.world),
    )
    np.testing.assert_array_equal(space.radii, samples.radii)
