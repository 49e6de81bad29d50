"""Ends of runs of the iteration, each with its status."""

from dataclasses import replace

import numpy as np
import pytest
from problems import HalfHearted, LinearQuadratic, TooFlat, VanDerPol, options_for, run, zeros

from cmpsp_ros.mpsp.qp import QPStatus
from cmpsp_ros.mpsp.results import Status
from cmpsp_ros.mpsp.sqp import CMPSP
from cmpsp_ros.mpsp.sqp.solve import solve


def contradictory(seed=0):
    """A linear problem whose path constraints contradict each other at one stage."""
    problem = LinearQuadratic(np.random.default_rng(seed), path=2)
    problem.g_X[3, 1], problem.g_U[3, 1] = -problem.g_X[3, 0], -problem.g_U[3, 0]
    problem.room[3], problem.applies[3] = -1.0, True
    return problem


class Cusp(VanDerPol):
    """The cost has a finite value and an infinite slope at the guess."""

    def linearise(self, X, U, hessian='gauss_newton'):
        lin = super().linearise(X, U, hessian)
        slope = lin.L_U.copy()
        slope[3] = np.inf
        return replace(lin, L_U=slope)


def test_both_tolerances_must_be_met():
    problem = VanDerPol(goal=(0.4, -0.2))
    loose, tight = 1e9, 1e-8

    def iterations(output, control):
        options = options_for(
            problem,
            output_tolerance=output,
            control_tolerance=control,
            kkt_tolerance=np.inf,
            scaling=False,
        )
        iterate, status = run(problem, zeros(problem), options, 100)
        assert status is Status.CONVERGED
        target = np.linalg.norm(problem.target)
        assert np.linalg.norm(iterate.evaluation.output_error) <= output * target
        change = np.linalg.norm(iterate.U - iterate.previous_U, axis=1).sum()
        assert change <= control * np.linalg.norm(iterate.previous_U, axis=1).sum() or (
            not iterate.previous_U.any()
        )
        return iterate.index

    both = iterations(tight, tight)
    assert iterations(loose, loose) == 1
    assert 1 < iterations(tight, loose) <= both
    assert 1 < iterations(loose, tight) <= both


def test_terminal_tolerance_is_relative_but_absolute_where_the_target_is_zero():
    for goal, scale in (((0.0, 0.0), 1.0), ((30.0, 40.0), 50.0)):
        problem = VanDerPol(goal=goal)
        options = options_for(problem, output_tolerance=1e-3, control_tolerance=1e9)
        iteration = CMPSP(problem, options)
        iterate = iteration.step(iteration.init(zeros(problem)))
        for miss, wanted in ((0.9e-3, Status.CONVERGED), (1.1e-3, None)):
            at = replace(
                iterate,
                evaluation=replace(iterate.evaluation, output_error=np.array([miss * scale, 0.0])),
            )
            assert iteration.terminate(at) is wanted


def test_no_output_at_all_is_never_missed():
    problem = VanDerPol(passes=False, floor=-0.5)
    _, status = run(problem, zeros(problem), options_for(problem), 50)
    assert status is Status.CONVERGED


def test_iteration_limit():
    problem = VanDerPol(goal=(0.4, -0.2))
    iterate, status = run(problem, zeros(problem), options_for(problem), 1)
    assert status is Status.ITERATION_LIMIT
    assert iterate.index == 1
    iterate, status = run(problem, zeros(problem), options_for(problem), 0)
    assert status is Status.ITERATION_LIMIT
    assert iterate.index == 0


@pytest.mark.parametrize('seed', range(4))
def test_infeasible(seed):
    problem = contradictory(seed)
    iterate, status = run(problem, zeros(problem), options_for(problem), 50)
    assert status is Status.INFEASIBLE
    step = iterate.step
    assert step.elastic
    assert step.needed_slack
    # The gap of 2 is the least that the slacks of the two rows can add up to.
    assert step.slack_path[3].sum() == pytest.approx(2.0, abs=1e-6)
    assert step.slack_path[[0, 1, 2, 4, 5]].max() < 1e-6
    assert step.slack == pytest.approx(step.slack_path.max())
    np.testing.assert_allclose(iterate.evaluation.g[3].sum(), 2.0, atol=1e-6)


def test_unreachable_goal_is_infeasible():
    problem = VanDerPol(goal=(50.0, 0.0), limit=1.0)
    iterate, status = run(problem, zeros(problem), options_for(problem), 200)
    assert status is Status.INFEASIBLE
    assert np.abs(iterate.step.slack_terminal).max() > 10.0


def test_stalled():
    problem = TooFlat(passes=False)
    problem.fraction = 1e-9
    iterate, status = run(problem, np.ones((21, 1)), options_for(problem), 50)
    assert status is Status.STALLED
    assert iterate.step.length == 0.0
    np.testing.assert_array_equal(iterate.U, iterate.previous_U)


def test_a_stall_at_a_contradiction_is_one():
    """No progress in the merit and none promised in the violation: infeasible, not stalled."""
    problem = contradictory()
    iteration = CMPSP(problem, options_for(problem, control_tolerance=0.0))
    iterate = iteration.init(zeros(problem))
    for _ in range(3):
        iterate = iteration.step(iterate)
    halted = replace(iterate, step=replace(iterate.step, length=0.0, full_change=1.0))
    assert iteration.terminate(halted) is Status.INFEASIBLE
    promising = replace(halted.step, slack_path=0.5 * halted.step.slack_path)
    assert iteration.terminate(replace(halted, step=promising)) is Status.STALLED


def test_diverged_where_the_controls_grow_without_bound():
    problem = HalfHearted(np.random.default_rng(0), output=0, path=0)
    options = options_for(problem, line_search=False)
    iterate, status = run(problem, zeros(problem), options, 100)
    assert status is Status.DIVERGED
    assert iterate.index < 50
    searched = run(problem, zeros(problem), options_for(problem), 100)
    assert searched[1] is Status.CONVERGED


def test_violation_is_the_third_tolerance():
    problem = VanDerPol(floor=-0.5, passes=False)
    iteration = CMPSP(problem, options_for(problem))
    solution = solve(problem, zeros(problem), options_for(problem), 50)
    assert solution.status is Status.CONVERGED
    at = solution.iterate
    g = at.evaluation.g.copy()
    for excess, wanted in ((0.9e-6, Status.CONVERGED), (1.1e-6, None)):
        g[7, 0] = excess
        moved = replace(at, evaluation=replace(at.evaluation, g=g))
        assert iteration.terminate(moved) is wanted


def test_qp_failed_where_it_may_not_be_relaxed():
    problem = contradictory()
    iterate, status = run(problem, zeros(problem), options_for(problem, elastic=False), 50)
    assert status is Status.QP_FAILED
    assert iterate.step.qp_status is QPStatus.INFEASIBLE
    assert not iterate.step.elastic
    assert iterate.step.length == 0.0
    np.testing.assert_array_equal(iterate.U, zeros(problem))


def test_prediction_that_is_not_finite():
    problem = VanDerPol(start=(1e150, 1e150))
    solution = solve(problem, zeros(problem), options_for(problem), 50)
    assert solution.status is Status.NOT_FINITE
    assert solution.iterate.index == 0
    assert ' First of them: the prediction: found ' in solution.sentence
    assert ' at stage 1, component ' in solution.sentence


def test_derivatives_that_are_not_finite():
    problem = Cusp()
    solution = solve(problem, zeros(problem), options_for(problem), 50)
    assert solution.status is Status.NOT_FINITE
    assert ' First of them: L_U: found inf at stage 3, component 0.' in solution.sentence
    np.testing.assert_array_equal(solution.iterate.U, zeros(problem))


def test_full_step_that_blows_up_without_a_line_search():
    problem = TooFlat(passes=False)
    options = options_for(problem, line_search=False)
    _, status = run(problem, np.ones((21, 1)), options, 50)
    assert status is Status.NOT_FINITE
