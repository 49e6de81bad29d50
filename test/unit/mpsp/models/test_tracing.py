"""Numpy functions as expressions of CasADi, against their differences."""

import math

import numpy as np
import pytest
from problems import assert_same_problem

from cmpsp_ros.mpsp import from_functions
from cmpsp_ros.mpsp.models.casadi_functions import CasadiProblem

N = 8
TABLE = np.random.default_rng(1).normal(size=(N + 1, 2))
TURN = np.array([[0.9, 0.2], [-0.1, 1.0]])


def stated(**changes):
    """Operations of many kinds, with constants and with terms that vary from stage to stage."""

    def F(k, x, u):
        ahead = TURN @ x + 0.1 * np.array([np.sin(x[1]) / (2.0 + x[0] ** 2), u[0] * TABLE[k, 1]])
        ahead[1] += 0.05 * np.exp(-(ahead[0] ** 2)) - np.sqrt(1.0 + u @ u)
        return ahead if k < 5 else -ahead * np.arctan2(x[0], 2.0 + u[0])

    def L(k, x, u):
        return 0.5 * k * u[0] ** 2 + (x @ x if k == N else 0.1 * x.sum() ** 2)

    def g(k, x, u):
        away = 1.0 - (x - TABLE[k]) @ (x - TABLE[k])
        return np.array([away if k % 3 == 0 else -np.inf, -np.inf, u[0] - k, x[1] - 5.0])

    return {
        'horizon': N, 'x0': [1.0, 0.5], 'controls': 1, 'F': F, 'L': L, 'g': g, 'target': [0.0, 1.0],
        'residuals': lambda k, x, u: np.concatenate([x - TABLE[k], np.tanh(u)]),
        'h': lambda x, u: [x[0] * x[1], -x[1] + u[0] ** 3],
    } | changes  # fmt: skip


def test_traced_functions_are_the_same_problem():
    traced, other = from_functions(**stated()), from_functions(**stated(derivatives='central'))
    assert isinstance(traced, CasadiProblem)
    assert not isinstance(other, CasadiProblem)
    U = np.random.default_rng(0).normal(size=(N + 1, 1))
    assert_same_problem(traced, other, U, ('exact', 'projected', 'gauss_newton'), 1e-4)
    X, g = traced.predict(U), traced.evaluate(traced.predict(U), U).g
    applies = np.ones((N + 1, 4), bool)
    applies[:, 0], applies[:, 1], applies[0] = np.arange(N + 1) % 3 == 0, False, [0, 0, 1, 0]
    np.testing.assert_array_equal(g != -np.inf, applies)
    rng = np.random.default_rng(2)
    weights = rng.normal(size=(N, 2)), rng.normal(size=2), applies * rng.normal(size=(N + 1, 4))
    found, wanted = (each.constraint_curvature(X, U, *weights) for each in (traced, other))
    for blocks in zip(found, wanted, strict=True):
        np.testing.assert_allclose(*blocks, atol=1e-4)


def test_a_term_of_one_stage_is_not_evaluated_at_others():
    """The distance has no derivative at stages where the state is where it is measured from."""

    def g(k, x, u):
        return [0.5 - np.sqrt(x @ x) if k == N else u[0] - 9.0]

    given = {'F': lambda k, x, u: x + np.array([0.0, u[0]]), 'x0': [0.0, 0.0], 'g': g}
    traced = from_functions(**stated(**given, residuals=None))
    assert isinstance(traced, CasadiProblem)
    U = np.zeros((N + 1, 1))
    U[N - 1] = 1.0
    X = traced.predict(U)
    lin = traced.linearise(X, U)
    np.testing.assert_allclose(lin.g_X[:, 0], [*[[0.0, 0.0]] * N, [0.0, -1.0]], atol=1e-12)
    rho = np.zeros((N + 1, 1))
    rho[N] = 1.0
    XX, _, _ = traced.constraint_curvature(X, U, np.zeros((N, 2)), np.zeros(2), rho)
    assert np.isfinite(XX).all()


def untraced_F(k, x, u):
    ahead = np.zeros(2)
    ahead[0], ahead[1] = x[0] + 0.1 * u[0], 0.9 * x[1]
    return ahead


@pytest.mark.parametrize(
    'F',
    [
        untraced_F,
        lambda k, x, u: [math.sin(x[0]), x[1] + u[0]],
        lambda k, x, u: [max(x[0], u[0]), x[1]],
        lambda k, x, u: x if x[0] > 0.0 else -x,
        lambda k, x, u: np.linalg.solve(np.eye(2) + u[0] ** 2, x),
        lambda k, x, u: x * sum(u[0] ** i for i in range(k)) + u[0],
        lambda k, x, u: x + 1e-3 * sum(u[0] for _ in range(5000)),
        lambda k, x, u: x + (u if isinstance(u[0], float) else 2.0 * u),
    ],
    ids=['filled', 'math', 'max', 'branch', 'solve', 'every stage another', 'long', 'type'],
)
def test_functions_that_need_values_are_differentiated_numerically(F):
    problem = from_functions(**stated(F=F))
    assert not isinstance(problem, CasadiProblem)
    U = np.random.default_rng(0).normal(size=(N + 1, 1))
    np.testing.assert_allclose(problem.predict(U)[1], F(0, np.array([1.0, 0.5]), U[0]))
