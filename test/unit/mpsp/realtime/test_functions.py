"""A user's own problem, its functions compiled for the class of its data."""

from typing import NamedTuple

import numpy as np
import pytest
from problems import VanDerPol
from runs import assert_same, improved, iterates

from cmpsp_ros.mpsp.jit.compiled import implements
from cmpsp_ros.mpsp.iteration import Options
from cmpsp_ros.mpsp.realtime import functions


class Oscillator(NamedTuple):
    """What `VanDerPol` keeps, as numbers."""

    start: tuple[float, float]
    goal: tuple[float, float]
    step: float
    damping: float
    floor: float
    mixed: float


@implements(functions.predict, Oscillator)
def predict(data, U, X):
    X[0, 0], X[0, 1] = data.start
    for k in range(U.shape[0] - 1):
        x, v = X[k, 0], X[k, 1]
        pull = data.damping * (1.0 - x * x) * v - x + U[k, 0]
        X[k + 1, 0], X[k + 1, 1] = x + data.step * v, v + data.step * pull


@implements(functions.evaluate, Oscillator)
def evaluate(data, X, U, output_error, g):
    cost, last = 0.0, X.shape[0] - 1
    for k in range(last + 1):
        x, v, u = X[k, 0], X[k, 1], U[k, 0]
        cost += 0.5 * (x * x + v * v + u * u) + 0.25 * x * x * u * u
        g[k, 0] = data.floor - v if k else -np.inf
        g[k, 1] = x + u - data.mixed
    for i in range(2):
        output_error[i] = X[last, i] - data.goal[i]
    return cost


@implements(functions.linearise, Oscillator)
def linearise(data, X, U, qp):
    last = X.shape[0] - 1
    for k in range(last + 1):
        x, v, u = X[k, 0], X[k, 1], U[k, 0]
        if k < last:
            qp.A[k, 0, 0], qp.A[k, 0, 1] = 1.0, data.step
            qp.A[k, 1, 0] = data.step * (-2.0 * data.damping * x * v - 1.0)
            qp.A[k, 1, 1] = 1.0 + data.step * data.damping * (1.0 - x * x)
            qp.B[k, 1, 0] = data.step
        qp.L_X[k, 0], qp.L_X[k, 1] = x + 0.5 * x * u * u, v
        qp.L_U[k, 0] = u + 0.5 * x * x * u
        qp.L_XX[k, 0, 0], qp.L_XX[k, 1, 1] = 1.0 + 0.5 * u * u, 1.0
        qp.L_UX[k, 0, 0] = x * u
        qp.L_UU[k, 0, 0] = 1.0 + 0.5 * x * x
        qp.g[k, 0] = data.floor - v if k else -np.inf
        qp.g[k, 1] = x + u - data.mixed
        qp.g_X[k, 0, 1], qp.g_X[k, 1, 0], qp.g_U[k, 1, 0] = -1.0, 1.0, 1.0
    for i in range(2):
        qp.output_error[i] = X[last, i] - data.goal[i]
        qp.h_X[i, i] = 1.0


# The iteration is compiled for the class of the data, which takes a while: by one worker.
pytestmark = [pytest.mark.timeout(600), pytest.mark.xdist_group('oscillator')]


def both(**changes):
    problem = VanDerPol(horizon=30, **changes)
    data = (problem.start, problem.goal, problem.step, problem.damping)
    return problem, Oscillator(*data, float(problem.floor), float(problem.mixed))


@pytest.mark.parametrize(
    'changes',
    [
        {'limit': 1.0},
        {'floor': -0.6, 'mixed': 1.2, 'limit': 2.0},
        {'floor': -0.1, 'limit': 0.3},
        {'start': (2.0, 2.0), 'goal': (1.0, 0.0), 'damping': 3.0, 'limit': 8.0},
    ],
    ids=str,
)
def test_iterates_are_those_of_the_general_iteration(changes):
    problem, data = both(**changes)
    options = Options(np.full(2, 50.0), np.full(2, 80.0))
    guess = np.full((31, 1), 0.2)
    run = iterates(problem, options, guess, 12)
    for iterate in run[1:]:
        assert_same(improved(problem, data, options, guess, iterate.index), iterate, options)
    assert len(run) > 3
