"""Re-entry glide of the farthest range [Betts, Practical Methods for Optimal Control, Sec. 6.1]."""

import casadi
import numpy as np

from examples.common import Example, runge_kutta

N, T, EARTH, GRAVITY = 60, 900.0, 6.3712e6, 3.986e14
x, u, at_end = casadi.SX.sym('x', 4), casadi.SX.sym('u'), casadi.SX.sym('p')


def rate(x, u):
    """Height [m], speed [m/s], path angle [rad] and range [m] for an angle of attack [rad]."""
    height, speed, angle = x[0], x[1], x[2]
    r = EARTH + height
    pressure = 0.5 * 1.225 * casadi.exp(-height / 7200.0) * speed**2 * 250.0 / 92000.0
    lift, drag = 1.67 * u - 0.2, 0.08 - 0.35 * u + 2.04 * u**2
    return casadi.vertcat(
        speed * casadi.sin(angle),
        -pressure * drag - GRAVITY / r**2 * casadi.sin(angle),
        pressure * lift / speed + casadi.cos(angle) * (speed / r - GRAVITY / (speed * r**2)),
        speed * casadi.cos(angle) * EARTH / r,
    )


def draw(axes, X, U):
    """Height over range, and the angle of attack."""
    axes[0].plot(1e-3 * X[:, 3], 1e-3 * X[:, 0])
    axes[0].set(xlabel='range [km]', ylabel='height [km]')
    axes[1].step(np.linspace(0.0, T, N + 1), np.degrees(U), where='post')
    axes[1].set(xlabel='time [s]', ylabel='angle of attack [deg]')


EXAMPLE = Example(
    'reentry',
    'Betts 2010',
    {
        'horizon': N, 'x0': [79e3, 7500.0, np.radians(-1.0), 0.0], 'x': x, 'u': u,
        'p': at_end, 'p_values': np.append(np.zeros(N), 1.0), 'F': runge_kutta(rate, x, u, T / N),
        'L': 0.1 * (u - 0.3) ** 2 - 1e-6 * at_end * x[3], 'h': x[0], 'target': [30e3],
        'lower': 0.0, 'upper': 0.8,
    },
    np.full((N + 1, 1), 0.3),
    draw,
)  # fmt: skip

if __name__ == '__main__':
    EXAMPLE.show()
