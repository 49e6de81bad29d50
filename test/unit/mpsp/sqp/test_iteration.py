"""The iteration on problems whose solution, or whose lack of one, is known."""

from dataclasses import replace

import numpy as np
import pytest
from problems import LinearQuadratic, TooFlat, VanDerPol, options_for, run, zeros

from cmpsp_ros.mpsp import ProblemError
from cmpsp_ros.mpsp.qp import Penalties, QPStatus, solve_qp
from cmpsp_ros.mpsp.qp.dense import condense
from cmpsp_ros.mpsp.results import Status
from cmpsp_ros.mpsp.sqp import CMPSP
from cmpsp_ros.mpsp.sqp.solve import solve


class Saddle(VanDerPol):
    """Problem whose exact Hessian curves downward in the control at the guess."""

    def evaluate(self, X, U):
        there = super().evaluate(X, U)
        bump = 2.0 * np.cos(2.0 * U).sum()
        return replace(there, cost=there.cost + float(bump))

    def linearise(self, X, U, hessian='gauss_newton'):
        lin = super().linearise(X, U, hessian)
        curvature = -8.0 * np.cos(2.0 * U)[:, :, None]
        if hessian != 'exact':
            curvature = np.maximum(curvature, 0.0)
        return replace(lin, L_U=lin.L_U - 4.0 * np.sin(2.0 * U), L_UU=lin.L_UU + curvature)


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
    solution = solve(problem, zeros(problem), options_for(problem), 10)
    assert solution.status is Status.CONVERGED
    assert solution.iterate.index == 2


@pytest.mark.parametrize('seed', range(20))
def test_the_solution_itself_is_no_stall(seed):
    problem = LinearQuadratic(np.random.default_rng(seed), path=0)
    strict = options_for(problem, control_tolerance=1e-9)
    first, _ = run(problem, zeros(problem), strict, 10)
    again, status = run(problem, first.U, strict, 10)
    assert status is Status.CONVERGED
    np.testing.assert_allclose(again.U, first.U, atol=1e-8)


@pytest.mark.parametrize('goal', [(0.0, 0.0), (0.4, -0.2)])
@pytest.mark.parametrize('hessian', ['gauss_newton', 'exact'])
@pytest.mark.parametrize('line_search', [True, False])
def test_converges_to_a_point_that_meets_the_optimality_conditions(goal, hessian, line_search):
    floor, mixed = (-0.8, 1.6) if goal[0] else (-0.5, 2.0)
    problem = VanDerPol(horizon=40, goal=goal, floor=floor, mixed=mixed, limit=3.0)
    options = options_for(problem, hessian=hessian, line_search=line_search)
    iterate, status = run(problem, zeros(problem), options, 200)
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


@pytest.mark.parametrize(
    ('goal', 'floor'), [((0.0, 0.0), -0.5), ((0.4, -0.2), -0.5), ((0.4, -0.2), -0.8)]
)
def test_contradicting_subproblems_are_solved_relaxed(goal, floor):
    problem = VanDerPol(horizon=40, goal=goal, floor=floor, mixed=1.6, limit=1.5)
    options = options_for(problem)
    weights = Penalties(options.penalty_terminal, np.tile(options.penalty_path, (41, 1)))
    iteration = CMPSP(problem, options)
    iterate = iteration.init(zeros(problem))
    needed = 0
    for _ in range(6):
        subproblem = iteration.subproblem(iterate)
        if solve_qp(subproblem, 'daqp').status is not QPStatus.SOLVED:
            needed += 1
            found, other = (solve_qp(subproblem, name, weights) for name in ('daqp', 'clarabel'))
            assert found.status is other.status is QPStatus.SOLVED
            np.testing.assert_allclose(found.dU, other.dU, atol=1e-4)
        iterate = iteration.step(iterate)
        assert iterate.step.qp_status is QPStatus.SOLVED
    assert needed


def test_steps_far_too_long_are_cut_as_far_as_it_takes():
    problem = TooFlat(passes=False)
    iterate, status = run(problem, np.ones((21, 1)), options_for(problem), 300)
    assert status is Status.CONVERGED
    reference, _ = run(VanDerPol(passes=False), np.ones((21, 1)), options_for(problem), 100)
    np.testing.assert_allclose(iterate.U, reference.U, atol=1e-4)


def test_a_step_cut_short_is_not_a_small_change():
    problem = VanDerPol(goal=(0.4, -0.2))
    iteration = CMPSP(problem, options_for(problem))
    at = solve(problem, zeros(problem), options_for(problem), 50).iterate
    assert iteration.terminate(at) is Status.CONVERGED
    long = replace(at, step=replace(at.step, length=1e-3, full_change=1e-3))
    assert iteration.terminate(long) is None


def test_lost_curvature_is_put_back_and_told():
    problem = Saddle(passes=False, limit=2.0)
    guess = np.full((21, 1), 0.1)
    solution = solve(problem, guess, options_for(problem, hessian='exact'), 100)
    assert solution.status is Status.CONVERGED
    assert solution.curvature_lost > 0
    assert solution.history[1].shift > 0.0
    assert solution.history[-1].shift == 0.0
    assert f'lost curvature in {solution.curvature_lost} iterations' in solution.sentence
    plain = solve(problem, guess, options_for(problem), 300)
    assert plain.status is Status.CONVERGED
    assert plain.curvature_lost == 0


@pytest.mark.parametrize('path', [0, 2])
def test_a_cost_that_is_flat_in_one_control_can_be_solved(path):
    """The last control moves nothing; where it costs nothing either, it stays where it is."""
    problem = LinearQuadratic(np.random.default_rng(2), path=path)
    problem.W[-1, 3:] = problem.W[-1, :, 3:] = problem.w[-1, 3:] = 0.0
    problem.h_U[:] = problem.g_U[-1] = 0.0
    solution = solve(problem, np.ones((6, 2)), options_for(problem), 200)
    assert solution.status is Status.CONVERGED
    # The closed form and the Riccati sweep want curvature everywhere.
    assert solution.history[1].shift > 0.0
    np.testing.assert_allclose(solution.iterate.U[-1], 1.0, atol=1e-9)


def test_a_solution_tells_everything_about_its_run():
    problem = VanDerPol(horizon=40, goal=(0.4, -0.2), floor=-0.8, mixed=1.6, limit=1.5)
    solution = solve(problem, zeros(problem), options_for(problem), 100)
    assert solution.status is Status.CONVERGED
    assert [record.index for record in solution.history] == list(range(solution.iterate.index + 1))
    assert solution.terminal_multipliers.shape == (2,)
    assert solution.path_multipliers.shape == (41, 2)
    assert solution.bound_multipliers.shape == (41, 1)
    assert solution.violated == ()
    last = solution.history[-1]
    assert last.U is solution.iterate.U
    assert last.kkt_residual < 1e-6 < solution.history[0].kkt_residual
    assert last.terminal_error < 1e-9
    assert last.active_bounds == {
        (int(k), 0) for k in np.flatnonzero(np.abs(solution.iterate.U[:, 0]) == 1.5)
    }
    assert solution.sentence.startswith('Converged: ')
    none = solve(problem, zeros(problem), options_for(problem), 0)
    assert not none.terminal_multipliers.any()
    assert not none.path_multipliers.any()
    assert not none.bound_multipliers.any()


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


@pytest.mark.parametrize('name', ['daqp', 'clarabel', 'hildreth'])
def test_back_ends_lead_to_the_same_solution(name):
    problem = VanDerPol(goal=(0.2, 0.0), floor=-0.6, limit=2.0)
    strict = options_for(problem, qp=name, output_tolerance=1e-6, control_tolerance=1e-5)
    iterate, status = run(problem, zeros(problem), strict, 100)
    assert status is Status.CONVERGED
    reference, _ = run(problem, zeros(problem), options_for(problem), 100)
    np.testing.assert_allclose(iterate.U, reference.U, atol=1e-4)


@pytest.mark.parametrize(
    ('changes', 'message'),
    [
        ({'penalty_terminal': np.ones(3)}, r'penalty_terminal: found shape \(3,\), wanted \(2,\)'),
        ({'penalty_path': np.ones(1)}, r'penalty_path: found shape \(1,\), wanted \(2,\)'),
        ({'trust_radius': np.ones(1)}, r'trust_radius: found shape \(1,\), wanted \(2,\)'),
        ({'penalty_path': [1.0, -1.0]}, r'penalty_path: found \[1.0, -1.0\], wanted numbers >= 0'),
        ({'penalty_terminal': np.nan}, 'penalty_terminal: found nan, wanted numbers >= 0'),
        ({'penalty_terminal': 'much'}, "penalty_terminal: found 'much', wanted numbers"),
        ({'trust_radius': -0.5}, 'trust_radius: found -0.5, wanted numbers >= 0'),
        ({'kkt_tolerance': -1.0}, 'kkt_tolerance: found -1.0, wanted a number >= 0'),
        ({'qp': 'newton'}, "qp: found 'newton', wanted one of riccati_active_set, clarabel"),
    ],
)
def test_options_that_do_not_fit_are_named(changes, message):
    problem = VanDerPol()
    with pytest.raises(ProblemError, match=message):
        CMPSP(problem, options_for(problem, **changes))


def test_numbers_and_lists_will_do():
    problem = VanDerPol(goal=(0.4, -0.2), floor=-0.5)
    given = options_for(problem, trust_radius=np.full(2, 0.5))
    plain = options_for(
        problem, penalty_terminal=1e3, penalty_path=[1e3, 1e3], trust_radius=[0.5, 0.5]
    )
    wanted, found = (solve(problem, zeros(problem), each, 20) for each in (given, plain))
    np.testing.assert_array_equal(found.iterate.U, wanted.iterate.U)
    listed = solve(problem, zeros(problem).tolist(), given, 20)
    np.testing.assert_array_equal(listed.iterate.U, wanted.iterate.U)


def test_the_optimality_conditions_can_end_a_run():
    problem = VanDerPol(goal=(0.4, -0.2), floor=-0.5)
    loose = options_for(problem, control_tolerance=np.inf, output_tolerance=np.inf)
    early = solve(problem, zeros(problem), replace(loose, kkt_tolerance=np.inf), 100)
    solution = solve(problem, zeros(problem), replace(loose, kkt_tolerance=1e-6), 100)
    assert solution.status is Status.CONVERGED
    assert early.iterate.index < solution.iterate.index
    *before, last = solution.history
    assert last.kkt_residual <= 1e-6 < min(each.kkt_residual for each in before)


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
