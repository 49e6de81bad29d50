"""Problems of different kinds, each against an independent solver."""

import casadi
import numpy as np
import pytest
from reference_solution import assert_agrees, options_for

from cmpsp_ros.mpsp import CMPSP, from_casadi, from_functions, solve

KINDS = ('gauss_newton', 'exact', 'projected')


def symbols(states, controls=1):
    return casadi.SX.sym('x', states), casadi.SX.sym('u', controls)


def by_midpoint(rate, x, dt):
    return x + dt * rate(x + 0.5 * dt * rate(x))


def oscillator():
    """Van der Pol's, brought to rest under bounds on control and state."""
    x, u = symbols(2)
    rate = lambda s: casadi.vertcat(s[1], (1 - s[0] ** 2) * s[1] - s[0] + u)  # noqa: E731
    k1 = rate(x)
    k2 = rate(x + 0.05 * k1)
    k3 = rate(x + 0.05 * k2)
    k4 = rate(x + 0.1 * k3)
    return {
        'horizon': 50, 'x0': (1.0, 0.0), 'x': x, 'u': u,
        'F': x + 0.1 / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4),
        'residuals': [x[0], x[1], 0.5 * u],
        'h': x, 'target': (0.0, 0.0), 'g': [-0.4 - x[1]], 'lower': -0.9, 'upper': 0.9,
    }  # fmt: skip


@pytest.mark.parametrize('hessian', KINDS)
def test_an_oscillator_comes_to_rest(hessian):
    stated = oscillator()
    problem = from_casadi(**stated)
    options = options_for(problem, hessian=hessian)
    last = assert_agrees(problem, stated, np.zeros((51, 1)), options).history[-1]
    assert len(last.active_path) > 2
    assert len(last.active_bounds) > 2
    assert last.violation < 1e-8


def motor():
    """Pays for the power it draws, torque times speed: a cost with cross terms L_XU."""
    x, u = symbols(2)
    friction = 0.3 * x[1] * casadi.sqrt(0.1 + x[1] ** 2)
    return {
        'horizon': 40, 'x0': (0.0, 0.0), 'x': x, 'u': u,
        'F': [x[0] + 0.1 * x[1], x[1] + 0.1 * (u - friction - 0.5 * casadi.sin(x[0]))],
        'L': 0.5 * u**2 + 0.8 * u * x[1] + 0.4 * x[1] ** 2,
        'h': x, 'target': (3.0, 0.0), 'g': [x[1] - 1.0], 'lower': -1.2, 'upper': 1.2,
    }  # fmt: skip


@pytest.mark.parametrize('hessian', KINDS)
def test_a_motor_turns_at_least_cost(hessian):
    stated = motor()
    problem = from_casadi(**stated)
    U = np.zeros((41, 1))
    assert problem.linearise(problem.predict(U), U, hessian).L_UX.any()
    solution = assert_agrees(problem, stated, U, options_for(problem, hessian=hessian))
    assert len(solution.history[-1].active_path) > 3


@pytest.mark.parametrize('hessian', ['gauss_newton', 'exact'])
def test_a_pendulum_swings_up(hessian):
    """With a torque too weak to lift it at once; mass, length and gravity are 1."""
    x, u = symbols(2)
    rate = lambda s: casadi.vertcat(s[1], -casadi.sin(s[0]) + u)  # noqa: E731
    stated = {
        'horizon': 80, 'x0': (0.0, 0.0), 'x': x, 'u': u, 'F': by_midpoint(rate, x, 0.1),
        'residuals': [u], 'h': x, 'target': (np.pi, 0.0), 'lower': -0.6, 'upper': 0.6,
    }  # fmt: skip
    problem = from_casadi(**stated)
    guess = -0.3 * np.cos(0.1 * np.arange(81))[:, None]
    X = assert_agrees(problem, stated, guess, options_for(problem, hessian=hessian)).iterate.X
    np.testing.assert_allclose(X[-1], [np.pi, 0.0], atol=1e-8)
    # It has to swing back first.
    assert X[:, 0].min() < -0.5


def test_a_unicycle_follows_a_figure_of_eight_faster_than_it_can_drive():
    (x, u), p, t = symbols(3, 2), casadi.SX.sym('p', 2), 0.1 * np.arange(61)
    course = x[2] + 0.05 * u[1]
    stated = {
        'horizon': 60, 'x0': (0.2, -0.3, 0.3), 'x': x, 'u': u,
        'F': [
            x[0] + 0.1 * u[0] * casadi.cos(course),
            x[1] + 0.1 * u[0] * casadi.sin(course),
            x[2] + 0.1 * u[1],
        ],
        'residuals': [3.0 * (x[0] - p[0]), 3.0 * (x[1] - p[1]), 0.2 * u[0], 0.2 * u[1]],
        'lower': (0.0, -2.0), 'upper': (1.6, 2.0),
        'p': p, 'p_values': np.column_stack([2.0 * np.sin(t), np.sin(2.0 * t)]),
    }  # fmt: skip
    problem = from_casadi(**stated)
    guess = np.tile([1.0, 0.0], (61, 1))
    U = assert_agrees(problem, stated, guess, options_for(problem)).iterate.U
    assert (U[:, 0] == 1.6).sum() > 5
    assert (np.abs(U[:, 1]) == 2.0).sum() > 2


def flight(wall):
    """A planar quadrotor: ``(x, z, tilt)`` and its rate; thrusts of both rotors, mass 1."""
    x, u = symbols(6, 2)
    thrust, torque = u[0] + u[1], 0.3 * (u[0] - u[1])

    def rate(s):
        up = thrust * casadi.cos(s[2]) - 9.81
        return casadi.vertcat(s[3:], -thrust * casadi.sin(s[2]), up, 20.0 * torque)

    limits = [x[2] - 0.2, -0.2 - x[2]]
    distance = casadi.sqrt((x[0] - 1.0) ** 2 + (x[1] + 0.3) ** 2)
    return {
        'horizon': 40, 'x0': np.zeros(6), 'x': x, 'u': u, 'F': by_midpoint(rate, x, 0.06),
        'residuals': [u[0] - 9.81 / 2.0, u[1] - 9.81 / 2.0, 0.3 * x[2], 0.1 * x[5]],
        'h': x, 'target': (2.0, 0.0, 0.0, 0.0, 0.0, 0.0),
        'g': [*limits, 0.5 - distance] if wall else limits, 'lower': 2.0, 'upper': 5.5,
    }  # fmt: skip


def test_a_quadrotor_flies_over_a_wall():
    through = from_casadi(**flight(wall=False))
    guess = solve(through, np.full((41, 2), 9.81 / 2.0), options_for(through), 50).iterate.U
    stated = flight(wall=True)
    problem = from_casadi(**stated)
    last = assert_agrees(problem, stated, guess, options_for(problem)).history[-1]
    assert {index for _, index in last.active_path} == {0, 1, 2}
    assert len(last.active_bounds) > 5


def test_one_iteration_moves_a_double_integrator_by_a_straight_line():
    """Rest to rest at minimum effort: the control falls along a straight line."""
    N, dt, distance = 40, 0.05, 3.0
    problem = from_functions(
        horizon=N,
        x0=[0.0, 0.0],
        controls=1,
        F=lambda k, x, u: np.array([x[0] + dt * x[1] + 0.5 * dt**2 * u[0], x[1] + dt * u[0]]),
        L=lambda k, x, u: 0.5 * u[0] ** 2,
        h=lambda x, u: x,
        target=[distance, 0.0],
    )
    iteration = CMPSP(problem, options_for(problem))
    after = iteration.step(iteration.init(np.random.default_rng(1).normal(size=(N + 1, 1))))
    # Rest to rest asks for sum u = 0 and sum (N - k - 1/2) dt^2 u = distance; least squares of u
    # under both is a line through zero at half time.
    slope = 6.0 * distance / (dt**2 * N * (N**2 - 1))
    line = np.append(slope * (N - 1 - 2 * np.arange(N)), 0.0)
    np.testing.assert_allclose(after.U[:, 0], line, atol=1e-10)
    np.testing.assert_allclose(after.X[-1], [distance, 0.0], atol=1e-10)
