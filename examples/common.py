"""Common parts: one step of Runge and Kutta, an example, and IPOPT on the same model."""

import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import casadi
import numpy as np

from cmpsp_ros.mpsp import Solution, from_casadi, solve

IMAGES = Path(__file__).parents[1] / 'doc' / 'images' / 'examples'


def runge_kutta(rate: Callable[[Any, Any], Any], x: Any, u: Any, h: Any) -> Any:
    """State after a step of length `h` at a constant control, to fourth order."""
    k1 = rate(x, u)
    k2 = rate(x + 0.5 * h * k1, u)
    k3 = rate(x + 0.5 * h * k2, u)
    k4 = rate(x + h * k3, u)
    return x + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)


@dataclass(frozen=True)
class Example:
    """A problem as stated for `from_casadi`, its guess, its source, and a picture of a solution."""

    name: str
    source: str
    stated: dict[str, Any]
    guess: np.ndarray
    draw: Callable[[Any, np.ndarray, np.ndarray], None] | None = None

    def in_other_units(self, guess: np.ndarray) -> tuple[dict[str, Any], np.ndarray]:
        """The problem and a guess with every state and control in units of its own."""
        x, u, free = self.stated['x'], self.stated['u'], 'T' in self.stated
        by = [10.0 ** ((7 * np.arange(each.shape[0]) + 2) % 5 - 2) for each in (x, u)]
        old, new = [x, u], [x * by[0], u * by[1]]
        parts = {
            name: casadi.substitute([_column(self.stated[name])], old, new)[0]
            for name in ('F', 'L', 'residuals', 'h', 'g')
            if name in self.stated
        }
        bounds = {
            name: np.asarray(self.stated[name]) / by[1]
            for name in ('lower', 'upper')
            if name in self.stated
        }
        x0 = np.asarray(self.stated['x0']) / by[0]
        changed = {**self.stated, **parts, **bounds, 'F': parts['F'] / by[0], 'x0': x0}
        return changed, guess / np.append(by[1], [1.0] * free)

    def solve(self) -> Solution:
        """Solve it from its guess."""
        return solve(from_casadi(**self.stated), self.guess)

    def show(self) -> None:
        """Solve it, say how it ended, and save the picture."""
        if self.draw is None:
            return
        import matplotlib as mpl  # noqa: PLC0415 (slow to import)

        mpl.use('Agg')
        from matplotlib import pyplot as plt  # noqa: PLC0415 (after the back end)

        solution = self.solve()
        print(solution.sentence)  # noqa: T201 (a program's output)
        figure, axes = plt.subplots(1, 2, figsize=(9.0, 3.2), layout='constrained')
        X, U = solution.iterate.X, solution.iterate.U.copy()
        # The last control is held to the end; after it there is none.
        U[-1] = U[-2]
        self.draw(axes, X, U)
        IMAGES.mkdir(parents=True, exist_ok=True)
        figure.savefig(IMAGES / f'{self.name}.png', dpi=100)
        plt.close(figure)


@dataclass(frozen=True)
class Reference:
    """IPOPT's answer: status, iterations, cost, controls, and its processor time [s]."""

    status: str
    iterations: int
    cost: float
    U: np.ndarray
    seconds: float


def ipopt(
    stated: dict[str, Any], U: np.ndarray, X: np.ndarray, *, stays: bool = False
) -> Reference:
    """Solve the full nonlinear program, states and controls unknown, from a guess of both.

    IPOPT moves a start away from its bounds, unless it is told that it `stays`.
    """
    free = 'T' in stated
    x, u, N = stated['x'], stated['u'], stated['horizon']
    n, r = x.shape[0], u.shape[0]
    p, T = stated.get('p', casadi.SX.sym('p', 0)), stated.get('T', casadi.SX.sym('T', 0))
    values = np.reshape(stated.get('p_values', np.zeros((N + 1, 0))), (N + 1, -1))
    cost = stated.get('L', 0) + 0.5 * casadi.sumsqr(_column(stated.get('residuals', [])))
    h, g = _column(stated.get('h', [])), _column(stated.get('g', []))
    stage = casadi.Function('stage', [x, u, p, T], [_column(stated['F']), cost, g, h])
    depends = casadi.which_depends(g, u, 1, True) if g.shape[0] else []
    applies = stated.get('applies', np.ones((N + 1, g.shape[0]), bool))
    xs, us = casadi.SX.sym('X', n, N + 1), casadi.SX.sym('U', r, N + 1)
    rows, least, total = [xs[:, 0] - np.asarray(stated['x0'], float)], [np.zeros(n)], 0
    for k in range(N + 1):
        ahead, value, inequalities, output = stage(xs[:, k], us[:, k], values[k], T)
        total += value
        if k < N:
            rows.append(xs[:, k + 1] - ahead)
            least.append(np.zeros(n))
        else:
            rows.append(output - np.asarray(stated.get('target', []), float))
            least.append(np.zeros(h.shape[0]))
        wanted = [inequalities[j] for j in range(g.shape[0]) if applies[k, j] and (k or depends[j])]
        rows += wanted
        least.append(np.full(len(wanted), -np.inf))
    times = np.atleast_2d(stated['final_time']).T if free else np.zeros((3, 0))
    bounds = [
        np.concatenate([
            np.full(n * (N + 1), fill),
            np.broadcast_to(stated.get(name, fill), (N + 1, r)).ravel(),
            times[end],
        ])
        for fill, name, end in ((-np.inf, 'lower', 0), (np.inf, 'upper', 2))
    ]  # fmt: skip
    start = [X[:, :n].ravel(), U[:, :r].ravel(), times[1]]
    unknowns = casadi.vertcat(casadi.vec(xs), casadi.vec(us), T)
    options = {'print_time': False, 'ipopt': {'print_level': 0, 'sb': 'yes', 'tol': 1e-9}}
    if stays:
        near = ('bound_push', 'bound_frac', 'slack_bound_push', 'slack_bound_frac', 'mu_init')
        options['ipopt'] |= dict.fromkeys(near, 1e-9)
    program = {'x': unknowns, 'f': total, 'g': casadi.vertcat(*rows)}
    solver = casadi.nlpsol('reference', 'ipopt', program, options)
    began = time.process_time()
    answer = solver(
        x0=np.concatenate(start), lbx=bounds[0], ubx=bounds[1], lbg=np.concatenate(least), ubg=0.0
    )
    seconds, stats = time.process_time() - began, solver.stats()
    controls = answer['x'].full().ravel()[n * (N + 1) : (n + r) * (N + 1)].reshape(N + 1, r)
    return Reference(
        stats['return_status'], stats['iter_count'], float(answer['f']), controls, seconds
    )


def _column(value: Any) -> Any:
    return casadi.vertcat(*value) if isinstance(value, (list, tuple)) else casadi.SX(value)
