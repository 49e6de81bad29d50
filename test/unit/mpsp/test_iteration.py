"""The iteration on problems whose solution, or whose lack of one, is known."""

from dataclasses import replace

import numpy as np
import pytest
from problems import LinearQuadratic, VanDerPol

from cmpsp_ros.mpsp.condensing import condense
from cmpsp_ros.mpsp.errors import ProblemError
from cmpsp_ros.mpsp.iteration import CMPSP, Options, solve
from cmpsp_ros.mpsp.qp import Penalties, QPStatus, solve_qp
from cmpsp_ros.mpsp.status import Status


def options_for(problem, **changes):
    size = problem.size
    given = Options(np.full(size.output, 1e3), np.full(size.path, 1e3))
    return replace(given, **changes)


def zeros(problem):
    return np.zeros(problem.control_lower.shape)


def contradictory(seed=0):
    """A linear problem whose path constraints contradict each other at one stage."""
    problem = LinearQuadratic(np.random.default_rng(seed), path=2)
    problem.g_X[3, 1], problem.g_U[3, 1] = -problem.g_X[3, 0], -problem.g_U[3, 0]
    problem.room[3], problem.applies[3] = -1.0, True
    return problem


class TooFlat(VanDerPol):
    """Its Hessian is a thousandth of the true one, so that every step is far too long."""

    def linearise(self, X, U, hessian='gauss_newton'):
        lin = super().linearise(X, U, hessian)
        return replace(lin, L_XX=1e-3 * lin.L_XX, L_UX=1e-3 * lin.L_UX, L_UU=1e-3 * lin.L_UU)


class Cusp(VanDerPol):
    """The cost has a finite value and an infinite slope at the guess."""

    def linearise(self, X, U, hessian='gauss_newton'):
        lin = super().linearise(X, U, hessian)
        slope = lin.L_U.copy()
        slope[3] = np.inf
        return replace(lin, L_U=slope)


@pytest.mark.parametrize('seed', range(6))
@pytest.mark.parametrize('shape', [(5, 3, 2, 2, 0), (1, 3, 2, 2, 0), (8, 2, 1, 1, 0)])
def test_one_iteration_solves_a_linear_quadratic_problem(seed, shape):
    problem = LinearQuadratic(np.random.default_rng(seed), *shape)
    U = np.random.default_rng(seed + 100).normal(size=problem.control_lower.shape)
    lin = problem.linearise(problem.predict(U), U)
    qp = condense(lin, np.full_like(U, -np.inf), np.full_like(U, np.inf))
    m, q = qp.S_N.shape
    system = np.block([[qp.H, qp.S_N.T], [qp.S_N, np.zeros((m, m))]])
    answer = np.linalg.solve(system, -np.concatenate([qp.c, qp.output_error]))

    iteration = CMPSP(problem, options_for(problem))
    start = iteration.init(U)
    after = iteration.step(start)
    scale = 1.0 + np.abs(answer).max()
    np.testing.assert_allclose(after.U.ravel() - U.ravel(), answer[:q], atol=1e-10 * scale)
    np.testing.assert_allclose(after.step.terminal_multipliers, answer[q:], atol=1e-8 * scale)
    np.testing.assert_allclose(after.evaluation.output_error, 0.0, atol=1e-10 * scale)
    assert after.step.length == 1.0
    assert not after.step.elastic
    assert after.step.slack == 0.0
    assert after.index == 1
    np.testing.assert_array_equal(after.previous_U, start.U)
    np.testing.assert_array_equal(after.X, problem.predict(after.U))


@pytest.mark.parametrize('seed', range(20))
def test_a_linear_quadratic_problem_converges_at_once(seed):
    problem = LinearQuadratic(np.random.default_rng(seed), path=0)
    iterate, status = solve(problem, zeros(problem), options_for(problem), 10)
    assert status is Status.CONVERGED
    assert iterate.index == 2


@pytest.mark.parametrize('seed', range(20))
def test_the_solution_itself_is_no_stall(seed):
    problem = LinearQuadratic(np.random.default_rng(seed), path=0)
    strict = options_for(problem, control_tolerance=1e-9)
    first, _ = solve(problem, zeros(problem), strict, 10)
    again, status = solve(problem, first.U, strict, 10)
    assert status is Status.CONVERGED
    np.testing.assert_allclose(again.U, first.U, atol=1e-8)


@pytest.mark.parametrize('goal', [(0.0, 0.0), (0.4, -0.2)])
@pytest.mark.parametrize('hessian', ['gauss_newton', 'exact'])
@pytest.mark.parametrize('line_search', [True, False])
def test_converges_to_a_point_that_meets_the_optimality_conditions(goal, hessian, line_search):
    floor, mixed = (-0.8, 1.6) if goal[0] else (-0.5, 2.0)
    problem = VanDerPol(horizon=40, goal=goal, floor=floor, mixed=mixed, limit=3.0)
    options = options_for(problem, hessian=hessian, line_search=line_search)
    iterate, status = solve(problem, zeros(problem), options, 200)
    assert status is Status.CONVERGED
    np.testing.assert_allclose(iterate.X[-1], goal, atol=1e-9)
    assert iterate.evaluation.g.max() < 1e-8
    assert np.abs(iterate.U).max() <= 3.0

    lin = problem.linearise(iterate.X, iterate.U)
    qp = condense(lin, np.full_like(iterate.U, -1.0), np.full_like(iterate.U, 1.0))
    step = iterate.step
    rho = step.path_multipliers[qp.path_stage, qp.path_index]
    pull = qp.c + qp.S_N.T @ step.terminal_multipliers + qp.B_C.T @ rho
    free = np.abs(iterate.U.ravel()) < 3.0 - 1e-9
    np.testing.assert_allclose(pull[free], 0.0, atol=1e-4)
    assert (rho >= -1e-12).all()
    assert rho.any()
    np.testing.assert_allclose(rho * qp.g, 0.0, atol=1e-6)


def test_both_tolerances_must_be_met():
    problem = VanDerPol(goal=(0.4, -0.2))
    loose, tight = 1e9, 1e-8

    def iterations(output, control):
        options = options_for(problem, output_tolerance=output, control_tolerance=control)
        iterate, status = solve(problem, zeros(problem), options, 100)
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
    _, status = solve(problem, zeros(problem), options_for(problem), 50)
    assert status is Status.CONVERGED


def test_iteration_limit():
    problem = VanDerPol(goal=(0.4, -0.2))
    iterate, status = solve(problem, zeros(problem), options_for(problem), 1)
    assert status is Status.ITERATION_LIMIT
    assert iterate.index == 1
    iterate, status = solve(problem, zeros(problem), options_for(problem), 0)
    assert status is Status.ITERATION_LIMIT
    assert iterate.index == 0


@pytest.mark.parametrize('seed', range(4))
def test_infeasible(seed):
    problem = contradictory(seed)
    iterate, status = solve(problem, zeros(problem), options_for(problem), 50)
    assert status is Status.INFEASIBLE
    step = iterate.step
    assert step.elastic
    assert step.needed_slack
    # The gap of 2 is the least that the slacks of the two rows can add up to.
    assert step.slack_path[3].sum() == pytest.approx(2.0, abs=1e-6)
    assert step.slack_path[[0, 1, 2, 4, 5]].max() < 1e-6
    assert step.slack == pytest.approx(step.slack_path.max())
    np.testing.assert_allclose(iterate.evaluation.g[3].sum(), 2.0, atol=1e-6)


@pytest.mark.parametrize(
    ('goal', 'floor'), [((0.0, 0.0), -0.5), ((0.4, -0.2), -0.5), ((0.4, -0.2), -0.8)]
)
def test_contradicting_subproblems_are_solved_relaxed(goal, floor):
    problem = VanDerPol(horizon=40, goal=goal, floor=floor, mixed=1.6, limit=1.5)
    options = options_for(problem)
    iteration = CMPSP(problem, options)
    iterate = iteration.init(zeros(problem))
    needed = 0
    for _ in range(6):
        lin = problem.linearise(iterate.X, iterate.U)
        lower, upper = problem.control_lower - iterate.U, problem.control_upper - iterate.U
        qp = condense(lin, lower, upper)
        if solve_qp(qp, 'daqp').status is not QPStatus.SOLVED:
            needed += 1
            weights = Penalties(options.penalty_terminal, options.penalty_path[qp.path_index])
            found, judge = (solve_qp(qp, name, weights) for name in ('daqp', 'clarabel'))
            assert found.status is judge.status is QPStatus.SOLVED
            np.testing.assert_allclose(found.dU, judge.dU, atol=1e-4)
        iterate = iteration.step(iterate)
        assert iterate.step.qp_status is QPStatus.SOLVED
    assert needed


def test_unreachable_goal_is_infeasible():
    problem = VanDerPol(goal=(50.0, 0.0), limit=1.0)
    iterate, status = solve(problem, zeros(problem), options_for(problem), 200)
    assert status is Status.INFEASIBLE
    assert np.abs(iterate.step.slack_terminal).max() > 10.0


def test_stalled():
    problem = TooFlat(passes=False)
    iterate, status = solve(problem, np.ones((21, 1)), options_for(problem), 50)
    assert status is Status.STALLED
    assert iterate.step.length == 0.0
    np.testing.assert_array_equal(iterate.U, iterate.previous_U)


def test_qp_failed_where_it_may_not_be_relaxed():
    problem = contradictory()
    iterate, status = solve(problem, zeros(problem), options_for(problem, elastic=False), 50)
    assert status is Status.QP_FAILED
    assert iterate.step.qp_status is QPStatus.INFEASIBLE
    assert not iterate.step.elastic
    assert iterate.step.length == 0.0
    np.testing.assert_array_equal(iterate.U, zeros(problem))


def test_prediction_that_is_not_finite():
    problem = VanDerPol(start=(1e150, 1e150))
    iterate, status = solve(problem, zeros(problem), options_for(problem), 50)
    assert status is Status.NOT_FINITE
    assert iterate.index == 0
    assert not iterate.is_finite


def test_derivatives_that_are_not_finite():
    problem = Cusp()
    iterate, status = solve(problem, zeros(problem), options_for(problem), 50)
    assert status is Status.NOT_FINITE
    np.testing.assert_array_equal(iterate.U, zeros(problem))


def test_full_step_that_blows_up_without_a_line_search():
    problem = TooFlat(passes=False)
    options = options_for(problem, line_search=False)
    _, status = solve(problem, np.ones((21, 1)), options, 50)
    assert status is Status.NOT_FINITE


def test_guess_is_brought_within_its_bounds():
    problem = VanDerPol(limit=0.5)
    iterate = CMPSP(problem, options_for(problem)).init(np.full((21, 1), 7.0))
    np.testing.assert_array_equal(iterate.U, np.full((21, 1), 0.5))
    np.testing.assert_array_equal(iterate.X, problem.predict(iterate.U))


@pytest.mark.parametrize('line_search', [True, False])
def test_bounds_hold_to_the_last_bit(line_search):
    problem = VanDerPol(goal=(0.9, 0.0), limit=0.3)
    options = options_for(problem, line_search=line_search)
    iteration = CMPSP(problem, options)
    iterate = iteration.init(zeros(problem))
    for _ in range(8):
        iterate = iteration.step(iterate)
        assert np.abs(iterate.U).max() <= 0.3
    assert (np.abs(iterate.U) == 0.3).any()


def test_trust_region_limits_the_predicted_change():
    problem = LinearQuadratic(np.random.default_rng(8), output=0, path=0)
    radius = np.array([np.inf, 0.05, np.inf])
    free = CMPSP(problem, options_for(problem))
    held = CMPSP(problem, options_for(problem, trust_radius=radius))
    start = free.init(zeros(problem))
    assert np.abs(free.step(start).X - start.X)[:, 1].max() > 0.5
    change = np.abs(held.step(start).X - start.X)
    assert change[:, 1].max() == pytest.approx(0.05, abs=1e-9)
    assert change[:, [0, 2]].max() > 0.05
    assert held.step(start).step.active_rows > 0


def test_a_step_leaves_its_iterate_alone():
    problem = VanDerPol(goal=(0.4, -0.2), floor=-0.3)
    iteration = CMPSP(problem, options_for(problem))
    start = iteration.init(zeros(problem))
    U, X = start.U.copy(), start.X.copy()
    first, second = iteration.step(start), iteration.step(start)
    np.testing.assert_array_equal(start.U, U)
    np.testing.assert_array_equal(start.X, X)
    np.testing.assert_array_equal(first.U, second.U)


@pytest.mark.parametrize('name', ['daqp', 'clarabel'])
def test_back_ends_lead_to_the_same_solution(name):
    problem = VanDerPol(goal=(0.2, 0.0), floor=-0.6, limit=2.0)
    strict = options_for(problem, qp=name, output_tolerance=1e-6, control_tolerance=1e-5)
    iterate, status = solve(problem, zeros(problem), strict, 100)
    assert status is Status.CONVERGED
    reference, _ = solve(problem, zeros(problem), options_for(problem), 100)
    np.testing.assert_allclose(iterate.U, reference.U, atol=1e-4)


@pytest.mark.parametrize(
    ('changes', 'message'),
    [
        ({'penalty_terminal': np.ones(3)}, r'penalty_terminal: found shape \(3,\), wanted \(2,\)'),
        ({'penalty_path': np.ones(1)}, r'penalty_path: found shape \(1,\), wanted \(2,\)'),
        ({'trust_radius': np.ones(1)}, r'trust_radius: found shape \(1,\), wanted \(2,\)'),
        ({'qp': 'hildreth'}, "qp: found 'hildreth', wanted one of daqp"),
    ],
)
def test_options_that_do_not_fit_are_named(changes, message):
    problem = VanDerPol()
    with pytest.raises(ProblemError, match=message):
        CMPSP(problem, options_for(problem, **changes))


@pytest.mark.parametrize(
    ('guess', 'message'),
    [
        (np.zeros((20, 1)), r'U: found shape \(20, 1\), wanted \(21, 1\)'),
        (np.zeros(21), r'U: found shape \(21,\), wanted \(21, 1\)'),
        (np.full((21, 1), np.inf), r'U: found \[inf\] at stage 0'),
    ],
)
def test_guesses_that_do_not_fit_are_named(guess, message):
    problem = VanDerPol()
    with pytest.raises(ProblemError, match=message):
        solve(problem, guess, options_for(problem), 5)
