"""Van der Pol's oscillator as a regulator, with a limit on the state and the control."""

import casadi
import numpy as np

from examples.common import Example, runge_kutta

N, T = 50, 5.0
x, u = casadi.SX.sym('x', 2), casadi.SX.sym('u')


def rate(x, u):
    """The oscillator."""
    return casadi.vertcat(x[1], (1.0 - x[0] ** 2) * x[1] - x[0] + u)


def draw(axes, X, U):
    """States with the limit, and the control."""
    time = np.linspace(0.0, T, N + 1)
    axes[0].plot(time, X, label=['x', 'rate'])
    axes[0].axhline(-0.4, color='0.8')
    axes[0].set(xlabel='time', ylabel='state')
    axes[0].legend()
    axes[1].step(time, U, where='post')
    axes[1].set(xlabel='time', ylabel='control')


EXAMPLE = Example(
    'van_der_pol',
    'CasADi examples',
    {
        'horizon': N, 'x0': [1.0, 0.0], 'x': x, 'u': u, 'F': runge_kutta(rate, x, u, T / N),
        'residuals': [x[0], x[1], 0.5 * u], 'h': x, 'target': [0.0, 0.0], 'g': [-0.4 - x[1]],
        'lower': -0.9, 'upper': 0.9,
    },
    np.zeros((N + 1, 1)),
    draw,
)  # fmt: skip

if __name__ == '__main__':
    EXAMPLE.show()
