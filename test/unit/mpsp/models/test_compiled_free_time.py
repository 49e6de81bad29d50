"""A final time that is free in compiled code, against analytic answers and IPOPT."""

import math
from typing import NamedTuple

import casadi
import numpy as np
import pytest

from cmpsp_ros.mpsp import Dimensions
from cmpsp_ros.mpsp.jit import allocation_free
from cmpsp_ros.mpsp.models import FREE_TIME, FreeTimeData
from cmpsp_ros.mpsp.qp.riccati import Outcome
from cmpsp_ros.mpsp.sqp import Driver, Functions

pytestmark = [pytest.mark.timeout(600), pytest.mark.xdist_group('riccati')]
N = 40


class Drive(NamedTuple):
    """Data of a cart or a car: target, weight of the controls, the number of steps."""

    target: np.ndarray
    weight: float
    steps: int


# The cart: place and speed, then the time; thrust, then its change.


@allocation_free
def predict_cart(data, U, X):
    X[0, 0] = X[0, 1] = 0.0
    for k in range(data.steps):
        h = X[k, 2] / data.steps
        X[k + 1, 0] = X[k, 0] + h * X[k, 1] + 0.5 * h * h * U[k, 0]
        X[k + 1, 1] = X[k, 1] + h * U[k, 0]


@allocation_free
def evaluate_cart(data, X, U, output_error, g):
    cost, time = 0.0, X[data.steps, 2]
    for k in range(data.steps):
        cost += 0.5 * data.weight * U[k, 0] ** 2
        g[k, 0] = U[k, 0] * X[k, 2] - 5.0
    g[data.steps, 0] = -math.inf
    for i in range(2):
        output_error[i] = X[data.steps, i] - data.target[i]
    return cost + 0.5 * data.weight * U[data.steps, 0] ** 2 + 0.5 * time * time


@allocation_free
def linearise_cart(data, X, U, stages, path, terminal):
    for k in range(data.steps + 1):
        stage, row, h = stages[k], path[k, 0], X[k, 2] / data.steps
        stage.A[0, 0] = stage.A[1, 1] = 1.0
        stage.A[0, 1] = stage.B[1, 0] = h
        stage.B[0, 0] = 0.5 * h * h
        stage.A[0, 2] = (X[k, 1] + h * U[k, 0]) / data.steps
        stage.A[1, 2] = U[k, 0] / data.steps
        stage.L_U[0], stage.L_UU[0, 0] = data.weight * U[k, 0], data.weight
        row.value = U[k, 0] * X[k, 2] - 5.0 if k < data.steps else -math.inf
        row.U[0], row.X[2] = X[k, 2], U[k, 0]
    stages[data.steps].L_X[2], stages[data.steps].L_XX[2, 2] = X[data.steps, 2], 1.0
    for i in range(2):
        terminal[i].value = X[data.steps, i] - data.target[i]
        terminal[i].X[i] = 1.0


# The car: place and heading, then the time; speed and turn rate, then its change.


@allocation_free
def predict_car(data, U, X):
    X[0, :3] = 0.0
    for k in range(data.steps):
        h, middle = X[k, 3] / data.steps, X[k, 2] + 0.5 * X[k, 3] / data.steps * U[k, 1]
        X[k + 1, 0] = X[k, 0] + h * U[k, 0] * math.cos(middle)
        X[k + 1, 1] = X[k, 1] + h * U[k, 0] * math.sin(middle)
        X[k + 1, 2] = X[k, 2] + h * U[k, 1]


@allocation_free
def evaluate_car(data, X, U, output_error, g):
    cost, time = 0.0, X[data.steps, 3]
    for k in range(data.steps + 1):
        for a in range(2):
            cost += 0.5 * data.weight * U[k, a] ** 2
    for i in range(3):
        output_error[i] = X[data.steps, i] - data.target[i]
    return cost + 0.5 * time * time


@allocation_free
def linearise_car(data, X, U, stages, path, terminal):
    for k in range(data.steps + 1):
        stage, h, v, w = stages[k], X[k, 3] / data.steps, U[k, 0], U[k, 1]
        c, s = math.cos(X[k, 2] + 0.5 * h * w), math.sin(X[k, 2] + 0.5 * h * w)
        for i in range(3):
            stage.A[i, i] = 1.0
        stage.A[0, 2], stage.A[1, 2] = -h * v * s, h * v * c
        stage.B[0, 0], stage.B[1, 0], stage.B[2, 1] = h * c, h * s, h
        stage.B[0, 1], stage.B[1, 1] = -0.5 * h * h * v * s, 0.5 * h * h * v * c
        stage.A[0, 3] = (v * c - 0.5 * h * v * w * s) / data.steps
        stage.A[1, 3] = (v * s + 0.5 * h * v * w * c) / data.steps
        stage.A[2, 3] = w / data.steps
        for a in range(2):
            stage.L_U[a], stage.L_UU[a, a] = data.weight * U[k, a], data.weight
    stages[data.steps].L_X[3], stages[data.steps].L_XX[3, 3] = X[data.steps, 3], 1.0
    for i in range(3):
        terminal[i].value = X[data.steps, i] - data.target[i]
        terminal[i].X[i] = 1.0


CART = Functions(predict_cart, evaluate_cart, linearise_cart)
CAR = Functions(predict_car, evaluate_car, linearise_car)


def solved(functions, size, data, time, lower, upper, guess=0.0):
    """Driver after a run from constant controls; `time` is least, guessed and largest."""
    n, r = size.state - 1, size.control - 1
    driver = Driver(
        size, np.full(size.output, 100.0), np.full(size.path, 100.0), np.full(n + 1, np.inf)
    )
    ws, run = driver.ws, driver.ws.run[0]
    run['max_iterations'], run['growth_limit'] = 200, 1e10
    run['output_tolerance'] = run['violation_tolerance'] = run['control_tolerance'] = 1e-9
    run['slack_tolerance'] = 1e-6
    ws.lower[:, :r], ws.upper[:, :r] = lower, upper
    ws.lower[:, r], ws.upper[:, r] = 0.0, 0.0
    ws.lower[0, r], ws.upper[0, r] = time[0] - time[1], time[2] - time[1]
    ws.trial.U[:, :r] = guess
    outer = FreeTimeData(data, data.steps, time[1], n, r)
    outer = outer._replace(functions=functions.addresses(data, ws))
    entries = FREE_TIME.entries(outer, ws)
    driver.improve(entries, outer, data.steps, over=0)
    return driver, entries, outer


def cart(time=(0.1, 3.0, 20.0), weight=1e-5, target=(1.0, 0.0)):
    data, size = Drive(np.array(target), weight, N), Dimensions(N, 3, 2, 2, 1)
    return solved(CART, size, data, time, -1.0, 1.0)


@pytest.mark.parametrize('guess', [0.5, 3.0, 9.0])
def test_least_time_is_that_of_full_thrust_and_full_brake(guess):
    driver, _, _ = cart((0.1, guess, 20.0))
    run, plan = driver.ws.run[0], driver.ws.now
    assert run['outcome'] == Outcome.SOLVED
    assert run['iterations'] < 100
    assert plan.X[N, 2] == pytest.approx(2.0, abs=1e-4)
    wanted = np.where(np.arange(N) < N // 2, 1.0, -1.0)
    np.testing.assert_allclose(plan.U[:N, 0], wanted, atol=1e-2)
    np.testing.assert_allclose(plan.X[N, :2], [1.0, 0.0], atol=1e-8)
    assert plan.X[0, 2] == guess


@pytest.mark.parametrize('least', [2.5, 4.0])
def test_the_time_keeps_its_bounds(least):
    plan = cart((least, 5.0, 20.0))[0].ws.now
    assert plan.X[N, 2] == pytest.approx(least, abs=1e-9)
    np.testing.assert_allclose(plan.X[N, :2], [1.0, 0.0], atol=1e-8)


def test_sensitivities_have_the_time_in_them():
    """``S_N`` and the gradients of cost and constraints against differences."""
    driver, entries, data = cart(target=(1.3, 0.2))
    predict, evaluate, linearise = entries.functions
    ws, at, p = driver.ws, driver.ws.trial, driver.ws.program
    at.U[:] = 0.0
    at.U[:, 0] = np.random.default_rng(0).uniform(-1.0, 1.0, N + 1)
    at.U[0, 1] = 0.4

    def values(change):
        at.U[0, 1] += change
        predict(data, at.U, at.X)
        cost = evaluate(data, at.X, at.U, at.output_error, at.g)
        at.U[0, 1] -= change
        return np.concatenate([[cost], at.output_error, at.g[:N, 0]])

    wanted = (values(1e-6) - values(-1e-6)) / 2e-6
    values(0.0)
    linearise(data, at.X, at.U, p.stages, p.path, p.terminal)
    dX, gradient, rows = np.zeros(ws.now.X.shape[1]), 0.0, []
    for k in range(N + 1):
        stage, own = p.stages[k], float(k == 0)
        rows.append(p.path[k, 0]['X'] @ dX + own * p.path[k, 0]['U'][1])
        gradient += stage['L_X'] @ dX + own * stage['L_U'][1]
        if k < N:
            dX = stage['A'] @ dX + own * stage['B'][:, 1]
    found = np.concatenate([[gradient], p.terminal['X'] @ dX, rows[:N]])
    np.testing.assert_allclose(found, wanted, rtol=1e-6, atol=1e-6)
    assert np.abs(wanted[:3]).min() > 1e-2


def test_a_car_beside_ipopt():
    target, weight, time = np.array([2.0, 1.0, 0.5]), 0.05, (0.5, 4.0, 20.0)
    driver, _, _ = solved(
        CAR, Dimensions(N, 4, 3, 3, 0), Drive(target, weight, N), time, [-1.0, -0.8], [1.0, 0.8],
        [0.5, 0.1],
    )  # fmt: skip
    assert driver.ws.run[0]['outcome'] == Outcome.SOLVED

    U, T, x = casadi.SX.sym('U', 2, N + 1), casadi.SX.sym('T'), casadi.SX.zeros(3)
    for k in range(N):
        h = T / N
        middle = x[2] + 0.5 * h * U[1, k]
        along = casadi.vertcat(U[0, k] * casadi.cos(middle), U[0, k] * casadi.sin(middle), U[1, k])
        x = x + h * along
    cost = 0.5 * T**2 + 0.5 * weight * casadi.sumsqr(U)
    nlp = {'x': casadi.vertcat(casadi.vec(U), T), 'f': cost, 'g': x - target}
    quiet = {'print_time': False, 'ipopt': {'print_level': 0, 'sb': 'yes', 'tol': 1e-10}}
    bound = np.append(np.tile([1.0, 0.8], N + 1), 20.0)
    answer = casadi.nlpsol('reference', 'ipopt', nlp, quiet)(
        x0=np.append(np.tile([0.5, 0.1], N + 1), 4.0),
        lbx=np.append(-bound[:-1], 0.5), ubx=bound, lbg=0.0, ubg=0.0,
    )  # fmt: skip
    assert driver.ws.run[0]['cost'] == pytest.approx(float(answer['f']), rel=1e-6)
    assert driver.ws.now.X[N, 3] == pytest.approx(float(answer['x'][-1]), rel=1e-4)
