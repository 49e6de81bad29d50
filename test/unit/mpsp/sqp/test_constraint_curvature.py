"""The constraints' curvature against differences of their gradient, and what it is good for."""

import casadi
import numpy as np
import pytest
from problems import VanDerPol, options_for

from cmpsp_ros.mpsp import (
    ControlRateProblem,
    ProblemError,
    Status,
    from_casadi,
    from_functions,
    solve,
)
from cmpsp_ros.mpsp.sqp.lagrangian import costates

N, T = 12, 0.1


def by_casadi():
    x, u, p = casadi.SX.sym('x', 2), casadi.SX.sym('u'), casadi.SX.sym('p')
    return from_casadi(
        horizon=N, x0=[0.3, 0.1], x=x, u=u, p=p, p_values=np.arange(N + 1.0),
        F=[x[0] + T * x[1] * u, x[1] + T * casadi.sin(x[0] + 0.1 * p * u)],
        L=u**2 + x[0] ** 4, h=[x[0] * x[1], x[1] ** 3], target=[0.34, 0.4],
        g=[x[0] ** 2 + u**2 - 2.0, -2.0 + x[1] * u],
    )  # fmt: skip


def by_functions():
    return from_functions(
        horizon=N, x0=[0.3, 0.1], controls=1,
        F=lambda k, x, u: np.array([
            x[0] + T * x[1] * u[0], x[1] + T * np.sin(x[0] + 0.1 * k * u[0]),
        ]),
        L=lambda _k, x, u: u[0] ** 2 + x[0] ** 4,
        h=lambda x, _u: np.array([x[0] * x[1], x[1] ** 3]), target=[0.34, 0.4],
        g=lambda _k, x, u: np.array([x[0] ** 2 + u[0] ** 2 - 2.0, -2.0 + x[1] * u[0]]),
    )  # fmt: skip


def lagrangian_gradient(problem, X, U, weights):
    """Gradient of ``costates' F + terminal' h + path' g`` at each stage by ``(X_k, U_k)``."""
    mu, terminal, path = weights
    lin = problem.linearise(X, U)
    by_X = np.einsum('kli,kl->ki', lin.g_X, path)
    by_U = np.einsum('kla,kl->ka', lin.g_U, path)
    by_X[:-1] += np.einsum('kij,ki->kj', lin.A, mu)
    by_U[:-1] += np.einsum('kia,ki->ka', lin.B, mu)
    by_X[-1] += lin.h_X.T @ terminal
    by_U[-1] += lin.h_U.T @ terminal
    return np.hstack([by_X, by_U])


@pytest.mark.parametrize('make', [by_casadi, by_functions])
@pytest.mark.parametrize('with_rate', [False, True])
def test_it_is_the_derivative_of_the_gradient(make, with_rate):
    problem, rng = make(), np.random.default_rng(3)
    if with_rate:
        problem = ControlRateProblem(problem, 0.7, np.array([0.2]))
    n, r = problem.size.state, problem.size.control
    X, U = rng.normal(size=(N + 1, n)), rng.normal(size=(N + 1, r))
    path = np.abs(rng.normal(size=(N + 1, 2)))
    # Neither is the first constraint's the control's alone, nor do any apply where g is -inf.
    path[problem.linearise(X, U).g == -np.inf] = 0.0
    weights = rng.normal(size=(N, n)), rng.normal(size=2), path
    XX, UX, UU = problem.constraint_curvature(X, U, *weights)
    for j in range(n + r):
        step = 1e-5 * np.eye(n + r)[j]
        ahead = lagrangian_gradient(problem, X + step[:n], U + step[n:], weights)
        behind = lagrangian_gradient(problem, X - step[:n], U - step[n:], weights)
        column = (ahead - behind) / 2e-5
        found = (
            np.concatenate([XX, UX], axis=1)[:, :, j]
            if j < n
            else np.concatenate([UX.swapaxes(1, 2), UU], axis=1)[:, :, j - n]
        )
        np.testing.assert_allclose(found, column, atol=2e-5)


def test_costates_make_the_lagrangian_stationary_in_the_states():
    problem = by_casadi()
    solution = solve(
        problem, np.zeros((N + 1, 1)), options_for(problem, control_tolerance=1e-8), 100
    )
    assert solution.status is Status.CONVERGED
    at = solution.iterate
    lin = problem.linearise(at.X, at.U)
    mu = costates(lin, at.step.terminal_multipliers, at.step.path_multipliers)
    # What is left is the gradient in the controls, 0 at a solution.
    reduced = lin.L_U + np.einsum('kla,kl->ka', lin.g_U, at.step.path_multipliers)
    reduced[:-1] += np.einsum('kia,ki->ka', lin.B, mu[1:])
    reduced[-1] += lin.h_U.T @ at.step.terminal_multipliers
    np.testing.assert_allclose(reduced + at.step.bound_multipliers, 0.0, atol=1e-5)


def cart_pole():
    """A pole swung up in two seconds: dynamics so curved that the cost's Hessian says little."""
    steps, x, u = 40, casadi.SX.sym('x', 4), casadi.SX.sym('u')

    def rate(x):
        s, c = casadi.sin(x[1]), casadi.cos(x[1])
        along = (0.15 * s * x[3] ** 2 + u + 2.943 * c * s) / (1.3 - 0.3 * c**2)
        about = -(0.15 * c * s * x[3] ** 2 + u * c + 12.753 * s) / (0.65 - 0.15 * c**2)
        return casadi.vertcat(x[2], x[3], along, about)

    h = 2.0 / steps
    k1 = rate(x)
    k2 = rate(x + 0.5 * h * k1)
    k3 = rate(x + 0.5 * h * k2)
    k4 = rate(x + h * k3)
    return from_casadi(
        horizon=steps, x0=np.zeros(4), x=x, u=u, F=x + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4),
        L=h * u**2, h=x, target=[1.0, np.pi, 0.0, 0.0], lower=-20.0, upper=20.0,
    )  # fmt: skip


def test_a_swing_up_converges_by_multiple_shooting_and_not_by_the_papers_iteration():
    problem = cart_pole()
    guess = np.zeros((41, 1))
    shot, papers = (
        solve(problem, guess, options_for(problem, method=method), 120)
        for method in ('multiple_shooting', 'cmpsp')
    )
    assert shot.status is Status.CONVERGED
    assert shot.is_minimum
    assert papers.status is Status.ITERATION_LIMIT
    assert shot.history[-1].kkt_residual < 1e-10 < papers.history[-1].kkt_residual
    # Quadratic at the end: the last full step nearly squares the error.
    before, last = (each.kkt_residual for each in shot.history[-2:])
    assert last < before**1.5


def test_a_problem_that_lacks_it_says_so():
    problem = VanDerPol()
    with pytest.raises(ProblemError, match=r'lacks next_states or constraint_curvature'):
        solve(problem, np.zeros((21, 1)), options_for(problem, method='multiple_shooting'), 5)
    solution = solve(problem, np.zeros((21, 1)), options_for(problem), 100)
    assert solution.status is Status.CONVERGED
    assert solution.is_minimum is None
    assert 'not judged' in solution.sentence
