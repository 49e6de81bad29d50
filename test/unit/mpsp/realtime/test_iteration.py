"""The compiled iteration does what `CMPSP` does, step for step."""

import numpy as np
import pytest
from runs import assert_same, improved, iterates, robot_options, robot_problem, room_for

from cmpsp_ros.mpsp.realtime.iteration import DONE, OUTCOME, QP_ITERATIONS, RELAXED
from cmpsp_ros.mpsp.riccati.outcome import NO_CURVATURE, SOLVED
from cmpsp_ros.robot.guidance_functions import EXACT, GAUSS_NEWTON, PROJECTED
from cmpsp_ros.robot.obstacles import Obstacle

HESSIANS = {'gauss_newton': GAUSS_NEWTON, 'projected': PROJECTED, 'exact': EXACT}


def guesses(problem, size, seed):
    rng = np.random.default_rng(seed)
    steady = np.tile([45.13, 44.63], (problem.size.horizon + 1, 1))
    return steady + size * rng.normal(size=steady.shape)


def follow(problem, options, guess, iterations=8):
    """Check every iterate of a run, each from the same guess; returns what `CMPSP` did."""
    run = iterates(problem, options, guess, iterations)
    data = problem.data._replace(hessian=HESSIANS[options.hessian])
    at = room_for(problem, options)
    for iterate in run[1:]:
        assert_same(improved(problem, data, options, guess, iterate.index, at), iterate, options)
    # A run that is over stays where it is.
    if len(run) <= iterations:
        room = improved(problem, data, options, guess, iterations, at)
        assert room.counts[DONE] == run[-1].index
    return [iterate.step for iterate in run[1:]]


@pytest.mark.parametrize('hessian', ['gauss_newton', 'projected'])
@pytest.mark.parametrize('limit', [51.0, np.inf])
@pytest.mark.parametrize('steps', [1, 7, 50])
def test_iterates_are_those_of_the_general_iteration(hessian, limit, steps):
    problem = robot_problem(steps, limit)
    options = robot_options(problem, hessian=hessian)
    follow(problem, options, guesses(problem, 0.0, 0))


def test_a_run_to_its_end():
    problem = robot_problem(30, change=0.02)
    options = robot_options(problem, control_tolerance=1e-3, output_tolerance=1e-6)
    steps = follow(problem, options, guesses(problem, 0.0, 0), 40)
    assert 5 < len(steps) < 40
    assert steps[-1].full_change <= options.control_tolerance


def test_steps_that_are_shortened():
    problem = robot_problem(20)
    options = robot_options(problem, trust_radius=None)
    steps = follow(problem, options, guesses(problem, 20.0, 1), 12)
    assert any(0.0 < step.length < 1.0 for step in steps)


def test_steps_that_are_bent():
    problem = robot_problem(10, change=0.02)
    steps = follow(problem, robot_options(problem), guesses(problem, 0.0, 0), 12)
    assert any(step.corrected for step in steps)


def test_full_steps_without_a_line_search():
    problem = robot_problem(20)
    options = robot_options(problem, line_search=False)
    steps = follow(problem, options, guesses(problem, 2.0, 3))
    assert all(step.length == 1.0 for step in steps)


def test_a_guess_beyond_the_bounds_is_brought_within():
    problem = robot_problem(10, 47.0)
    follow(problem, robot_options(problem), guesses(problem, 0.0, 0) + 10.0)


@pytest.mark.parametrize('search', [True, False])
def test_a_road_that_is_blocked(search):
    wall = Obstacle('wall', (7.07, -7.07), 1.5)
    problem = robot_problem(20, 51.0, (wall, Obstacle('first', (8.0, -6.0), 0.7)))
    steps = follow(problem, robot_options(problem, line_search=search), guesses(problem, 0.0, 0))
    assert any(step.needed_slack for step in steps)


def test_a_goal_out_of_reach():
    problem = robot_problem(20, 20.0)
    steps = follow(problem, robot_options(problem), guesses(problem, 0.0, 0), 30)
    assert steps[-1].needed_slack
    assert np.abs(steps[-1].slack_terminal).max() > 1.0


def test_what_has_no_curvature_is_left_to_others():
    problem = robot_problem(10)
    options = robot_options(problem)
    data = problem.data._replace(hessian=EXACT, road_center=1e4, control_change=1e-3)
    guess = guesses(problem, 15.0, 1)
    room = improved(problem, data, options, guess, 5)
    assert room.counts[OUTCOME] == NO_CURVATURE
    assert room.counts[DONE] == 1
    np.testing.assert_array_equal(room.at.U, np.clip(guess, -51.0, 51.0))


@pytest.mark.parametrize('where', ['pose', 'goal', 'guess'])
def test_numbers_that_are_none_end_the_run(where):
    problem = robot_problem(10)
    options, guess = robot_options(problem), guesses(problem, 0.0, 0)
    data = problem.data
    bad = np.array([np.nan, 0.0, 0.0])
    if where == 'guess':
        guess[3, 0] = np.nan
    else:
        data = data._replace(**{where: bad[: len(getattr(data, where))]})
    room = improved(problem, data, options, guess, 5)
    assert room.counts[OUTCOME] != SOLVED
    assert room.counts[DONE] == 1


def test_a_room_forgets_the_run_before():
    problem = robot_problem(20)
    options = robot_options(problem)
    at = room_for(problem, options)
    for seed in range(3):
        guess = guesses(problem, 2.0, seed)
        fresh = improved(problem, problem.data, options, guess, 3)
        used = improved(problem, problem.data, options, guess, 3, at)
        np.testing.assert_array_equal(used.at.U, fresh.at.U)
        np.testing.assert_array_equal(used.counts, fresh.counts)


def test_a_horizon_that_becomes_shorter_in_the_same_room():
    """The active rows of the plan before shorten the way and leave the plan the same."""
    longest = robot_problem(40)
    options = robot_options(longest)
    at = room_for(longest, options)
    guess, hinted, alone = guesses(longest, 0.0, 0), 0, 0
    pose, durations = longest.data.pose, longest.data.durations
    problem = longest
    for step in range(30):
        over = len(at[1].lower) if step == 0 else 1
        room = improved(problem, problem.data, options, guess, 2, at, over)
        fresh = improved(problem, problem.data, options, guess, 2)
        stages = len(guess)
        np.testing.assert_allclose(room.at.U[:stages], fresh.at.U, atol=1e-9)
        assert room.counts[RELAXED] == fresh.counts[RELAXED]
        if step:
            hinted += room.counts[QP_ITERATIONS]
            alone += fresh.counts[QP_ITERATIONS]
        pose = room.at.X[1].copy()
        guess = room.at.U[1:stages].copy()
        problem = robot_problem(40 - step - 1, pose=pose)
        problem.data = problem.data._replace(durations=durations[step + 1 :].copy())
    assert 0 < hinted <= alone
