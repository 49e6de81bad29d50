"""Goddard's rocket: the greatest height on a given tank [Betts, Sec. 4.14.1]; a singular arc."""

import casadi
import numpy as np

from examples.common import Example, runge_kutta

N, T = 80, 0.2
x, u, at_end = casadi.SX.sym('x', 3), casadi.SX.sym('u'), casadi.SX.sym('p')


def rate(x, u):
    """Radius, velocity and mass for a thrust, all relative to their scales at the ground."""
    drag = 310.0 * x[1] ** 2 * casadi.exp(-500.0 * (x[0] - 1.0))
    return casadi.vertcat(x[1], (3.5 * u - drag) / x[2] - 1.0 / x[0] ** 2, -7.0 * u)


def draw(axes, X, U):
    """Height and thrust."""
    time = np.linspace(0.0, T, N + 1)
    axes[0].plot(time, X[:, 0] - 1.0)
    axes[0].set(xlabel='time', ylabel='height')
    axes[1].step(time, U, where='post')
    axes[1].set(xlabel='time', ylabel='thrust')


EXAMPLE = Example(
    'goddard_rocket',
    'Betts 2010',
    {
        'horizon': N, 'x0': [1.0, 0.0, 1.0], 'x': x, 'u': u,
        'p': at_end, 'p_values': np.append(np.zeros(N), 1.0), 'F': runge_kutta(rate, x, u, T / N),
        'L': 1e-9 * u**2 - 100.0 * at_end * (x[0] - 1.0), 'h': x[2], 'target': [0.6],
        'lower': 0.0, 'upper': 1.0,
    },
    np.full((N + 1, 1), 0.3),
    draw,
)  # fmt: skip

if __name__ == '__main__':
    EXAMPLE.show()
