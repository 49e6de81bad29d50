"""Van der Pol oscillator brought to rest under bounds on control and state."""

import casadi
import numpy as np
import pytest
from reference_solution import assert_agrees, options_for

from cmpsp_ros.mpsp.models.casadi_functions import from_casadi

N, DT = 50, 0.1


def oscillator():
    x, u = casadi.SX.sym('x', 2), casadi.SX.sym('u')
    rate = lambda s: casadi.vertcat(s[1], (1 - s[0] ** 2) * s[1] - s[0] + u)  # noqa: E731
    k1 = rate(x)
    k2 = rate(x + 0.5 * DT * k1)
    k3 = rate(x + 0.5 * DT * k2)
    k4 = rate(x + DT * k3)
    return {
        'horizon': N,
        'x0': (1.0, 0.0),
        'x': x,
        'u': u,
        'F': x + DT / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4),
        'residuals': [x[0], x[1], 0.5 * u],
        'h': x,
        'target': (0.0, 0.0),
        'g': [-0.4 - x[1]],
        'lower': -0.9,
        'upper': 0.9,
    }


@pytest.mark.parametrize('hessian', ['gauss_newton', 'exact', 'projected'])
def test_comes_to_rest(hessian):
    stated = oscillator()
    problem = from_casadi(**stated)
    options = options_for(problem, hessian=hessian)
    solution = assert_agrees(problem, stated, np.zeros((N + 1, 1)), options)
    last = solution.history[-1]
    assert len(last.active_path) > 2
    assert len(last.active_bounds) > 2
    assert last.violation < 1e-8
