"""Plans improved by the iterations of one control step."""

from dataclasses import replace

import numpy as np
import pytest
from general_iteration import improve as improve_generally
from scenarios import CASES, FIRST, MS, PERIOD, ROAD, START, context_of, law_of, settings, start_of

from cmpsp_ros.guidance import (
    FallbackLevel,
    Observation,
    SolverSettings,
    Weights,
    remaining,
    shift,
    to_nanoseconds,
)
from cmpsp_ros.guidance.formulation import OcpFormulation
from cmpsp_ros.guidance.planning import Planner, initial_guess
from cmpsp_ros.parameters import TABLE, guidance_settings, load_parameter_file
from cmpsp_ros.parameters.files import preset_names
from cmpsp_ros.world.obstacles import Obstacle

HORIZON = remaining(0, PERIOD, 50 * PERIOD)
POSE = np.array(START)


def improve(given, guess=None, held=(0.0, 0.0)):
    if guess is None:
        guess = initial_guess(given, start_of(given, POSE), given.target, HORIZON.durations)
    return Planner(OcpFormulation(given, given.world)).improve(
        context_of(given, POSE, HORIZON, held), guess
    )


@pytest.mark.parametrize('iterations', [1, 2, 7])
def test_iterations_are_as_many_as_asked_for(iterations):
    solver = SolverSettings(iterations_per_step=iterations)
    result = improve(replace(CASES['case 3'], solver=solver))
    assert result.iterations == iterations
    assert result.solved


@pytest.mark.xdist_group('control_rate')
@pytest.mark.parametrize('rate', [0.0, 1.0])
def test_plan_is_the_path_of_its_controls(rate):
    given = replace(CASES['case 3'], weights=Weights(control_rate=rate))
    plan = improve(given).plan
    np.testing.assert_array_equal(plan.horizon.edges, HORIZON.edges)
    assert (plan.controls.shape, plan.poses.shape) == ((51, 2), (51, 3))
    assert np.abs(plan.controls).max() <= 51.0
    path = given.robot.roll_out(POSE, plan.controls, HORIZON.durations)
    np.testing.assert_array_equal(plan.poses, path)


@pytest.mark.xdist_group('control_rate')
def test_control_rate_counts_from_the_command_held_until_now():
    given = replace(CASES['case 1'], weights=Weights(control_rate=100.0))
    held = improve(given, held=(45.0, 45.0)).plan.controls[0]
    rest = improve(given, held=(0.0, 0.0)).plan.controls[0]
    assert (rest < held - 1.0).all()


def test_guess_is_left_as_it_was():
    given = CASES['case 3']
    guess = initial_guess(given, start_of(given, POSE), given.target, HORIZON.durations)
    before = guess.copy()
    improve(given, guess)
    np.testing.assert_array_equal(guess, before)


def test_slack_says_where():
    # The road is blocked from edge to edge.
    wall = Obstacle('wall', (7.07, -7.07), 1.5)
    solver = SolverSettings(iterations_per_step=8)
    result = improve(settings((FIRST, wall), 51.0, ROAD, solver=solver))
    assert result.elastic
    assert result.slack > 0.01
    assert result.slack_where or result.slack_terminal
    assert set(result.slack_where) <= {0, 1, 2, 3}


def test_goal_out_of_reach_shows_in_the_terminal_slack():
    result = improve(settings(limit=20.0, guess=ROAD))
    assert result.elastic
    assert result.slack_terminal
    assert result.slack > 1.0


@pytest.mark.parametrize('candidates', [1, 4])
@pytest.mark.parametrize('work_rate', [1e6, 4e7])
def test_a_first_plan_that_runs_out_of_work_is_a_stop_with_its_reason(candidates, work_rate):
    """A thousand steps of 10 ms: the guess passes the audit, the iterations improve nothing."""
    changes = {'control_period': 0.01, 'solver.candidates': candidates}
    changes['solver.work_rate'] = work_rate
    law = law_of(guidance_settings(TABLE.resolve(load_parameter_file('case3') | changes)))
    for stamp in (0, 10_000_000):
        decision = law.step(Observation(stamp, POSE))
        assert decision.level == FallbackLevel.STOP
        assert decision.reason.startswith('The work of this control step was used up')
        assert decision.plan is None
        assert not decision.twist.any()


def assert_alike(compiled, general, spare_rows=0, atol=5e-8):
    # Wheel speeds are about 50 rad/s.
    np.testing.assert_allclose(compiled.plan.controls, general.plan.controls, rtol=0.0, atol=atol)
    np.testing.assert_allclose(compiled.plan.poses, general.plan.poses, rtol=0.0, atol=0.02 * atol)
    for name in ('solved', 'elastic', 'slack_where', 'slack_terminal', 'iterations'):
        assert getattr(compiled, name) == getattr(general, name), name
    assert abs(compiled.active_rows - general.active_rows) <= spare_rows
    assert compiled.slack == pytest.approx(general.slack, rel=1e-6, abs=1e-9)
    assert compiled.reason == general.reason


def side_by_side(given, start, steps=8, late=0, **tolerances):
    """Drive by the compiled plans, and compare each of them with the other kind."""
    compiled = Planner(OcpFormulation(given, given.world))
    period, final = to_nanoseconds(given.control_period), to_nanoseconds(given.final_time)
    pose, held = np.array(start, dtype=float), given.robot.at_rest
    horizon, seen = remaining(0, period, final), []
    guess = initial_guess(given, start_of(given, pose), given.target, horizon.durations)
    for step in range(steps):
        one = compiled.improve(context_of(given, pose, horizon, held), guess)
        other = improve_generally(given, pose, held, guess, horizon)
        assert_alike(one, other, **tolerances)
        seen.append(other)
        now = (step + 1) * period + late * (step % 3)
        driven = np.array([(now - horizon.edges[0]) / 1e9])
        pose = given.robot.roll_out(pose, one.plan.controls[:1], driven)[-1]
        held, coming = one.plan.controls[0], remaining(now, period, final)
        guess, horizon = shift(one.plan.controls, horizon, coming), coming
    return seen


@pytest.mark.parametrize('preset', preset_names())
def test_presets(preset):
    values = TABLE.resolve(load_parameter_file(preset, namespace='/r1'))
    # Of hundreds of rows, one with a multiplier of zero is active to rounding.
    tolerances = {'spare_rows': 1} if preset == 'parallel_parking' else {}
    if preset == 'lane_change':
        # With slack, and the versions of Ubuntu 24.04, plans differ by 3e-6 rad/s in one step.
        tolerances = {'atol': 1e-5}
    given = guidance_settings(values)
    seen = side_by_side(given, values['initial_pose'], **tolerances)
    assert all(result.solved for result in seen)


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
    assert any(result.elastic for result in seen)


@pytest.mark.parametrize('changes', [{'hessian': 'exact'}, {'qp': 'daqp'}], ids=str)
def test_back_ends_by_name_and_the_exact_hessian(changes):
    solver = SolverSettings(**changes)
    seen = side_by_side(replace(CASES['case 3'], solver=solver), START, steps=4)
    assert all(result.solved for result in seen)
