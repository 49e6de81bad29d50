"""A planar quadrotor, n = 6, flies over a wall between two hovers within its thrust."""

import casadi
import numpy as np
from reference_solution import assert_agrees, options_for

from cmpsp_ros.mpsp.models.casadi_functions import from_casadi
from cmpsp_ros.mpsp.sqp.cmpsp import solve

N, DT = 40, 0.06
GRAVITY, ARM = 9.81, 0.3
MAX_THRUST, MAX_TILT = 5.5, 0.2
WALL, WALL_RADIUS = (1.0, -0.3), 0.5


def flight(wall=True):
    """State ``(x, z, tilt)`` and its rate; thrusts of the right and the left rotor, mass 1."""
    x, u = casadi.SX.sym('x', 6), casadi.SX.sym('u', 2)

    def rate(s):
        thrust, torque = u[0] + u[1], ARM * (u[0] - u[1])
        return casadi.vertcat(
            s[3:], -thrust * casadi.sin(s[2]), thrust * casadi.cos(s[2]) - GRAVITY, 20.0 * torque
        )

    middle = x + 0.5 * DT * rate(x)
    limits = [x[2] - MAX_TILT, -MAX_TILT - x[2]]
    distance = casadi.sqrt((x[0] - WALL[0]) ** 2 + (x[1] - WALL[1]) ** 2)
    return {
        'horizon': N,
        'x0': np.zeros(6),
        'x': x,
        'u': u,
        'F': x + DT * rate(middle),
        'residuals': [u[0] - GRAVITY / 2.0, u[1] - GRAVITY / 2.0, 0.3 * x[2], 0.1 * x[5]],
        'h': x,
        'target': (2.0, 0.0, 0.0, 0.0, 0.0, 0.0),
        'g': [*limits, WALL_RADIUS - distance] if wall else limits,
        'lower': 2.0,
        'upper': MAX_THRUST,
    }


def test_flies_over_the_wall():
    hover = np.full((N + 1, 2), GRAVITY / 2.0)
    through = from_casadi(**flight(wall=False))
    guess = solve(through, hover, options_for(through), 50).iterate.U

    stated = flight()
    problem = from_casadi(**stated)
    solution = assert_agrees(problem, stated, guess, options_for(problem))
    last = solution.history[-1]
    assert {index for _, index in last.active_path} == {0, 1, 2}
    assert len(last.active_bounds) > 5
