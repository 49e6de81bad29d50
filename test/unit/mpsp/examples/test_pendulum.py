"""A pendulum swings up with a torque too weak to lift it at once."""

import casadi
import numpy as np
import pytest
from reference_solution import assert_agrees, options_for

from cmpsp_ros.mpsp.models.casadi_functions import from_casadi

N, DT, TORQUE = 80, 0.1, 0.6


def swing_up():
    """Angle from hanging; mass, length and gravity are 1."""
    x, u = casadi.SX.sym('x', 2), casadi.SX.sym('u')
    rate = lambda s: casadi.vertcat(s[1], -casadi.sin(s[0]) + u)  # noqa: E731
    middle = x + 0.5 * DT * rate(x)
    return {
        'horizon': N,
        'x0': (0.0, 0.0),
        'x': x,
        'u': u,
        'F': x + DT * rate(middle),
        'residuals': [u],
        'h': x,
        'target': (np.pi, 0.0),
        'lower': -TORQUE,
        'upper': TORQUE,
    }


@pytest.mark.parametrize('hessian', ['gauss_newton', 'exact'])
def test_swings_up(hessian):
    stated = swing_up()
    problem = from_casadi(**stated)
    guess = -0.3 * np.cos(DT * np.arange(N + 1))[:, None]
    solution = assert_agrees(problem, stated, guess, options_for(problem, hessian=hessian))
    X = solution.iterate.X
    np.testing.assert_allclose(X[-1], [np.pi, 0.0], atol=1e-8)
    # It has to swing back first.
    assert X[:, 0].min() < -0.5
