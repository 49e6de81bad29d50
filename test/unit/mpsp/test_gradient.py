"""Gradients of solutions by the data, against differences of problems solved again."""

import casadi
import numpy as np
import pytest

from cmpsp_ros.mpsp import Options, ProblemError, Status, from_casadi, gradient, solve

N = 30
TIGHT = Options(control_tolerance=1e-11, kkt_tolerance=1e-10)
x, u, p = casadi.SX.sym('x', 2), casadi.SX.sym('u'), casadi.SX.sym('p', 2)
LOAD = np.column_stack([np.full(N + 1, 0.3), np.linspace(0.15, 0.3, N + 1)])


def swing():
    """A pendulum between bounds on the torque and on the rate."""
    rate = x[1] + 0.1 * (u - casadi.sin(x[0]) * p[1] + p[0] * u * x[1])
    return from_casadi(
        horizon=N, x0=[0.0, 0.0], x=x, u=u, p=p, p_values=LOAD, F=[x[0] + 0.1 * rate, rate],
        L=0.05 * u**2 * (1.0 + p[0] ** 2), h=[x[0] + 0.1 * p[0], x[1]], target=[1.5, 0.2],
        g=[x[1] - 0.65], lower=-0.6, upper=0.6,
    )  # fmt: skip


DIRECTIONS = {
    'x0': np.array([0.3, -0.2]),
    'target': np.array([-0.4, 0.7]),
    'p_values': np.random.default_rng(0).normal(size=LOAD.shape),
}
VALUES = {'x0': np.zeros(2), 'target': np.array([1.5, 0.2]), 'p_values': LOAD}


@pytest.mark.parametrize('names', [['x0'], ['target'], ['p_values'], ['x0', 'target', 'p_values']])
def test_gradient_is_that_of_problems_solved_again(names):
    problem = swing()
    solution = solve(problem, np.zeros((N + 1, 1)), TIGHT)
    assert solution.status is Status.CONVERGED
    assert np.count_nonzero(solution.bound_multipliers) > 1
    assert np.count_nonzero(solution.path_multipliers) > 1
    found = gradient(problem, solution, **{name: DIRECTIONS[name] for name in names})
    ends = []
    for step in (1e-6, -1e-6):
        changed = {name: VALUES[name] + step * DIRECTIONS[name] for name in names}
        ends.append(solve(problem.updated(**changed), solution.iterate.U, TIGHT).iterate)
    ahead, behind = ends
    np.testing.assert_allclose(found.U, (ahead.U - behind.U) / 2e-6, atol=1e-3)
    np.testing.assert_allclose(found.X, (ahead.X - behind.X) / 2e-6, atol=1e-3)
    cost = (ahead.evaluation.cost - behind.evaluation.cost) / 2e-6
    assert found.cost == pytest.approx(cost, abs=1e-5)


def test_what_has_no_gradient_is_named():
    problem = swing()
    unfinished = solve(problem, np.zeros((N + 1, 1)), max_iterations=1)
    with pytest.raises(ProblemError, match='found ITERATION_LIMIT, wanted CONVERGED'):
        gradient(problem, unfinished, x0=[1.0, 0.0])
    solution = solve(problem, np.zeros((N + 1, 1)))
    with pytest.raises(ProblemError, match='x0: found shape'):
        gradient(problem, solution, x0=[1.0])
    with pytest.raises(ProblemError, match='p_values: found shape'):
        gradient(problem, solution, p_values=np.ones(N + 1))


def test_a_warm_start_needs_fewer_iterations_to_the_same_answer():
    problem = swing()
    first = solve(problem, np.zeros((N + 1, 1)), TIGHT)
    moved = problem.updated(x0=[0.01, -0.005])
    cold, warm = (solve(moved, first.iterate.U, TIGHT, warm=each) for each in (None, first))
    assert warm.status is cold.status is Status.CONVERGED
    assert warm.iterate.index < cold.iterate.index
    assert warm.iterate.index <= 4
    assert warm.iterate.evaluation.cost == pytest.approx(cold.iterate.evaluation.cost, rel=1e-8)
    again = solve(problem, first.iterate.U, warm=first)
    assert again.iterate.index <= 1
    bare = from_casadi(horizon=N, x0=[0.0, 0.0], x=x, u=u, F=[x[0] + u, x[1]], L=u**2)
    with pytest.raises(ProblemError, match='warm: found multipliers of shapes'):
        solve(bare, np.zeros((N + 1, 1)), warm=first)
