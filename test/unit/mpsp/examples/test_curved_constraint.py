"""Convergence along a curved constraint, where full steps raise an L1 merit (Maratos)."""

import casadi
import numpy as np
import pytest
from reference_solution import assert_agrees, options_for

from cmpsp_ros.mpsp.models.casadi_functions import from_casadi
from cmpsp_ros.mpsp.results import Status
from cmpsp_ros.mpsp.sqp.solve import solve
from examples.common import ipopt, runge_kutta

FIRST = np.array([[np.cos(1.0), np.sin(1.0)], [0.0, 0.0]])


def stated(cost):
    """``X_1 = U_0``, whose best place on the unit circle is furthest to the right."""
    x, u = casadi.SX.sym('x', 2), casadi.SX.sym('u', 2)
    return {'horizon': 1, 'x0': (0.0, 0.0), 'x': x, 'u': u, 'F': u, 'L': cost(x, u)}


def equality():
    """On the circle. Hessian of ``J`` 5, of the Lagrangian 1: a rate of 4/5."""
    given = stated(lambda x, u: 2.0 * casadi.sumsqr(x) - x[0] + 0.5 * casadi.sumsqr(u))
    return {**given, 'h': casadi.sumsqr(given['x']), 'target': [1.0]}


def inequality():
    """In the disc. Hessian of ``J`` 1, of the Lagrangian 3/2: a rate of 1/2."""
    given = stated(lambda x, u: 0.5 * casadi.sumsqr(u) - 1.5 * x[0])
    return {**given, 'g': [casadi.sumsqr(given['x']) - 1.0]}


@pytest.mark.parametrize(('state', 'rate'), [(equality, 0.8), (inequality, 0.5)])
@pytest.mark.parametrize('penalty', [3.0, 1e2, 1e4])
def test_full_steps_are_kept(state, rate, penalty):
    problem = from_casadi(**state())
    options = options_for(problem, penalty=penalty, method='cmpsp', scaling=False)
    solution = assert_agrees(problem, state(), FIRST, options, 120)
    np.testing.assert_allclose(solution.iterate.U[0], [1.0, 0.0], atol=1e-6)
    assert {record.step_length for record in solution.history[20:]} == {1.0}
    steps = np.array([record.step_norm for record in solution.history[-6:]])
    np.testing.assert_allclose(steps[1:] / steps[:-1], rate, atol=0.01)


def along(curve, x0, target, horizon=40, period=2.0):
    """A particle that is accelerated along a curve, an equality at each stage."""
    x, u = casadi.SX.sym('x', 4), casadi.SX.sym('u', 2)
    step = runge_kutta(lambda x, u: casadi.vertcat(x[2:], u), x, u, period / horizon)
    return {
        'horizon': horizon, 'x0': x0, 'x': x, 'u': u, 'F': step, 'L': casadi.sumsqr(u),
        'h': x[:2], 'target': target, 'g': [curve(x), -curve(x)],
    }  # fmt: skip


CURVES = {
    'half a circle': along(lambda x: casadi.sumsqr(x[:2]) - 1.0, [1, 0, 0, 1.5], [-1.0, 0.0]),
    'a sine': along(lambda x: x[1] - casadi.sin(x[0]), [0, 0, 1, 1], [2 * np.pi, 0.0], 50, 5.0),
}


@pytest.mark.parametrize('name', CURVES)
@pytest.mark.parametrize('seed', [None, 0, 1])
def test_an_equality_along_the_path_may_be_curved(name, seed):
    guess, given = np.zeros((CURVES[name]['horizon'] + 1, 2)), CURVES[name]
    if seed is not None:
        guess += np.random.default_rng(seed).uniform(-0.5, 0.5, guess.shape)
    problem = from_casadi(**given)
    solution = solve(problem, guess)
    assert solution.status is Status.CONVERGED, solution.sentence
    reference = ipopt(given, guess, problem.predict(guess))
    assert reference.status == 'Solve_Succeeded'
    # IPOPT lets each row be off by 1e-8.
    np.testing.assert_allclose(solution.iterate.evaluation.cost, reference.cost, rtol=1e-5)
    assert solution.iterate.index < reference.iterations


def test_a_program_whose_rows_depend_on_each_other_comes_to_an_end():
    """From rest no control moves the particle along the circle at first."""
    given = along(lambda x: casadi.sumsqr(x[:2]) - 1.0, [1, 0, 0, 0], [-1.0, 0.0])
    given |= {'h': given['x'], 'target': [-1.0, 0.0, 0.0, 0.0], 'L': 0.05 * given['L']}
    _, noise = np.random.default_rng(1).uniform(-1.0, 1.0, (2, 41, 2))
    solution = solve(from_casadi(**given), noise + 0.3)
    assert solution.status is Status.CONVERGED, solution.sentence
    assert np.abs(solution.iterate.evaluation.output_error).max() < 1e-9
