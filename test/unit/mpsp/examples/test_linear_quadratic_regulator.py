"""Linear-quadratic regulator: one iteration is the solution, by Riccati or by the KKT system."""

import numpy as np
import pytest
from reference_solution import options_for

from cmpsp_ros.mpsp.models.functions import from_functions
from cmpsp_ros.mpsp.sqp.cmpsp import CMPSP, solve
from cmpsp_ros.mpsp.status import Status

N = 30
A = np.array([[1.0, 0.1, 0.0], [-0.2, 0.95, 0.1], [0.0, 0.05, 1.02]])
B = np.array([[0.0, 0.02], [0.1, 0.0], [0.0, 0.1]])
Q, R = np.diag([2.0, 0.5, 1.0]), np.diag([0.1, 0.3])
START = np.array([1.0, -0.5, 0.8])
GUESS = np.random.default_rng(0).normal(size=(N + 1, 2))


def regulator(**terminal):
    return from_functions(
        horizon=N,
        x0=START,
        controls=2,
        F=lambda k, x, u: A @ x + B @ u,
        L=lambda k, x, u: 0.5 * (x @ Q @ x + u @ R @ u),
        **terminal,
    )


def riccati():
    """Backward sweep for the gains, forward sweep for the controls; the last one moves nothing."""
    P, gains = Q, []
    for _ in range(N):
        K = np.linalg.solve(R + B.T @ P @ B, B.T @ P @ A)
        P = Q + A.T @ P @ (A - B @ K)
        gains.insert(0, K)
    x, U = START, np.zeros((N + 1, 2))
    for k, K in enumerate(gains):
        U[k] = -K @ x
        x = A @ x + B @ U[k]
    return U


def kkt_system(target):
    """States, controls and multipliers of the full program, with ``X_N`` given, at once."""
    n, r = B.shape
    states, controls = n * (N + 1), r * (N + 1)
    cost = np.zeros((states + controls,) * 2)
    cost[:states, :states] = np.kron(np.eye(N + 1), Q)
    cost[states:, states:] = np.kron(np.eye(N + 1), R)
    rows = np.zeros((states + n, states + controls))
    rows[:states, :states] = np.eye(states) - np.kron(np.eye(N + 1, k=-1), A)
    rows[n:states, states : states + r * N] = -np.kron(np.eye(N), B)
    rows[states:, states - n : states] = np.eye(n)
    right = np.concatenate([np.zeros(states + controls), START, np.zeros(n * N), target])
    system = np.block([[cost, rows.T], [rows, np.zeros((len(rows),) * 2)]])
    answer = np.linalg.solve(system, right)
    return answer[states : states + controls].reshape(N + 1, r), answer[-n:]


def test_one_iteration_is_the_riccati_solution():
    problem = regulator()
    iteration = CMPSP(problem, options_for(problem))
    after = iteration.step(iteration.init(GUESS))
    np.testing.assert_allclose(after.U, riccati(), atol=1e-10)


@pytest.mark.parametrize('target', [(0.0, 0.0, 0.0), (0.5, -0.2, 0.1)])
def test_one_iteration_is_the_solution_of_the_kkt_system(target):
    problem = regulator(h=lambda x, u: x, target=target)
    iteration = CMPSP(problem, options_for(problem))
    after = iteration.step(iteration.init(GUESS))
    U, multipliers = kkt_system(np.array(target))
    np.testing.assert_allclose(after.U, U, atol=1e-10)
    np.testing.assert_allclose(after.step.terminal_multipliers, multipliers, atol=1e-9)
    np.testing.assert_allclose(after.X[-1], target, atol=1e-10)


def test_the_second_iteration_finds_nothing_to_do():
    problem = regulator(h=lambda x, u: x, target=np.zeros(3))
    solution = solve(problem, GUESS, options_for(problem), 10)
    assert solution.status is Status.CONVERGED
    assert solution.iterate.index == 2
    assert solution.history[1].kkt_residual < 1e-10
