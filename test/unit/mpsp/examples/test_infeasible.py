"""Problems without a feasible point: the run says so, and names the constraints in conflict."""

import casadi
import numpy as np
import pytest
from reference_solution import options_for

from cmpsp_ros.mpsp.models.casadi_functions import from_casadi
from cmpsp_ros.mpsp.results import Status
from cmpsp_ros.mpsp.sqp.solve import solve

N, DT = 20, 0.1
SPEED_LIMIT, DISTANCE = 1.0, 3.0


def too_far():
    """Twice the least time would be needed at the speed limit; ``U`` is the acceleration."""
    x, u = casadi.SX.sym('x', 2), casadi.SX.sym('u')
    return from_casadi(
        horizon=N,
        x0=(0.0, 0.0),
        x=x,
        u=u,
        F=[x[0] + DT * x[1], x[1] + DT * u],
        L=0.5e-3 * u**2,
        h=x[0],
        target=[DISTANCE],
        g=[x[1] - SPEED_LIMIT],
    )


def test_an_important_limit_leaves_the_goal_unreached():
    problem = too_far()
    options = options_for(problem, penalty_path=np.array([1e3]), penalty_terminal=np.array([10.0]))
    solution = solve(problem, np.zeros((N + 1, 1)), options, 50)
    assert solution.status is Status.INFEASIBLE
    (miss,) = solution.violated
    assert (miss.is_terminal, miss.stage, miss.index) == (True, N, 0)
    # From rest at stage 0 to the limit at stage 1, and on from there.
    assert miss.amount == pytest.approx((N - 1) * DT * SPEED_LIMIT - DISTANCE, abs=1e-6)
    assert 'Not met: terminal output 0 is off by -1.1.' in solution.sentence


def test_an_important_goal_breaks_the_limit():
    problem = too_far()
    options = options_for(problem, penalty_path=np.array([1.0]), penalty_terminal=np.array([1e3]))
    solution = solve(problem, np.zeros((N + 1, 1)), options, 50)
    assert solution.status is Status.INFEASIBLE
    assert {(row.is_terminal, row.index) for row in solution.violated} == {(False, 0)}
    assert {row.stage for row in solution.violated} <= set(range(1, N + 1))
    worst = solution.violated[0]
    assert f'path constraint 0 at stage {worst.stage} is exceeded by' in solution.sentence


def test_a_curved_gap_that_is_too_narrow():
    """A unicycle between two discs that overlap: one or both are always in the way."""
    x, u = casadi.SX.sym('x', 3), casadi.SX.sym('u')
    discs = [casadi.sqrt((x[0] - 1.0) ** 2 + (x[1] - side) ** 2) for side in (0.5, -0.5)]
    problem = from_casadi(
        horizon=N,
        x0=(0.0, 0.1, 0.0),
        x=x,
        u=u,
        F=[x[0] + DT * casadi.cos(x[2]), x[1] + DT * casadi.sin(x[2]), x[2] + DT * u],
        residuals=[u],
        h=x[:2],
        target=(2.0, 0.0),
        g=[0.6 - distance for distance in discs],
    )
    solution = solve(problem, np.zeros((N + 1, 1)), options_for(problem), 100)
    assert solution.status is Status.INFEASIBLE, solution.sentence
    in_the_way = {(row.index, row.stage) for row in solution.violated if not row.is_terminal}
    assert in_the_way
    assert all(7 <= stage <= 14 for _, stage in in_the_way)
