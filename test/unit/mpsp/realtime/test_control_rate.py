"""The cost on changes of control in compiled code, against the problem that it stands for."""

import numpy as np
import pytest
from problems import assert_derivatives
from runs import assert_same, improved, iterates, robot_options, robot_problem

from cmpsp_ros.mpsp.control_rate import ControlRateProblem
from cmpsp_ros.mpsp.realtime.control_rate import ControlRateData, evaluate, linearise, predict
from cmpsp_ros.mpsp.riccati.stage_qp import empty_qp

HELD = np.array([40.0, 47.0])


def both(steps=12, weight=0.7):
    inner = robot_problem(steps)
    return ControlRateProblem(inner, weight, HELD), ControlRateData(inner.data, weight, HELD)


def controls(steps=12):
    return 45.0 + 3.0 * np.random.default_rng(0).normal(size=(steps + 1, 2))


def test_prediction_and_value():
    problem, data = both()
    U = controls()
    X = np.full((13, 5), np.nan)
    predict(data, U, X)
    np.testing.assert_array_equal(X, problem.predict(U))
    wanted = problem.evaluate(X, U)
    output_error, g = np.full(2, np.nan), np.full((13, 4), np.nan)
    assert evaluate(data, X, U, output_error, g) == pytest.approx(wanted.cost, rel=1e-13)
    np.testing.assert_array_equal(output_error, wanted.output_error)
    np.testing.assert_array_equal(g, wanted.g)


def test_derivatives():
    problem, data = both()
    U = controls()
    X, qp = problem.predict(U), empty_qp(12, 5, 2, 2, 4)
    # Twice, since nothing may add up from one iteration to the next.
    linearise(data, X, U + 1.0, qp)
    linearise(data, X, U, qp)
    for name, wanted in vars(problem.linearise(X, U)).items():
        np.testing.assert_allclose(getattr(qp, name), wanted, rtol=1e-13, err_msg=name)


def test_the_problem_that_it_is_compared_with_has_the_derivatives_of_its_cost():
    problem, _ = both(4)
    # What weighs the change between iterations is in the Hessian alone.
    assert_derivatives(problem, controls(4), atol=1e-5)


# One worker compiles the iteration for this class of data, for all tests that need it.
@pytest.mark.xdist_group('control_rate')
@pytest.mark.timeout(600)
@pytest.mark.parametrize('weight', [0.1, 10.0])
def test_iterates_are_those_of_the_general_iteration(weight):
    problem, data = both(20, weight)
    options = robot_options(problem, trust_radius=np.array([np.inf, np.inf, 0.6, np.inf, np.inf]))
    guess = controls(20)
    for iterate in iterates(problem, options, guess, 6)[1:]:
        room = improved(problem, data, options, guess, iterate.index)
        assert_same(room, iterate, options)
