"""Convergence along a curved constraint, where full steps raise an L1 merit (Maratos)."""

import casadi
import numpy as np
import pytest
from reference_solution import assert_agrees, options_for

from cmpsp_ros.mpsp.models.casadi_functions import from_casadi
from cmpsp_ros.mpsp.results import Status
from cmpsp_ros.mpsp.sqp.driver import BackEnd
from cmpsp_ros.mpsp.sqp.solve import solve

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


@pytest.mark.parametrize('state', [equality, inequality])
def test_they_are_refused_without_the_second_order_correction(state, monkeypatch):
    monkeypatch.setattr(BackEnd, 'correct', lambda _self, _output_error, _g: None)
    problem = from_casadi(**state())
    solution = solve(problem, FIRST, options_for(problem, penalty=1e3, method='cmpsp'), 60)
    assert solution.status is not Status.CONVERGED
    assert sum(record.step_length < 0.1 for record in solution.history[1:]) > 30
