"""The exact merit against difference quotients, and the search that lowers it."""

from dataclasses import replace

import numpy as np
import pytest
from problems import LinearQuadratic, VanDerPol

from cmpsp_ros.mpsp.merit import Merit, Trial, search
from cmpsp_ros.mpsp.problem import Evaluation
from cmpsp_ros.mpsp.qp import QPStatus, solve_qp
from cmpsp_ros.mpsp.subproblem import Subproblem


def prepared(problem, U):
    X = problem.predict(U)
    lin = problem.linearise(X, U, 'exact')
    lower, upper = problem.control_lower - U, problem.control_upper - U
    free = np.full(problem.size.state, np.inf)
    subproblem = Subproblem(lin, np.maximum(lower, -5.0), np.minimum(upper, 5.0), free)
    return Trial(0.0, U, X, problem.evaluate(X, U)), subproblem


def wide(subproblem):
    shape = subproblem.lower.shape
    return replace(subproblem, lower=np.full(shape, -50.0), upper=np.full(shape, 50.0))


def slope(subproblem):
    return subproblem.condensed.c.reshape(subproblem.lower.shape)


def merit_of(problem, terminal=7.0, path=11.0):
    size = problem.size
    return Merit(np.full(size.output, terminal), np.full((size.horizon + 1, size.path), path))


def test_value_by_hand():
    merit = Merit(np.array([2.0, 3.0]), np.array([[1.0, 4.0], [5.0, 6.0]]))
    g = np.array([[-np.inf, 0.5], [-1.0, 2.0]])
    value = merit.value(Evaluation(10.0, np.array([-1.0, 2.0]), g))
    assert value == 10.0 + (2.0 + 6.0) + (2.0 + 12.0)


@pytest.mark.parametrize('bad', [np.nan, np.inf])
def test_value_of_what_is_not_finite_is_infinite(bad):
    merit = Merit(np.ones(1), np.ones((1, 1)))
    good = Evaluation(0.0, np.zeros(1), np.zeros((1, 1)))
    assert merit.value(good) == 0.0
    assert merit.value(replace(good, cost=bad)) == np.inf
    assert merit.value(replace(good, output_error=np.array([bad]))) == np.inf
    assert merit.value(replace(good, g=np.array([[bad]]))) == np.inf


@pytest.mark.parametrize('seed', range(6))
def test_predicted_decrease_is_the_slope_of_the_merit(seed):
    rng = np.random.default_rng(seed)
    problem = VanDerPol(horizon=10, floor=0.2, mixed=0.8)
    start, subproblem = prepared(problem, rng.normal(size=(11, 1)))
    assert (start.evaluation.g > 0.0).any()
    merit = merit_of(problem)
    direction = rng.normal(size=(11, 1))
    before = merit.value(start.evaluation)
    for length in (1e-4, 1e-5, 1e-6):
        U = start.U + length * direction
        X = problem.predict(U)
        actual = before - merit.value(problem.evaluate(X, U))
        promised = merit.predicted_decrease(subproblem, length * direction)
        assert actual == pytest.approx(promised, abs=2e3 * length**2 + 1e-11)


def test_predicted_decrease_is_exact_in_the_constraints_of_a_linear_problem():
    rng = np.random.default_rng(1)
    problem = LinearQuadratic(rng)
    start, subproblem = prepared(problem, rng.normal(size=(6, 2)))
    merit = merit_of(problem)
    dU = rng.normal(size=(6, 2))
    U = start.U + dU
    after = merit.value(problem.evaluate(problem.predict(U), U))
    quadratic = 0.5 * dU.ravel() @ subproblem.condensed.H @ dU.ravel()
    promised = merit.predicted_decrease(subproblem, dU) - quadratic
    assert merit.value(start.evaluation) - after == pytest.approx(promised, rel=1e-9)


def test_no_step_promises_nothing():
    problem = VanDerPol(horizon=5, floor=0.2)
    start, subproblem = prepared(problem, np.ones((6, 1)))
    assert merit_of(problem).predicted_decrease(subproblem, np.zeros((6, 1))) == 0.0
    assert start.length == 0.0


def test_above_multipliers_raises_only_what_is_too_low():
    problem = LinearQuadratic(np.random.default_rng(3))
    U = np.zeros((6, 2))
    _, subproblem = prepared(problem, U)
    subproblem = wide(subproblem)
    solution = solve_qp(subproblem, 'daqp')
    assert solution.status is QPStatus.SOLVED
    assert solution.path.any()
    high = merit_of(problem, 1e6, 1e6)
    same = high.above_multipliers(solution)
    np.testing.assert_array_equal(same.terminal, high.terminal)
    np.testing.assert_array_equal(same.path, high.path)

    low = merit_of(problem, 1e-3, 1e-3)
    raised = low.above_multipliers(solution)
    assert (raised.terminal > np.abs(solution.terminal)).all()
    pulls = solution.path > 1e-3
    assert (raised.path[pulls] > solution.path[pulls]).all()
    assert (raised.path >= 1e-3).all()
    np.testing.assert_array_equal(raised.path[~(solution.path > 0.0)], 1e-3)
    np.testing.assert_array_equal(low.path, 1e-3)
    # What it is for: the solution of the subproblem is then a direction of descent.
    assert raised.predicted_decrease(subproblem, solution.dU) > 0.0


def test_search_takes_the_full_step_where_it_is_good():
    problem = LinearQuadratic(np.random.default_rng(4))
    start, subproblem = prepared(problem, np.zeros((6, 2)))
    solution = solve_qp(wide(subproblem), 'daqp')
    assert solution.status is QPStatus.SOLVED
    merit = merit_of(problem).above_multipliers(solution)
    promised = merit.predicted_decrease(subproblem, solution.dU)
    trial = search(problem, start, solution.dU, merit, promised)
    assert trial.length == 1.0
    np.testing.assert_array_equal(trial.U, start.U + solution.dU)
    np.testing.assert_array_equal(trial.X, problem.predict(trial.U))
    assert merit.value(trial.evaluation) < merit.value(start.evaluation)


def test_search_does_not_move_where_nothing_is_lower():
    problem = VanDerPol(horizon=8)
    start, subproblem = prepared(problem, np.zeros((9, 1)))
    merit = merit_of(problem, terminal=0.0)
    uphill = slope(subproblem)
    promised = merit.predicted_decrease(subproblem, uphill)
    trial = search(problem, start, uphill, merit, promised)
    assert trial.length == 0.0
    assert trial.U is start.U
    assert trial.evaluation is start.evaluation


def test_search_shortens_a_step_that_is_too_long():
    problem = VanDerPol(horizon=8)
    start, subproblem = prepared(problem, np.ones((9, 1)))
    merit = merit_of(problem, terminal=0.0)
    before = merit.value(start.evaluation)
    downhill = -slope(subproblem)
    lengths = set()
    for factor in (0.05, 0.5, 1.0, 2.0):
        dU = factor * downhill
        promised = merit.predicted_decrease(subproblem, dU)
        trial = search(problem, start, dU, merit, promised)
        lengths.add(trial.length)
        if trial.length:
            decrease = before - merit.value(trial.evaluation)
            assert decrease > 0.0
    assert 1.0 in lengths
    assert lengths & {0.5, 0.25, 0.125, 0.0625}


def test_search_falls_back_on_the_best_that_is_lower():
    problem = VanDerPol(horizon=8)
    start, subproblem = prepared(problem, np.ones((9, 1)))
    merit = merit_of(problem, terminal=0.0)
    downhill = -0.05 * slope(subproblem)
    trial = search(problem, start, downhill, merit, promised=1e12)
    values = []
    for length in (1.0, 0.5, 0.25, 0.125, 0.0625):
        U = start.U + length * downhill
        values.append(merit.value(problem.evaluate(problem.predict(U), U)))
    assert merit.value(trial.evaluation) == min(values)


def test_search_stays_within_the_bounds():
    problem = VanDerPol(horizon=8, limit=0.5)
    start, subproblem = prepared(problem, np.full((9, 1), 0.5))
    merit = merit_of(problem, terminal=0.0)
    # Rounding alone can carry a step past its bound.
    trial = search(problem, start, -3.0 * slope(subproblem), merit, 0.0)
    assert trial.length > 0.0
    assert np.abs(trial.U).max() <= 0.5


def test_search_never_takes_what_is_not_finite():
    problem = VanDerPol(horizon=8)
    start, _ = prepared(problem, np.zeros((9, 1)))
    trial = search(problem, start, np.full((9, 1), 1e200), merit_of(problem), 0.0)
    assert trial.length == 0.0
