"""A cost and a limit on the change of control, as a wrapper of any problem."""

import numpy as np
import pytest
from problems import LinearQuadratic, VanDerPol, assert_derivatives

from cmpsp_ros.mpsp import Options, ProblemError
from cmpsp_ros.mpsp.models import ControlRateProblem
from cmpsp_ros.mpsp.results import Status
from cmpsp_ros.mpsp.sqp.solve import solve


def test_derivatives():
    rng = np.random.default_rng(0)
    inner = VanDerPol(horizon=5, floor=-0.5, mixed=2.0)
    problem = ControlRateProblem(inner, 3.0, np.array([0.7]))
    assert_derivatives(problem, rng.normal(size=(6, 1)), 'exact')
    limited = ControlRateProblem(inner, 3.0, np.array([0.7]), 0.5)
    assert_derivatives(limited, rng.normal(size=(6, 1)), 'exact')
    linear = LinearQuadratic(rng, horizon=4)
    assert_derivatives(
        ControlRateProblem(linear, 0.4, rng.normal(size=2)), rng.normal(size=(5, 2)), 'exact'
    )


def test_cost_is_that_of_the_changes():
    rng = np.random.default_rng(1)
    inner = LinearQuadratic(rng, horizon=4)
    U, previous = rng.normal(size=(5, 2)), rng.normal(size=2)
    problem = ControlRateProblem(inner, 3.0, previous)
    X = problem.predict(U)
    plain, value = inner.evaluate(inner.predict(U), U), problem.evaluate(X, U)
    changes = np.diff(np.vstack([previous, U]), axis=0)
    assert value.cost - plain.cost == pytest.approx(1.5 * (changes**2).sum())
    np.testing.assert_array_equal(value.g, plain.g)
    np.testing.assert_array_equal(value.output_error, plain.output_error)
    np.testing.assert_array_equal(X[:, :3], inner.predict(U))


@pytest.mark.parametrize('weight', [-1.0, np.nan, -1e-12])
def test_bad_weight_is_named(weight):
    with pytest.raises(ProblemError, match=r'weight: found .*, wanted a number >= 0'):
        ControlRateProblem(VanDerPol(), weight, np.zeros(1))


def test_bad_previous_control_is_named():
    with pytest.raises(ProblemError, match=r'previous: found shape \(2,\), wanted \(1,\)'):
        ControlRateProblem(VanDerPol(), 1.0, np.zeros(2))


def test_rows_of_the_limit_are_how_far_each_change_exceeds_it():
    rng = np.random.default_rng(5)
    inner, previous = LinearQuadratic(rng, horizon=4), rng.normal(size=2)
    problem, U = ControlRateProblem(inner, 0.0, previous, 0.3), rng.normal(size=(5, 2))
    g = problem.evaluate(problem.predict(U), U).g
    changes = np.diff(np.vstack([previous, U]), axis=0)
    np.testing.assert_array_equal(g[:, :-4], inner.evaluate(inner.predict(U), U).g)
    np.testing.assert_allclose(g[:4, [-4, -2]], changes[:4] - 0.3)
    np.testing.assert_allclose(g[:4, [-3, -1]], -changes[:4] - 0.3)
    # The last control moves nothing.
    assert (g[4, -4:] == -np.inf).all()


@pytest.mark.parametrize('penalty', [1e-3, 1e3])
def test_a_hard_limit_is_kept_however_much_else_is_violated(penalty):
    """The goal cannot be met within the limit: it is the goal that gives way."""
    inner, limit = VanDerPol(horizon=10, floor=-0.1), 0.05
    problem = ControlRateProblem(inner, 0.0, np.array([0.2]), limit)
    guess = np.full((11, 1), 0.2)
    weights = np.array([penalty] * inner.size.path + [np.inf, np.inf])
    found = solve(problem, guess, Options(np.full(inner.size.output, penalty), weights), 30)
    changes = np.abs(np.diff(np.append(0.2, found.iterate.U[:-1, 0])))
    assert changes.max() == pytest.approx(limit, abs=1e-9)
    assert found.status is Status.INFEASIBLE
    assert found.iterate.step.needed_slack


@pytest.mark.parametrize('limit', [0.0, -1.0, np.nan])
def test_bad_limit_is_named(limit):
    with pytest.raises(ProblemError, match=r'max_change: found .*, wanted a number > 0'):
        ControlRateProblem(VanDerPol(), 1.0, np.zeros(1), limit)
