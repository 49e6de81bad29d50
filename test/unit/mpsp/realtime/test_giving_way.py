"""Which constraints give way: first the lightest and they alone, however close the weights."""

import math

import numpy as np
import pytest
from runs import iterates, robot_options, robot_problem

from cmpsp_ros.mpsp.iterate import SLACK_TOLERANCE
from cmpsp_ros.mpsp.qp import QPStatus
from cmpsp_ros.robot.obstacles import Obstacle

# So close that a weighted sum of slacks would give way wherever that is cheapest.
GOAL, EDGE, OBSTACLE = 1000.0, 1000.1, 1000.2
WALL = Obstacle('wall', (9.4 * math.sin(0.7), -9.4 * math.cos(0.7)), 1.75)


def ranked(problem):
    obstacles = problem.size.path - 2
    return robot_options(
        problem,
        penalty_terminal=np.full(2, GOAL),
        penalty_path=np.array([EDGE] * 2 + [OBSTACLE] * obstacles),
    )


def steps(problem, iterations=40):
    guess = np.tile([44.0, 43.5], (problem.size.horizon + 1, 1))
    run = iterates(problem, ranked(problem), guess, iterations)
    return [iterate.step for iterate in run[1:]]


@pytest.mark.parametrize('limit', [20.0, 40.0])
def test_the_goal_gives_way_alone_where_that_is_enough(limit):
    last = steps(robot_problem(25, limit))[-1]
    assert np.abs(last.slack_terminal).max() > 0.1
    assert last.slack_path.max() <= SLACK_TOLERANCE


def test_all_give_way_where_the_goal_alone_is_not_enough():
    """A wall over the whole road: its rows contradict those of the edges."""
    seen = [step for step in steps(robot_problem(25, 51.0, (WALL,)), 8) if step.needed_slack]
    assert seen
    assert all(step.qp_status is QPStatus.SOLVED for step in seen)
    assert max(step.slack_path.max() for step in seen) > 0.05
