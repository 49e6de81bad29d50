"""A final time that is free, inequalities at the end and equalities, against analytic answers."""

import casadi
import numpy as np
import pytest

from cmpsp_ros.mpsp import ProblemError, Status, from_casadi, from_functions, solve
from examples.common import ipopt

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


def cart_of_functions(**changes):
    """The same cart from numpy functions."""

    def move(_k, x, u, T):
        h = T / N
        return np.array([x[0] + h * x[1] + 0.5 * h**2 * u[0], x[1] + h * u[0]])

    stated = {
        'horizon': N, 'x0': [0.0, 0.0], 'controls': 1, 'final_time': (0.1, 3.0, 20.0), 'F': move,
        'L': lambda _k, _x, _u, T: T / (N + 1), 'h': lambda x, _u, _T: x, 'target': [1.0, 0.0],
        'lower': -1.0, 'upper': 1.0,
    }  # fmt: skip
    return from_functions(**{**stated, **changes})


@pytest.mark.parametrize('guess', [0.5, 3.0, 9.0])
@pytest.mark.parametrize('make', [cart, cart_of_functions])
def test_least_time_is_that_of_full_thrust_and_full_brake(make, guess):
    solution = solve(make(final_time=(0.1, guess, 20.0)), np.zeros((N + 1, 2)))
    assert solution.status is Status.CONVERGED
    assert solution.iterate.X[-1, 2] == pytest.approx(2.0, abs=1e-6)
    U = solution.iterate.U[:N, 0]
    np.testing.assert_allclose(U, np.where(np.arange(N) < N // 2, 1.0, -1.0), atol=1e-4)


@pytest.mark.parametrize('make', [cart, cart_of_functions])
def test_least_time_is_bounded(make):
    solution = solve(make(final_time=(2.5, 3.0, 20.0)), np.zeros((N + 1, 2)))
    assert solution.status is Status.CONVERGED
    assert solution.iterate.X[-1, 2] == pytest.approx(2.5, abs=1e-9)


POINTS = {10: (2.0, 1.0), 20: (4.0, -1.0)}
PHASES = {
    'horizon': 30, 'x0': [0.0, 0.0, 0.0, 1.0], 'target': [6.0, 0.0], 'lower': -1.0, 'upper': 1.0,
    'final_time': [(0.5, 2.0, 10.0)] * 3,
}  # fmt: skip


def car_rate(x, u, h, cos, sin):
    turn, v = x[2] + 0.5 * h * x[3] * u[1], x[3] + 0.5 * h * u[0]
    return v * cos(turn), v * sin(turn), v * u[1], u[0]


def car_past_points():
    """A car past two points to a third, in the least time, as stated for `from_casadi`."""
    x, u = casadi.SX.sym('x', 4), casadi.SX.sym('u', 2)
    T, p, values = casadi.SX.sym('T', 3), casadi.SX.sym('p', 5), np.zeros((31, 5))
    values[range(30), np.arange(30) // 10] = 1.0
    for k, point in POINTS.items():
        values[k, 3:] = point
    h, off = casadi.dot(T, p[:3]) / 10, x[:2] - p[3:]
    applies = np.repeat([[k in POINTS] for k in range(31)], 4, axis=1)
    return {
        **PHASES, 'x': x, 'u': u, 'T': T, 'p': p, 'p_values': values, 'h': x[:2],
        'F': x + h * casadi.vertcat(*car_rate(x, u, h, casadi.cos, casadi.sin)),
        'L': casadi.sum1(T) / 31 + 0.05 * casadi.sumsqr(u), 'g': casadi.vertcat(off, -off),
        'applies': applies,
    }  # fmt: skip


def test_phases_of_free_length_past_points_beside_ipopt():
    stated, U = car_past_points(), np.zeros((31, 5))
    solution = solve(from_casadi(**stated), U)
    assert solution.status is Status.CONVERGED
    X = solution.iterate.X
    np.testing.assert_allclose(X[[10, 20, 30], :2], [*POINTS.values(), (6.0, 0.0)], atol=1e-6)
    # Every phase has a time of its own, none of which is the guess or at a bound.
    assert (np.abs(np.diff(X[-1, 4:])) > 0.05).all()
    other = ipopt(stated, U, from_casadi(**stated).predict(U))
    assert solution.iterate.evaluation.cost == pytest.approx(other.cost, rel=1e-6)


def test_phases_of_functions_are_those_of_casadi():
    def at_points(k, x, _u, _T):
        off = x[:2] - np.array(POINTS.get(k, (0.0, 0.0)))
        return np.concatenate([off, -off]) if k in POINTS else np.full(4, -np.inf)

    def F(k, x, u, T):
        h = T[k // 10] / 10
        return x + h * np.array(car_rate(x, u, h, np.cos, np.sin))

    ours = from_functions(
        **PHASES, controls=2, F=F, g=at_points, h=lambda x, _u, _T: x[:2],
        L=lambda _k, _x, u, T: T.sum() / 31 + 0.05 * u @ u,
    )  # fmt: skip
    theirs, rng = from_casadi(**car_past_points()), np.random.default_rng(0)
    U = rng.uniform(-0.3, 0.3, (31, 5))
    X = theirs.predict(U)
    np.testing.assert_allclose(ours.predict(U), X, rtol=1e-12, atol=1e-12)
    found, wanted = (each.linearise(X, U, 'exact') for each in (ours, theirs))
    for name in ('A', 'B', 'L_X', 'L_U', 'output_error', 'h_X', 'g', 'g_X', 'g_U'):
        values = getattr(found, name), getattr(wanted, name)
        np.testing.assert_allclose(*values, rtol=1e-9, atol=1e-9, err_msg=name)


@pytest.mark.parametrize(
    ('make', 'times', 'wanted'),
    [
        *((make, each, '0 < least <= guess')
          for make in (cart, cart_of_functions) for each in ((2.0, 1.0, 3.0), (0.0, 1.0, 2.0))),
        (cart, None, '0 < least <= guess'),
        *((lambda **more: from_casadi(**{**car_past_points(), **more}), each, 'for 3 phases')
          for each in ((0.5, 2.0, 10.0), [(0.5, 2.0, 10.0)] * 2, [(1.0, 0.5, 2.0)] * 3)),
    ],
)  # fmt: skip
def test_times_that_do_not_fit_are_named(make, times, wanted):
    with pytest.raises(ProblemError, match=f'final_time: found .* {wanted}'):
        make(final_time=times)


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


def test_an_inequality_at_the_end_is_a_path_constraint_of_the_last_stage():
    def solved(**stated):
        problem = from_functions(
            horizon=N, x0=[0.0, 0.0], controls=1, L=lambda _k, _x, u: 0.05 * u[0] ** 2,
            F=lambda _k, x, u: np.array([x[0] + 0.1 * x[1] + 0.005 * u[0], x[1] + 0.1 * u[0]]),
            **stated,
        )  # fmt: skip
        solution = solve(problem, np.zeros((N + 1, 1)))
        assert solution.status is Status.CONVERGED
        return solution.iterate

    # The least effort to come a metre further at least, and at rest, is that to come just so far.
    at_least = solved(
        h=lambda x, _u: x[1:], target=[0.0],
        g=lambda k, x, _u: np.array([1.0 - x[0] if k == N else -np.inf]),
    )  # fmt: skip
    there = solved(h=lambda x, _u: x, target=[1.0, 0.0])
    np.testing.assert_allclose(at_least.U, there.U, atol=1e-9)


def test_an_equality_along_the_path_is_two_inequalities():
    wanted = np.sin(0.3 * np.arange(N + 1))

    def both(k, _x, u):
        off = u[0] + u[1] - wanted[k]
        return np.array([off, -off])

    problem = from_functions(
        horizon=N, x0=[0.0], controls=2, F=lambda _k, x, u: x + 0.1 * (u[0] - u[1]),
        L=lambda _k, _x, u: 0.5 * u[0] ** 2 + u[1] ** 2, g=both,
    )  # fmt: skip
    solution = solve(problem, np.zeros((N + 1, 2)))
    assert solution.status is Status.CONVERGED
    np.testing.assert_allclose(solution.iterate.U, np.outer(wanted, [2 / 3, 1 / 3]), atol=1e-9)
