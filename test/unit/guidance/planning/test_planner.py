"""Plans improved by the iterations of one control step."""

from dataclasses import replace

import numpy as np
import pytest
from scenarios import CASES, FIRST, PERIOD, ROAD, START, context_of, law_of, settings, start_of

from cmpsp_ros.guidance import FallbackLevel, Observation, SolverSettings, Weights, remaining
from cmpsp_ros.guidance.formulation import OcpFormulation
from cmpsp_ros.guidance.planning import Planner, initial_guess
from cmpsp_ros.parameters import TABLE, guidance_settings, load_parameter_file
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
