"""A planar quadrotor between two discs [Foehn, Romero, Scaramuzza, Time-optimal planning, 2021]."""

import casadi
import numpy as np

from examples.common import Example, runge_kutta

N, T, HOVER = 40, 2.4, 9.81 / 2.0
DISCS = ((0.7, -0.2, 0.35), (1.4, 0.5, 0.35))
x, u = casadi.SX.sym('x', 6), casadi.SX.sym('u', 2)


def rate(x, u):
    """Place [m] and tilt [rad] and their rates for the thrusts of both sides [N]; mass 1 kg."""
    thrust = u[0] + u[1]
    pushed = casadi.vertcat(-thrust * casadi.sin(x[2]), thrust * casadi.cos(x[2]) - 9.81)
    return casadi.vertcat(x[3:], pushed, 6.0 * (u[0] - u[1]))


def draw(axes, X, U):
    """Path past the discs, and the thrusts."""
    turn = np.linspace(0.0, 2.0 * np.pi, 60)
    for a, b, radius in DISCS:
        axes[0].fill(a + radius * np.cos(turn), b + radius * np.sin(turn), color='0.8')
    axes[0].plot(X[:, 0], X[:, 1], marker='.')
    axes[0].set(xlabel='x [m]', ylabel='z [m]', aspect='equal')
    axes[1].step(np.linspace(0.0, T, N + 1), U, where='post', label=['left', 'right'])
    axes[1].set(xlabel='time [s]', ylabel='thrust [N]')
    axes[1].legend()


EXAMPLE = Example(
    'quadrotor',
    'Foehn et al. 2021',
    {
        'horizon': N, 'x0': np.zeros(6), 'x': x, 'u': u, 'F': runge_kutta(rate, x, u, T / N),
        'residuals': [u[0] - HOVER, u[1] - HOVER, 0.3 * x[2], 0.1 * x[5]],
        'h': x, 'target': [2.0, 0.0, 0.0, 0.0, 0.0, 0.0], 'lower': 1.0, 'upper': 8.0,
        'g': [r - casadi.sqrt((x[0] - a) ** 2 + (x[1] - b) ** 2) for a, b, r in DISCS],
    },
    HOVER + 0.3 * np.column_stack([np.cos(np.arange(N + 1)), np.sin(np.arange(N + 1))]),
    draw,
)  # fmt: skip

if __name__ == '__main__':
    EXAMPLE.show()
