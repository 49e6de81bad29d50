"""The compiled iteration does what `CMPSP` does, step for step."""

import math
from dataclasses import replace

import numpy as np
import pytest
from robot_runs import assert_same, driver_for, improve, iterates, robot_options, robot_problem
from stage_programs import random_program, relaxed, run, staged

from cmpsp_ros.guidance.formulation import FUNCTIONS
from cmpsp_ros.guidance.formulation.guidance_problem import with_parameters
from cmpsp_ros.guidance.formulation.ocp_functions import CostHessian
from cmpsp_ros.mpsp import SLACK_TOLERANCE, Dimensions
from cmpsp_ros.mpsp.models import CONTROL_RATE, ControlRateData, ControlRateProblem, Rates
from cmpsp_ros.mpsp.qp import QPStatus
from cmpsp_ros.mpsp.qp.riccati import Outcome
from cmpsp_ros.mpsp.sqp.iteration import LEVELS, relax
from cmpsp_ros.mpsp.sqp.line_search import predicted_reduction, update_penalties
from cmpsp_ros.mpsp.sqp.workspace import workspace
from cmpsp_ros.robots.motion import within_ramp
from cmpsp_ros.world.obstacles import Obstacle

# What they call takes long to compile: by one worker.
pytestmark = [pytest.mark.timeout(600), pytest.mark.xdist_group('riccati')]


def guesses(steps, size=0.0, seed=0):
    rng = np.random.default_rng(seed)
    return np.array([45.13, 44.63]) + size * rng.normal(size=(steps + 1, 2))


def follow(problem, options, guess, iterations=8):
    """Check every iterate of a run, each from the same guess; returns what `CMPSP` did.

    The driver is warm from the second on, in memory that is longer than the horizon.
    """
    run = iterates(problem, options, guess, iterations)
    data = with_parameters(problem.data, hessian=CostHessian[options.hessian.upper()])
    driver = driver_for(problem, options, problem.size.horizon + 3)
    for iterate in run[1:]:
        assert_same(improve(driver, data, guess, iterate.index, over=0), iterate)
    # A run that is over stays where it is.
    if len(run) <= iterations:
        assert improve(driver, data, guess, iterations).run['iterations'] == run[-1].index
    # Nothing beyond the horizon was written.
    assert not driver.ws.now.U[len(guess) :].any()
    assert not driver.ws.now.X[len(guess) :].any()
    return [iterate.step for iterate in run[1:]]


@pytest.mark.parametrize('hessian', ['gauss_newton', 'projected'])
@pytest.mark.parametrize('limit', [51.0, np.inf])
@pytest.mark.parametrize('steps', [1, 7, 50])
def test_iterates_are_those_of_the_general_iteration(hessian, limit, steps):
    problem = robot_problem(steps, limit)
    follow(problem, robot_options(problem, hessian=hessian), guesses(steps))


def test_a_run_to_its_end():
    problem = robot_problem(30, change=0.02)
    options = robot_options(problem, control_tolerance=1e-3, output_tolerance=1e-6)
    steps = follow(problem, options, guesses(30), 40)
    assert 5 < len(steps) < 40
    assert steps[-1].full_change <= options.control_tolerance


def test_steps_that_are_shortened():
    problem = robot_problem(20)
    options = robot_options(problem, trust_radius=None)
    steps = follow(problem, options, guesses(20, 20.0, 1), 12)
    assert any(0.0 < step.length < 1.0 for step in steps)


def test_steps_with_a_second_order_correction():
    problem = robot_problem(10, change=0.02)
    steps = follow(problem, robot_options(problem), guesses(10), 12)
    assert any(step.corrected for step in steps)


def test_full_steps_without_a_line_search():
    problem = robot_problem(20)
    steps = follow(problem, robot_options(problem, line_search=False), guesses(20, 2.0, 3))
    assert all(step.length == 1.0 for step in steps)


def test_a_guess_beyond_the_bounds_is_brought_within():
    problem = robot_problem(10, 47.0)
    follow(problem, robot_options(problem), guesses(10) + 10.0)


@pytest.mark.parametrize('search', [True, False])
def test_a_road_that_is_blocked(search):
    wall = Obstacle('wall', (7.07, -7.07), 1.5)
    problem = robot_problem(20, 51.0, (wall, Obstacle('first', (8.0, -6.0), 0.7)))
    steps = follow(problem, robot_options(problem, line_search=search), guesses(20))
    assert any(step.needed_slack for step in steps)


def test_a_goal_out_of_reach_with_nearly_all_bounds_active():
    problem = robot_problem(20, 20.0)
    steps = follow(problem, robot_options(problem), guesses(20), 30)
    assert steps[-1].needed_slack
    assert np.abs(steps[-1].slack_terminal).max() > 1.0
    assert steps[-1].active_rows > 30


def test_without_elastic_mode_a_contradiction_ends_the_run():
    problem = robot_problem(20, 20.0)
    (step,) = follow(problem, robot_options(problem, elastic=False), guesses(20))
    assert step.qp_status is QPStatus.INFEASIBLE


# So close that a weighted sum of slacks would give way wherever that is cheapest.
GOAL, EDGE, OBSTACLE = 1000.0, 1000.1, 1000.2
WALL = Obstacle('wall', (9.4 * math.sin(0.7), -9.4 * math.cos(0.7)), 1.75)


@pytest.mark.parametrize(
    ('limit', 'obstacles'), [(20.0, None), (40.0, None), (51.0, (WALL,))], ids=str
)
def test_the_lightest_constraints_are_relaxed_first_and_alone(limit, obstacles):
    """The goal where that is enough; a wall over the whole road contradicts its edges."""
    problem = robot_problem(25, limit, **({'obstacles': obstacles} if obstacles else {}))
    others = problem.size.path - 2
    options = robot_options(
        problem,
        penalty_terminal=np.full(2, GOAL),
        penalty_path=np.array([EDGE] * 2 + [OBSTACLE] * others),
    )
    steps = follow(problem, options, guesses(25) - 1.2, 8)
    if obstacles is None:
        assert np.abs(steps[-1].slack_terminal).max() > 0.1
        assert steps[-1].slack_path.max() <= SLACK_TOLERANCE
    else:
        seen = [step for step in steps if step.needed_slack]
        assert all(step.qp_status is QPStatus.SOLVED for step in seen)
        assert max(step.slack_path.max() for step in seen) > 0.05


@pytest.mark.parametrize(
    ('weights', 'soft'),
    [
        ([1.0, 2.0, 3.0, 4.0], [[], [0], [0, 1], [0, 1, 2, 3]]),
        ([5.0, 2.0, 2.0, 5.0], [[], [1, 2], [0, 1, 2, 3], [0, 1, 2, 3]]),
        ([7.0, 7.0, 7.0, 7.0], [[], [0, 1, 2, 3], [0, 1, 2, 3], [0, 1, 2, 3]]),
        ([np.inf, 1.0, np.inf, 2.0], [[], [1], [1, 3], [1, 3]]),
    ],
    ids=str,
)
def test_levels_relax_the_lightest_constraints_first(weights, soft):
    """Two outputs and two path constraints; what is relaxed has its weight for a penalty."""
    weights = np.array(weights)
    p = workspace(Dimensions(5, 3, 2, 2, 2), weights[:2], weights[2:], np.full(3, np.inf)).program
    for level in range(LEVELS + 1):
        is_hard = relax(p, level)
        wanted = np.where(np.isin(range(4), soft[level]), weights, np.inf)
        np.testing.assert_array_equal(p.terminal['penalty'], wanted[:2])
        np.testing.assert_array_equal(p.path['penalty'], np.tile(wanted[2:], (6, 1)))
        # At the last level all is relaxed that may be.
        assert is_hard == (len(soft[level]) < 4 and level < LEVELS)


def test_the_merit_has_weights_above_the_multipliers_and_falls_as_predicted():
    qp = random_program(np.random.default_rng(0), bound=0.7)
    qp.g[:] += 0.5
    found = run(qp, relaxed(qp, 4.0, 4.0))
    p, program = found.space.program, staged(qp)
    p.terminal['weight'], p.path['weight'] = np.array([3.0, 0.5]), np.array([0.5, 40.0])
    update_penalties(p)
    for rows in (p.terminal, p.path):
        raised = 1.1 * np.abs(rows['multiplier'])
        np.testing.assert_allclose(rows['merit'], np.maximum(rows['weight'], raised))
    assert (p.path['merit'] > p.path['weight']).any()
    assert (p.path['merit'] == p.path['weight']).any()

    def weighted(error, g):
        violated = (p.path['merit'] * np.maximum(g, 0.0)).sum()
        return p.terminal['merit'] @ np.abs(error) + violated

    dU, dX, lin, slack = found.dU, found.dX, program.linearisation, np.full(4, np.nan)
    error, g = program.terminal(dU, dX), program.path(dU, dX)
    wanted = weighted(lin.output_error, lin.g) - weighted(error, g)
    wanted -= np.vdot(lin.L_X, dX) + np.vdot(lin.L_U, dU)
    assert predicted_reduction(p, slack) == pytest.approx(wanted)
    np.testing.assert_allclose(slack[:2], np.maximum(g, 0.0).max(axis=0), atol=1e-12)
    np.testing.assert_allclose(slack[2:], np.abs(error), atol=1e-12)


def test_without_curvature_the_run_ends():
    problem = robot_problem(10)
    data = with_parameters(
        problem.data, hessian=CostHessian.EXACT, road_center=1e4, control_change=1e-3
    )
    guess = guesses(10, 15.0, 1)
    driver = driver_for(problem, robot_options(problem))
    ws = improve(driver, data, guess, 5)
    assert ws.run['outcome'] == Outcome.NO_CURVATURE
    np.testing.assert_array_equal(ws.now.U, np.clip(guess, -51.0, 51.0))


@pytest.mark.parametrize('where', ['pose', 'goal', 'guess'])
def test_what_is_not_finite_ends_the_run(where):
    problem, bad = robot_problem(10), np.array([np.nan, 0.0, 0.0])
    data, guess = problem.data, guesses(10)
    if where == 'guess':
        guess[3, 0] = np.nan
    elif where == 'pose':
        data = data._replace(pose=bad)
    else:
        data = with_parameters(data, goal=bad[:2])
    ws = improve(driver_for(problem, robot_options(problem)), data, guess, 5)
    assert ws.run['outcome'] != Outcome.SOLVED
    # A Hessian that is not finite has no curvature, and is left to others at once.
    assert ws.run['iterations'] == int(where != 'guess')


def test_a_limit_of_work_ends_the_run():
    problem = robot_problem(50, 47.0)
    driver = driver_for(problem, robot_options(problem))
    whole = int(improve(driver, problem.data, guesses(50, 2.0), 3).program.head['work'][0])
    driver.forget()
    driver.ws.program.head['work_limit'] = whole // 10
    ws = improve(driver, problem.data, guesses(50, 2.0), 3)
    assert ws.run['outcome'] != Outcome.SOLVED
    assert ws.program.head['work'][0] < 3 * (whole // 10) + 20 * 51


def test_no_iteration_evaluates_the_guess():
    problem = robot_problem(10, 45.0)
    ws = improve(driver_for(problem, robot_options(problem)), problem.data, guesses(10), 0)
    U = np.clip(guesses(10), -45.0, 45.0)
    np.testing.assert_array_equal(ws.now.U, U)
    wanted = problem.evaluate(problem.predict(U), U)
    assert ws.run['cost'] == wanted.cost
    np.testing.assert_array_equal(ws.now.g, wanted.g)


def test_a_driver_told_to_forget_knows_nothing_of_the_run_before():
    problem = robot_problem(20)
    options = robot_options(problem)
    driver = driver_for(problem, options)
    for seed in range(3):
        guess = guesses(20, 2.0, seed)
        fresh = improve(driver_for(problem, options), problem.data, guess, 3)
        driver.forget()
        used = improve(driver, problem.data, guess, 3)
        np.testing.assert_array_equal(used.now.U, fresh.now.U)
        assert used.program.head['iterations'] == fresh.program.head['iterations']


@pytest.mark.parametrize('limit', [51.0, 45.0])
def test_a_horizon_that_becomes_shorter_in_the_same_memory(limit):
    """The active rows of the plan before shorten the way and leave the plan the same."""
    problem = robot_problem(40, limit)
    options = robot_options(problem)
    driver, other = driver_for(problem, options), driver_for(problem, options)
    guess, warm, cold, durations = guesses(40), 0, 0, problem.data.durations
    for step in range(30):
        ws = improve(driver, problem.data, guess, 2, over=min(step, 1))
        other.forget()
        fresh = improve(other, problem.data, guess, 2)
        stages = len(guess)
        np.testing.assert_allclose(ws.now.U[:stages], fresh.now.U[:stages], atol=1e-9)
        assert ws.run['level'] == fresh.run['level']
        if step:
            warm += int(ws.program.head['work'][0])
            cold += int(fresh.program.head['work'][0])
        pose, guess = ws.now.X[1].copy(), ws.now.U[1:stages].copy()
        problem = robot_problem(39 - step, limit, pose=pose)
        problem.data = problem.data._replace(durations=durations[step + 1 :].copy())
    assert 0 < warm <= 1.05 * cold


@pytest.mark.parametrize('limit', [np.inf, 1.5])
def test_a_cost_and_a_limit_on_changes_of_control(limit):
    """Five states, and functions that wrap the compiled ones."""
    previous, inner = np.array([45.0, 44.0]), robot_problem(20)
    problem = ControlRateProblem(inner, 0.7, previous, limit)
    data = ControlRateData(inner.data, Rates.of(20, 0.7, previous, limit, np.eye(2)))
    options, guess = robot_options(problem), guesses(20, 3.0)
    if limit < np.inf:
        hard = np.append(options.penalty_path[:-4], np.full(4, np.inf))
        options = replace(options, penalty_path=hard)
        guess = within_ramp(guess, np.full(20, 0.2), previous, limit)
    driver = driver_for(problem, options)
    data = data._replace(functions=FUNCTIONS.addresses(inner.data, driver.ws))
    entries = CONTROL_RATE.entries(data, driver.ws)
    for iterate in iterates(problem, options, guess, 5)[1:]:
        ws = improve(driver, data, guess, iterate.index, functions=entries)
        assert_same(ws, iterate)
    # Nothing may add up from one linearisation to the next.
    U, X = guess, problem.predict(guess)
    p = ws.program
    linearise = entries.functions.linearise
    linearise(data, X, U, p.stages, p.path, p.terminal)
    linearise(data, X, U, p.stages, p.path, p.terminal)
    wanted = problem.linearise(X, U)
    for name in ('L_X', 'L_U', 'L_XX', 'L_UX', 'L_UU'):
        np.testing.assert_allclose(p.stages[name], getattr(wanted, name), rtol=1e-13, err_msg=name)
    np.testing.assert_allclose(p.stages['A'][:20], wanted.A, rtol=1e-13)
    np.testing.assert_allclose(p.stages['B'][:20], wanted.B, rtol=1e-13)
    np.testing.assert_allclose(p.path['X'], wanted.g_X, rtol=1e-13)
    np.testing.assert_allclose(p.path['U'], wanted.g_U, rtol=1e-13)
