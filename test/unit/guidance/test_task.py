"""What every plan is asked to do."""

from dataclasses import replace

import numpy as np
import pytest
from scenarios import CASES, FIRST, SECOND, settings

from cmpsp_ros.guidance.keep_clear import at_samples
from cmpsp_ros.guidance.settings import Safety, SolverSettings
from cmpsp_ros.guidance.task import Task
from cmpsp_ros.robot.annulus_functions import AnnulusSpace
from cmpsp_ros.robot.corridor import Corridor
from cmpsp_ros.robot.corridor_functions import CorridorSpace
from cmpsp_ros.robot.road import Annulus, OpenFloor

GUESS = np.tile([45.0, 44.0], (11, 1))


def test_an_obstacle_outranks_the_edge_and_the_edge_the_goal():
    task = Task(settings((FIRST, SECOND)))
    edges, obstacles = task.penalty_path[:2], task.penalty_path[2:]
    assert obstacles.shape == task.penalty_terminal.shape == (2,)
    assert task.penalty_terminal.max() < edges.min()
    assert edges.max() < obstacles.min()


@pytest.mark.parametrize(('asked', 'found'), [(0.6, 0.6), (0.0, np.inf)])
def test_no_trust_region_is_an_infinite_one(asked, found):
    solver = SolverSettings(heading_trust_region=asked)
    assert Task(settings(solver=solver)).heading_trust_region == found


LINE = Corridor(((0.0, -9.0), (9.0, 0.0), (0.0, 9.0)), (1.0, 1.0, 1.0), (1.5, 1.5, 1.5))


@pytest.mark.parametrize('road', [Annulus(), LINE, OpenFloor()])
def test_each_sample_keeps_what_the_longer_of_its_two_steps_asks_for(road):
    given = replace(CASES['case 3'], road=road)
    lengths = [0.27, 0.2, 0.05, 0.2, 0.2, 0.295]
    asked = [0.27, 0.27, 0.2, 0.2, 0.2, 0.3, 0.3]
    space = Task(given).space(GUESS, np.array(lengths))
    assert space.radii.shape == (7, 2)
    for k, longest in enumerate(asked):
        wanted = at_samples(given, longest)
        np.testing.assert_array_equal(space.radii[k], wanted.radii)
        for mine, its in zip(kept(space, k), kept(wanted, 0), strict=True):
            assert mine == its


def kept(space, k):
    """What a sample keeps from the edges."""
    match space.road:
        case AnnulusSpace(inner=inner, outer=outer):
            return inner[k], outer[k]
        case CorridorSpace(kept=kept):
            return tuple(kept[k])
    return ()


def test_steps_that_are_none_too_long_ask_for_one_space():
    given = CASES['case 3']
    space, wanted = Task(given).space(GUESS, np.array([0.05, 0.2, 0.1])), at_samples(given)
    np.testing.assert_array_equal(space.annulus.outer, wanted.annulus.outer)
    np.testing.assert_array_equal(space.radii, wanted.radii)


def test_odometry_that_is_a_little_late_asks_for_no_other_space():
    task = Task(CASES['case 3'])
    first = task.space(GUESS, np.full(10, 0.2))
    assert task.space(GUESS, np.append(np.full(9, 0.2), 0.19999)) is first
    assert task.space(GUESS, np.append(np.full(9, 0.2), 0.191)) is first
    assert task.space(GUESS, np.append(np.full(9, 0.2), 0.201)) is not first


def test_without_a_wheel_limit_the_guess_says_what_room_its_arcs_need():
    task, durations = Task(CASES['case 2']), np.full(10, 0.2)
    slow, fast = task.space(GUESS / 2.0, durations), task.space(GUESS, durations)
    assert slow.radii.shape == fast.radii.shape == (11, 2)
    assert (fast.radii >= slow.radii).all()
    assert fast.radii.max() > slow.radii.max()
    at_samples_alone = replace(CASES['case 2'], safety=Safety(between_samples=False))
    space = Task(at_samples_alone).space(GUESS, durations)
    np.testing.assert_array_equal(space.radii, [FIRST.radius, SECOND.radius])
