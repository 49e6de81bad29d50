"""Planar missile that must hit a point at a given angle: MPSP's home ground.

Constant speed, lateral acceleration as the control, pure control cost, no path constraints: every
iteration is the closed form (35). Lengths in units of the range, time in units of range over speed.
"""

import casadi
import numpy as np
import pytest
from reference_solution import assert_agrees, options_for

from cmpsp_ros.mpsp.convergence import Convergence
from cmpsp_ros.mpsp.models.casadi_functions import from_casadi
from cmpsp_ros.mpsp.qp.dense import condense
from cmpsp_ros.mpsp.theorem2 import Verdict, check, lagrangian_hessian

N, FLIGHT_TIME = 60, 1.25
START = (0.0, 0.0, np.radians(20.0))


def engagement(impact_angle):
    x, u = casadi.SX.sym('x', 3), casadi.SX.sym('u')
    rate = lambda s: casadi.vertcat(casadi.cos(s[2]), casadi.sin(s[2]), u)  # noqa: E731
    dt = FLIGHT_TIME / N
    middle = x + 0.5 * dt * rate(x)
    return {
        'horizon': N,
        'x0': START,
        'x': x,
        'u': u,
        'F': x + dt * rate(middle),
        'L': 0.5 * u**2,
        'h': x,
        'target': (1.0, 0.0, np.radians(impact_angle)),
    }


@pytest.mark.parametrize('turn', [0.0, 1.0, -1.0])
@pytest.mark.parametrize('impact_angle', [-30.0, -60.0, -90.0])
def test_hits_at_the_angle(impact_angle, turn):
    stated = engagement(impact_angle)
    problem = from_casadi(**stated)
    guess = np.full((N + 1, 1), turn)
    # Poor: it ends a third of the range off the target or more.
    assert np.linalg.norm(problem.predict(guess)[-1, :2] - (1.0, 0.0)) > 0.3
    solution = assert_agrees(problem, stated, guess, options_for(problem, penalty=1e3))
    assert solution.iterate.index <= 25
    assert {record.step_length for record in solution.history[1:][-5:]} == {1.0}
    assert np.abs(solution.iterate.evaluation.output_error).max() < 1e-9
    assert solution.iterate.U[-1] == 0.0


def test_theorem_2_holds_and_the_rate_is_linear():
    stated = engagement(-60.0)
    problem = from_casadi(**stated)
    options = options_for(problem, penalty=1e3, control_tolerance=1e-12)
    solution = assert_agrees(problem, stated, np.zeros((N + 1, 1)), options)
    conditions = check(problem, solution, smooth=True)
    assert conditions.strict_complementarity.verdict is Verdict.YES
    assert conditions.regular.verdict is Verdict.YES
    assert conditions.second_order.verdict is Verdict.YES
    # J is 1/2 |U|^2, but that it is so everywhere is not to be seen from one point.
    assert conditions.convex_cost.verdict is Verdict.CANNOT_TELL
    assert abs(conditions.convex_cost.figure - 1.0) < 1e-12

    # The rate (60) is the largest eigenvalue of what the Hessian I of the subproblem lacks of the
    # Lagrangian's, on the null space of G.
    at = solution.iterate
    free = np.full_like(at.U, np.inf)
    S_N = condense(problem.linearise(at.X, at.U), -free, free).S_N
    Z = np.linalg.svd(S_N)[2][3:].T
    lacking = np.eye(N - 2) - Z.T @ lagrangian_hessian(problem, solution) @ Z
    expected = np.abs(np.linalg.eigvalsh(lacking)).max()
    convergence = Convergence.of(solution.history)
    assert abs(convergence.rate - expected) < 0.01, convergence.sentence
