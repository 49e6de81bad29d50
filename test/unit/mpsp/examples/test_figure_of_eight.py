"""A unicycle follows a figure of eight that is faster than it can drive."""

import casadi
import numpy as np
from reference_solution import assert_agrees, options_for

from cmpsp_ros.mpsp.models.casadi_functions import from_casadi

N, DT = 60, 0.1
MAX_SPEED, MAX_TURN = 1.6, 2.0


def tracking():
    x, u, p = casadi.SX.sym('x', 3), casadi.SX.sym('u', 2), casadi.SX.sym('p', 2)
    course = x[2] + 0.5 * DT * u[1]
    t = DT * np.arange(N + 1)
    return {
        'horizon': N,
        'x0': (0.2, -0.3, 0.3),
        'x': x,
        'u': u,
        'F': [
            x[0] + DT * u[0] * casadi.cos(course),
            x[1] + DT * u[0] * casadi.sin(course),
            x[2] + DT * u[1],
        ],
        'residuals': [3.0 * (x[0] - p[0]), 3.0 * (x[1] - p[1]), 0.2 * u[0], 0.2 * u[1]],
        'lower': (0.0, -MAX_TURN),
        'upper': (MAX_SPEED, MAX_TURN),
        'p': p,
        'p_values': np.column_stack([2.0 * np.sin(t), np.sin(2.0 * t)]),
    }


def test_follows_within_its_limits():
    stated = tracking()
    problem = from_casadi(**stated)
    guess = np.tile([1.0, 0.0], (N + 1, 1))
    solution = assert_agrees(problem, stated, guess, options_for(problem))
    U = solution.iterate.U
    assert (U[:, 0] == MAX_SPEED).sum() > 5
    assert (np.abs(U[:, 1]) == MAX_TURN).sum() > 2
