"""Swing-up of a pole on a cart [M. Kelly, An introduction to trajectory optimization, 2017]."""

import casadi
import numpy as np

from examples.common import Example, runge_kutta

N, T = 40, 2.0
x, u = casadi.SX.sym('x', 4), casadi.SX.sym('u')


def rate(x, u):
    """Position [m] and angle [rad], and their rates; cart 1 kg, pole 0.3 kg and 0.5 m."""
    s, c = casadi.sin(x[1]), casadi.cos(x[1])
    along = (0.15 * s * x[3] ** 2 + u + 2.943 * c * s) / (1.3 - 0.3 * c**2)
    about = -(0.15 * c * s * x[3] ** 2 + u * c + 12.753 * s) / (0.65 - 0.15 * c**2)
    return casadi.vertcat(x[2], x[3], along, about)


def draw(axes, X, U):
    """The pole every second step, and the force."""
    for k in range(0, N + 1, 2):
        tip = X[k, 0] + 0.5 * np.sin(X[k, 1]), -0.5 * np.cos(X[k, 1])
        axes[0].plot([X[k, 0], tip[0]], [0.0, tip[1]], color=str(0.8 - 0.8 * k / N))
    axes[0].set(xlabel='x [m]', ylabel='y [m]', aspect='equal')
    axes[1].step(np.linspace(0.0, T, N + 1), U, where='post')
    axes[1].set(xlabel='time [s]', ylabel='force [N]')


EXAMPLE = Example(
    'cart_pole',
    'Kelly 2017',
    {
        'horizon': N, 'x0': np.zeros(4), 'x': x, 'u': u, 'F': runge_kutta(rate, x, u, T / N),
        'L': T / N * u**2, 'h': x, 'target': [1.0, np.pi, 0.0, 0.0], 'lower': -20.0, 'upper': 20.0,
    },
    np.zeros((N + 1, 1)),
    draw,
)  # fmt: skip

if __name__ == '__main__':
    EXAMPLE.show()
