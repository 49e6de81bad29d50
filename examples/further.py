"""Six more problems, as data: from a double integrator to a quadrotor of 12 states."""

from typing import Any

import casadi
import numpy as np

from examples.common import Example, runge_kutta


def _symbols(states: int, controls: int) -> tuple[Any, Any]:
    return casadi.SX.sym('x', states), casadi.SX.sym('u', controls)


def _double_integrator() -> Example:
    x, u = _symbols(2, 1)
    stated = {
        'horizon': 50, 'x0': [1.0, 0.0], 'x': x, 'u': u,
        'F': [x[0] + 0.05 * x[1] + 0.00125 * u, x[1] + 0.05 * u], 'L': 0.05 * u**2,
        'h': x, 'target': [0.0, 0.0], 'g': [x[1] - 0.2, -0.55 - x[1]], 'lower': -2.0, 'upper': 2.0,
    }  # fmt: skip
    return Example('double_integrator', 'Bryson, Ho 1975', stated, np.zeros((51, 1)))


def _least_time() -> Example:
    (x, u), T = _symbols(2, 1), casadi.SX.sym('T')
    h = T / 40
    stated = {
        'horizon': 40, 'x0': [0.0, 0.0], 'x': x, 'u': u, 'T': T, 'final_time': (0.1, 3.0, 20.0),
        'F': [x[0] + h * x[1] + 0.5 * h**2 * u, x[1] + h * u], 'L': T / 41,
        'h': x, 'target': [1.0, 0.0], 'lower': -1.0, 'upper': 1.0,
    }  # fmt: skip
    return Example('least_time', 'Bryson, Ho 1975', stated, np.zeros((41, 2)))


def _car_rate(x: Any, u: Any) -> Any:
    """Place [m], heading [rad], speed [m/s], for an acceleration [m/s^2] and a curvature [1/m]."""
    v = x[3]
    return casadi.vertcat(v * casadi.cos(x[2]), v * casadi.sin(x[2]), v * u[1], u[0])


def _gear_switch() -> Example:
    x, u = _symbols(4, 2)
    stated = {
        'horizon': 50, 'x0': np.zeros(4), 'x': x, 'u': u, 'F': runge_kutta(_car_rate, x, u, 0.12),
        'L': 0.06 * (u[0] ** 2 + u[1] ** 2 + 0.1 * x[3] ** 2), 'h': x,
        'target': [0.0, 1.0, 0.0, 0.0], 'lower': [-2.0, -1.0], 'upper': [2.0, 1.0],
    }  # fmt: skip
    guess = np.repeat([[1.0, 0.5], [-1.0, 0.0], [-1.0, -0.5]], [12, 26, 13], axis=0)
    return Example('gear_switch', 'Reeds, Shepp 1990', stated, guess)


def _waypoints() -> Example:
    (x, u), p = _symbols(4, 2), casadi.SX.sym('p', 3)
    at = np.zeros((61, 3))
    at[20], at[40] = [1.0, 2.0, 1.0], [1.0, 4.0, -1.0]
    off = (x[0] - p[1]) ** 2 + (x[1] - p[2]) ** 2 - 0.01
    stated = {
        'horizon': 60, 'x0': [0.0, 0.0, 0.0, 1.0], 'x': x, 'u': u, 'p': p, 'p_values': at,
        'F': runge_kutta(_car_rate, x, u, 0.1), 'L': 0.05 * (u[0] ** 2 + u[1] ** 2), 'h': x[:3],
        'target': [6.0, 0.0, 0.0], 'lower': -2.0, 'upper': 2.0,
        'g': [off], 'applies': at[:, :1] > 0.0,
    }  # fmt: skip
    return Example('waypoints', 'Sachan, Padhi 2019', stated, np.zeros((61, 2)))


def _attitude() -> Example:
    x, u = _symbols(6, 3)

    def rate(x: Any, u: Any) -> Any:
        """Rodrigues parameters and angular velocity [rad/s] of a rigid body, for torques [N m]."""
        s, w = x[:3], x[3:]
        turn = w + casadi.cross(s, w) + s * casadi.dot(s, w)
        J = casadi.DM([1.0, 2.0, 3.0])
        return casadi.vertcat(0.5 * turn, (u - casadi.cross(w, J * w)) / J)

    stated = {
        'horizon': 40, 'x0': [0.6, -0.3, 0.2, 0.0, 0.0, 0.0], 'x': x, 'u': u,
        'F': runge_kutta(rate, x, u, 0.1), 'L': 0.05 * casadi.sumsqr(u), 'h': x,
        'target': np.zeros(6), 'lower': -0.6, 'upper': 0.6,
    }  # fmt: skip
    return Example('attitude', 'Tsiotras 1996', stated, np.zeros((41, 3)))


def _quadrotor_12() -> Example:
    (x, u), hover = _symbols(12, 4), 9.81 / 4.0

    def rate(x: Any, u: Any) -> Any:
        """Place [m], velocity [m/s], Euler angles [rad], body rates [rad/s], for four thrusts."""
        c, s, T = casadi.cos(x[6:9]), casadi.sin(x[6:9]), casadi.sum1(u)
        p, q, r = x[9], x[10], x[11]
        about = q * s[0] + r * c[0]
        return casadi.vertcat(
            x[3:6],
            T * (c[0] * s[1] * c[2] + s[0] * s[2]), T * (c[0] * s[1] * s[2] - s[0] * c[2]),
            T * c[0] * c[1] - 9.81,
            p + about * s[1] / c[1], q * c[0] - r * s[0], about / c[1],
            8.0 * (u[1] - u[3]) - 0.6 * q * r, 8.0 * (u[2] - u[0]) + 0.6 * p * r,
            0.5 * (u[0] - u[1] + u[2] - u[3]),
        )  # fmt: skip

    residuals = [*casadi.vertsplit(u - hover), *casadi.vertsplit(0.3 * x[6:])]
    stated = {
        'horizon': 40, 'x0': np.zeros(12), 'x': x, 'u': u, 'F': runge_kutta(rate, x, u, 0.05),
        'residuals': residuals, 'h': x, 'target': [1.0, 1.0, 0.5, *np.zeros(9)],
        'lower': 0.5, 'upper': 5.0,
    }  # fmt: skip
    return Example('quadrotor_12', 'Foehn et al. 2021', stated, np.full((41, 4), hover))


EXAMPLES = [
    make()
    for make in (
        _double_integrator, _least_time, _gear_switch, _waypoints, _attitude, _quadrotor_12,
    )
]  # fmt: skip
