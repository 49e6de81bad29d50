"""Transfer between circular orbits, in metres and seconds [Bryson and Ho, Sec. 2.7]."""

import casadi
import numpy as np

from examples.common import Example, runge_kutta

GRAVITY, RADIUS = 3.986e14, 7e6
N, T = 60, 3.3 * np.sqrt(RADIUS**3 / GRAVITY)
TOP = 0.5 * GRAVITY / RADIUS**2
x, u = casadi.SX.sym('x', 4), casadi.SX.sym('u', 2)


def rate(x, u):
    """Radius [m], radial and tangential velocity [m/s], angle [rad], for accelerations [m/s^2]."""
    radial = x[2] ** 2 / x[0] - GRAVITY / x[0] ** 2 + u[0]
    return casadi.vertcat(x[1], radial, u[1] - x[1] * x[2] / x[0], x[2] / x[0])


def draw(axes, X, U):
    """Path with both orbits, and the acceleration."""
    turn = np.linspace(0.0, 2.0 * np.pi, 100)
    for radius in (1e-3 * RADIUS, 1.5e-3 * RADIUS):
        axes[0].plot(radius * np.cos(turn), radius * np.sin(turn), color='0.8')
    axes[0].plot(1e-3 * X[:, 0] * np.cos(X[:, 3]), 1e-3 * X[:, 0] * np.sin(X[:, 3]))
    axes[0].set(xlabel='x [km]', ylabel='y [km]', aspect='equal')
    axes[1].step(np.linspace(0.0, T, N + 1), U, where='post', label=['radial', 'tangential'])
    axes[1].set(xlabel='time [s]', ylabel='acceleration [m/s²]')
    axes[1].legend()


CIRCULAR = np.sqrt(GRAVITY / RADIUS)
EXAMPLE = Example(
    'orbit_transfer',
    'Bryson, Ho 1975',
    {
        'horizon': N, 'x0': [RADIUS, 0.0, CIRCULAR, 0.0], 'x': x, 'u': u,
        'F': runge_kutta(rate, x, u, T / N), 'L': 0.5 * T / N * casadi.sumsqr(u),
        'h': x[:3], 'target': [1.5 * RADIUS, 0.0, CIRCULAR / np.sqrt(1.5)],
        'lower': -TOP, 'upper': TOP,
    },
    np.zeros((N + 1, 2)),
    draw,
)  # fmt: skip

if __name__ == '__main__':
    EXAMPLE.show()
