"""Impact angle guidance of a missile [Oza and Padhi, Impact-angle-constrained MPSP, 2012]."""

import casadi
import numpy as np

from examples.common import Example, runge_kutta

N, T, SPEED = 60, 12.5, 300.0
x, u = casadi.SX.sym('x', 3), casadi.SX.sym('u')


def rate(x, u):
    """Downrange and height [m] and flight-path angle [rad] for a lateral acceleration [m/s^2]."""
    return casadi.vertcat(SPEED * casadi.cos(x[2]), SPEED * casadi.sin(x[2]), u / SPEED)


def draw(axes, X, U):
    """Trajectory and acceleration."""
    axes[0].plot(X[:, 0], X[:, 1])
    axes[0].set(xlabel='downrange [m]', ylabel='height [m]', aspect='equal')
    axes[1].step(np.linspace(0.0, T, N + 1), U, where='post')
    axes[1].set(xlabel='time [s]', ylabel='acceleration [m/s²]')


EXAMPLE = Example(
    'impact_angle',
    'Oza, Padhi 2012',
    {
        'horizon': N, 'x0': [0.0, 0.0, np.radians(20.0)], 'x': x, 'u': u,
        'F': runge_kutta(rate, x, u, T / N), 'L': 0.5 * T / N * u**2,
        'h': x, 'target': [3000.0, 0.0, np.radians(-60.0)],
    },
    np.zeros((N + 1, 1)),
    draw,
)  # fmt: skip

if __name__ == '__main__':
    EXAMPLE.show()
