"""Minimum-effort double integrator from rest to rest: the control falls along a straight line."""

import numpy as np
from reference_solution import options_for

from cmpsp_ros.mpsp.models.functions import from_functions
from cmpsp_ros.mpsp.sqp import CMPSP

N, DT, DISTANCE = 40, 0.05, 3.0


def test_one_iteration_is_the_straight_line():
    problem = from_functions(
        horizon=N,
        x0=[0.0, 0.0],
        controls=1,
        F=lambda k, x, u: np.array([x[0] + DT * x[1] + 0.5 * DT**2 * u[0], x[1] + DT * u[0]]),
        L=lambda k, x, u: 0.5 * u[0] ** 2,
        h=lambda x, u: x,
        target=[DISTANCE, 0.0],
    )
    iteration = CMPSP(problem, options_for(problem))
    guess = np.random.default_rng(1).normal(size=(N + 1, 1))
    after = iteration.step(iteration.init(guess))

    # Rest to rest asks for sum u = 0 and sum (N - k - 1/2) dt^2 u = distance; least squares of u
    # under both is a line through zero at half time.
    slope = 6.0 * DISTANCE / (DT**2 * N * (N**2 - 1))
    line = np.append(slope * (N - 1 - 2 * np.arange(N)), 0.0)
    np.testing.assert_allclose(after.U[:, 0], line, atol=1e-10)
    np.testing.assert_allclose(after.X[-1], [DISTANCE, 0.0], atol=1e-10)
