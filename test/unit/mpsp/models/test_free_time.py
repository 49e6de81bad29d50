"""A final time that is free, against the analytic answer; problems that are updated."""

import casadi
import numpy as np
import pytest

from cmpsp_ros.mpsp import ProblemError, Status, from_casadi, solve

N = 40


def cart(**changes):
    """A cart brought to rest a metre further, at thrusts up to 1, in as little time as possible."""
    x, u, T = casadi.SX.sym('x', 2), casadi.SX.sym('u'), casadi.SX.sym('T')
    h = T / N
    stated = {
        'horizon': N, 'x0': [0.0, 0.0], 'x': x, 'u': u, 'T': T, 'final_time': (0.1, 3.0, 20.0),
        'F': [x[0] + h * x[1] + 0.5 * h**2 * u, x[1] + h * u], 'L': T / (N + 1),
        'h': x, 'target': [1.0, 0.0], 'lower': -1.0, 'upper': 1.0,
    }  # fmt: skip
    return from_casadi(**{**stated, **changes})


@pytest.mark.parametrize('guess', [0.5, 3.0, 9.0])
def test_least_time_is_that_of_full_thrust_and_full_brake(guess):
    solution = solve(cart(final_time=(0.1, guess, 20.0)), np.zeros((N + 1, 2)))
    assert solution.status is Status.CONVERGED
    assert solution.iterate.X[-1, 2] == pytest.approx(2.0, abs=1e-6)
    U = solution.iterate.U[:N, 0]
    np.testing.assert_allclose(U, np.where(np.arange(N) < N // 2, 1.0, -1.0), atol=1e-4)


def test_least_time_is_bounded():
    solution = solve(cart(final_time=(2.5, 3.0, 20.0)), np.zeros((N + 1, 2)))
    assert solution.status is Status.CONVERGED
    assert solution.iterate.X[-1, 2] == pytest.approx(2.5, abs=1e-9)


@pytest.mark.parametrize('time', [None, (2.0, 1.0, 3.0), (0.0, 1.0, 2.0)])
def test_times_that_do_not_fit_are_named(time):
    with pytest.raises(ProblemError, match=r'final_time: found .* 0 < least <= guess'):
        cart(final_time=time)


def test_a_final_time_without_its_symbol():
    with pytest.raises(ProblemError, match='T: found none with final_time'):
        cart(T=None)


def test_an_updated_problem_is_the_one_built_anew():
    start, goal = [0.5, 0.1, 3.0], [2.0, 0.3]
    updated = cart().updated(x0=start, target=goal)
    anew = cart(x0=start[:2], target=goal)
    U = np.random.default_rng(0).normal(size=(N + 1, 2))
    np.testing.assert_array_equal(updated.predict(U), anew.predict(U))
    X = anew.predict(U)
    np.testing.assert_array_equal(
        updated.evaluate(X, U).output_error, anew.evaluate(X, U).output_error
    )
    assert cart().predict(U)[0, 0] == 0.0
    with pytest.raises(ProblemError, match='x0: found shape'):
        cart().updated(x0=[1.0])
