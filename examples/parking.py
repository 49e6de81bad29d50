"""Parking a car in the least time, which is free [Li and Shao, Simultaneous parking, 2015]."""

import casadi
import numpy as np

from examples.common import Example, runge_kutta

N = 40
x, u, T = casadi.SX.sym('x', 3), casadi.SX.sym('u', 2), casadi.SX.sym('T')


def rate(x, u):
    """Place [m] and heading [rad] for a speed [m/s] and a steering angle [rad]; axles 1.5 m."""
    return casadi.vertcat(
        u[0] * casadi.cos(x[2]), u[0] * casadi.sin(x[2]), u[0] * casadi.tan(u[1]) / 1.5
    )


def draw(axes, X, U):
    """Path with headings, speed and steering angle."""
    axes[0].plot(X[:, 0], X[:, 1])
    axes[0].quiver(X[::4, 0], X[::4, 1], np.cos(X[::4, 2]), np.sin(X[::4, 2]), width=0.004)
    axes[0].set(xlabel='x [m]', ylabel='y [m]', aspect='equal')
    time = np.linspace(0.0, X[-1, 3], N + 1)
    axes[1].step(time, U[:, :2], where='post', label=['speed [m/s]', 'steering [rad]'])
    axes[1].set(xlabel='time [s]')
    axes[1].legend()


SIDEWAYS = np.repeat([[0.5, 0.3, 0.0], [0.5, -0.3, 0.0]], [N // 2, N // 2 + 1], axis=0)
EXAMPLE = Example(
    'parking',
    'Li, Shao 2015',
    {
        'horizon': N, 'x0': np.zeros(3), 'x': x, 'u': u, 'T': T, 'final_time': (0.5, 6.0, 30.0),
        'F': runge_kutta(rate, x, u, T / N), 'L': T / (N + 1) + 1e-3 * T / N * casadi.sumsqr(u),
        'h': x, 'target': [1.0, 2.0, 0.0], 'lower': [-1.0, -0.6], 'upper': [1.0, 0.6],
    },
    SIDEWAYS,
    draw,
)  # fmt: skip

if __name__ == '__main__':
    EXAMPLE.show()
