"""Lunar soft landing in a glide cone [Sachan and Padhi, Waypoint constrained MPSP, 2019]."""

import casadi
import numpy as np

from examples.common import Example, runge_kutta

N, T, EXHAUST = 60, 70.0, 2207.0
x, u = casadi.SX.sym('x', 7), casadi.SX.sym('u', 3)


def rate(x, u):
    """Place [m], velocity [m/s] and mass [kg] for a thrust [N]."""
    gravity = casadi.vertcat(0.0, 0.0, -1.62)
    burnt = casadi.sqrt(casadi.sumsqr(u) + 1.0) / EXHAUST
    return casadi.vertcat(x[3:6], u / x[6] + gravity, -burnt)


def draw(axes, X, U):
    """Height over the distance from the landing point, and the thrust."""
    axes[0].plot(np.hypot(X[:, 0], X[:, 1]), X[:, 2])
    axes[0].set(xlabel='distance [m]', ylabel='height [m]')
    axes[1].step(np.linspace(0.0, T, N + 1), np.linalg.norm(U, axis=1), where='post')
    axes[1].set(xlabel='time [s]', ylabel='thrust [N]')


EXAMPLE = Example(
    'lunar_landing',
    'Sachan, Padhi 2019',
    {
        'horizon': N, 'x0': [450.0, -330.0, 2400.0, -40.0, 10.0, -10.0, 1905.0], 'x': x, 'u': u,
        'F': runge_kutta(rate, x, u, T / N), 'L': 0.5e-6 * T / N * casadi.sumsqr(u),
        'h': x[:6], 'target': np.zeros(6), 'lower': -16000.0, 'upper': 16000.0,
        'g': [
            casadi.sumsqr(u) - 13000.0**2,
            x[0] ** 2 + x[1] ** 2 - 10.0 * (x[2] + 5.0) ** 2,
        ],
    },
    np.tile([0.0, 0.0, 3000.0], (N + 1, 1)),
    draw,
)  # fmt: skip

if __name__ == '__main__':
    EXAMPLE.show()
