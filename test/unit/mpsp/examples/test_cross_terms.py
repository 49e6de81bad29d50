"""A motor that pays for the power it draws, torque times speed: a cost with cross terms L_XU."""

import casadi
import numpy as np
import pytest
from reference_solution import assert_agrees, options_for

from cmpsp_ros.mpsp.models.casadi_functions import from_casadi

N, DT = 40, 0.1
MAX_TORQUE, MAX_SPEED = 1.2, 1.0


def motor():
    x, u = casadi.SX.sym('x', 2), casadi.SX.sym('u')
    angle, speed = x[0], x[1]
    return {
        'horizon': N,
        'x0': (0.0, 0.0),
        'x': x,
        'u': u,
        'F': [
            angle + DT * speed,
            speed + DT * (u - 0.3 * speed * casadi.sqrt(0.1 + speed**2) - 0.5 * casadi.sin(angle)),
        ],
        'L': 0.5 * u**2 + 0.8 * u * speed + 0.4 * speed**2,
        'h': x,
        'target': (3.0, 0.0),
        'g': [speed - MAX_SPEED],
        'lower': -MAX_TORQUE,
        'upper': MAX_TORQUE,
    }


@pytest.mark.parametrize('hessian', ['gauss_newton', 'exact', 'projected'])
def test_turns_at_least_cost(hessian):
    stated = motor()
    problem = from_casadi(**stated)
    U = np.zeros((N + 1, 1))
    assert problem.linearise(problem.predict(U), U, hessian).L_UX.any()
    options = options_for(problem, hessian=hessian)
    solution = assert_agrees(problem, stated, U, options)
    assert len(solution.history[-1].active_path) > 3
