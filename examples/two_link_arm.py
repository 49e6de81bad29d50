"""Two-link arm swung from hanging to upright [M. Spong, The swing up control problem, 1995]."""

import casadi
import numpy as np

from examples.common import Example, runge_kutta

N, T = 50, 1.5
x, u = casadi.SX.sym('x', 4), casadi.SX.sym('u', 2)


def rate(x, u):
    """Joint angles and rates [rad, rad/s] for torques [N m]; links of 1 kg and 0.5 m."""
    c, s = casadi.cos(x[1]), casadi.sin(x[1])
    inner, outer = 5.0 / 12.0 + 0.25 * c, 1.0 / 12.0 + 0.125 * c
    M = casadi.blockcat([[inner, outer], [outer, 1.0 / 12.0]])
    coriolis = casadi.vertcat(-0.125 * s * (2.0 * x[2] + x[3]) * x[3], 0.125 * s * x[2] ** 2)
    weight = 2.4525 * casadi.cos(x[0] + x[1])
    gravity = casadi.vertcat(7.3575 * casadi.cos(x[0]) + weight, weight)
    return casadi.vertcat(x[2:], casadi.solve(M, u - coriolis - gravity))


def draw(axes, X, U):
    """The arm every second step, and the torques."""
    for k in range(0, N + 1, 2):
        angles = np.array([X[k, 0], X[k, 0] + X[k, 1]])
        places = 0.5 * np.cumsum([np.cos(angles), np.sin(angles)], axis=1)
        axes[0].plot([0.0, *places[0]], [0.0, *places[1]], color=str(0.8 - 0.8 * k / N))
    axes[0].set(xlabel='x [m]', ylabel='y [m]', aspect='equal')
    axes[1].step(np.linspace(0.0, T, N + 1), U, where='post', label=['shoulder', 'elbow'])
    axes[1].set(xlabel='time [s]', ylabel='torque [N m]')
    axes[1].legend()


EXAMPLE = Example(
    'two_link_arm',
    'Spong 1995',
    {
        'horizon': N, 'x0': [-np.pi / 2, 0.0, 0.0, 0.0], 'x': x, 'u': u,
        'F': runge_kutta(rate, x, u, T / N), 'L': 0.005 * T / N * casadi.sumsqr(u),
        'h': x, 'target': [np.pi / 2, 0.0, 0.0, 0.0], 'lower': -10.0, 'upper': 10.0,
    },
    np.zeros((N + 1, 2)),
    draw,
)  # fmt: skip

if __name__ == '__main__':
    EXAMPLE.show()
