"""Plans by compiled code and by the general iteration, side by side along the presets' drives."""

from dataclasses import replace

import numpy as np
import pytest
from scenarios import CASES, FIRST, MS, PERIOD, ROAD, START, settings

from cmpsp_ros.guidance.formulation.ocp_formulation import Task
from cmpsp_ros.guidance.horizon import remaining, shift, to_nanoseconds
from cmpsp_ros.guidance.planning.back_end_planner import BackEndPlanner
from cmpsp_ros.guidance.planning.initial_trajectories import initial_guess
from cmpsp_ros.guidance.planning.planner import Planner
from cmpsp_ros.guidance.settings import SolverSettings, Weights
from cmpsp_ros.mpsp.control_rate import ControlRateProblem
from cmpsp_ros.parameters.catalogue import TABLE
from cmpsp_ros.parameters.presets import load_parameter_file, preset_names
from cmpsp_ros.parameters.settings import guidance_settings
from cmpsp_ros.world.obstacles.shapes import Obstacle


def assert_alike(compiled, general):
    # Wheel speeds are about 50 rad/s.
    np.testing.assert_allclose(compiled.plan.controls, general.plan.controls, rtol=0.0, atol=5e-8)
    np.testing.assert_allclose(compiled.plan.poses, general.plan.poses, rtol=0.0, atol=1e-9)
    for name in ('solved', 'elastic', 'slack_where', 'slack_terminal', 'iterations', 'active_rows'):
        assert getattr(compiled, name) == getattr(general, name), name
    assert compiled.slack == pytest.approx(general.slack, rel=1e-6, abs=1e-9)
    assert compiled.reason == general.reason


def side_by_side(given, start, steps=8, late=0):
    """Drive by the compiled plans, and compare each of them with the other kind."""
    compiled, general = Planner(given), BackEndPlanner(Task(given))
    period, final = to_nanoseconds(given.control_period), to_nanoseconds(given.final_time)
    pose, held = np.array(start, dtype=float), np.zeros(2)
    horizon, seen = remaining(0, period, final), []
    guess = initial_guess(given, pose, horizon.durations)
    for step in range(steps):
        one = compiled.improve(pose, held, guess, horizon)
        other = general.improve(pose, held, guess, horizon)
        assert_alike(one, other)
        seen.append(other)
        now = (step + 1) * period + late * (step % 3)
        driven = np.array([(now - horizon.edges[0]) / 1e9])
        pose = given.robot.roll_out(pose, one.plan.controls[:1], driven)[-1]
        held, coming = one.plan.controls[0], remaining(now, period, final)
        guess, horizon = shift(one.plan.controls, horizon, coming), coming
    return seen


@pytest.mark.parametrize('preset', preset_names())
def test_presets(preset):
    values = TABLE.resolve(load_parameter_file(preset))
    seen = side_by_side(guidance_settings(values), values['initial_pose'])
    assert all(improvement.solved for improvement in seen)


@pytest.mark.parametrize('case', CASES)
@pytest.mark.parametrize('hessian', ['gauss_newton', 'projected'])
def test_hessians_wheels_without_limit_and_late_odometry(case, hessian):
    solver = SolverSettings(hessian=hessian, iterations_per_step=3)
    side_by_side(replace(CASES[case], solver=solver), START, late=15 * MS)


# One worker compiles the iteration for this class of data, for all tests that need it.
@pytest.mark.xdist_group('control_rate')
@pytest.mark.timeout(600)
def test_a_price_on_changes_of_the_command():
    given = replace(CASES['case 3'], weights=Weights(control_rate=1.0))
    side_by_side(given, START, steps=5)


def test_a_road_that_is_blocked():
    wall = Obstacle('wall', (7.07, -7.07), 1.5)
    solver = SolverSettings(iterations_per_step=6)
    seen = side_by_side(settings((FIRST, wall), 51.0, ROAD, solver=solver), START, steps=3)
    assert any(improvement.elastic for improvement in seen)


def test_the_compiled_planner_hands_over_what_it_was_not_made_for():
    horizon = remaining(0, PERIOD, 50 * PERIOD)
    pose = np.array(START)
    for solver in (SolverSettings(hessian='exact'), SolverSettings(qp='daqp')):
        given = replace(CASES['case 3'], solver=solver)
        guess = initial_guess(given, pose, horizon.durations)
        one = Planner(given).improve(pose, np.zeros(2), guess, horizon)
        other = BackEndPlanner(Task(given)).improve(pose, np.zeros(2), guess, horizon)
        np.testing.assert_array_equal(one.plan.controls, other.plan.controls)
        assert one.qp_iterations == other.qp_iterations


def test_the_problem_is_that_of_the_settings():
    horizon = remaining(0, PERIOD, 50 * PERIOD)
    guess = np.full((51, 2), 45.0)
    task = Task(replace(CASES['case 3'], weights=Weights(control_rate=1.0)))
    planner = BackEndPlanner(task)
    problem = planner.problem(np.array(START), np.zeros(2), guess, horizon)
    assert isinstance(problem, ControlRateProblem)
    options = planner.options(problem)
    np.testing.assert_array_equal(options.trust_radius, [np.inf, np.inf, 0.6, np.inf, np.inf])
    assert len(options.penalty_path) == problem.size.path == 4
