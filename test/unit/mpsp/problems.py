"""Small optimal control problems for the tests of the method, and a check of derivatives."""

from dataclasses import dataclass, replace

import numpy as np
import pytest

from cmpsp_ros.mpsp import Dimensions, Evaluation, Linearisation, OptimalControlProblem, Options
from cmpsp_ros.mpsp.models.derivatives import check_derivatives
from cmpsp_ros.mpsp.sqp.solve import solve


class LinearQuadratic(OptimalControlProblem):
    """Time-varying linear dynamics, outputs and constraints, quadratic cost with cross terms."""

    def __init__(self, rng, horizon=5, state=3, control=2, output=2, path=2):
        stages = horizon + 1
        self.size = Dimensions(horizon, state, control, output, path)
        self.control_lower = np.full((stages, control), -np.inf)
        self.control_upper = np.full((stages, control), np.inf)
        self.target = rng.normal(size=output)
        self.start = rng.normal(size=state)
        self.A = np.eye(state) + 0.3 * rng.normal(size=(horizon, state, state))
        self.B = rng.normal(size=(horizon, state, control))
        self.drift = 0.1 * rng.normal(size=(horizon, state))
        root = rng.normal(size=(stages, state + control, state + control))
        self.W = root @ root.transpose(0, 2, 1) / 4.0 + 0.5 * np.eye(state + control)
        self.w = rng.normal(size=(stages, state + control))
        self.h_X = rng.normal(size=(output, state))
        self.h_U = rng.normal(size=(output, control))
        self.g_X = rng.normal(size=(stages, path, state))
        self.g_U = rng.normal(size=(stages, path, control))
        self.room = rng.uniform(0.5, 2.0, size=(stages, path))
        # Some constraints do not apply, everywhere at stage 0 as for constraints of the state.
        self.applies = rng.random((stages, path)) < 0.7
        self.applies[0] = False

    def predict(self, U):
        X = [self.start]
        for A, B, drift, control in zip(self.A, self.B, self.drift, U, strict=False):
            X.append(A @ X[-1] + B @ control + drift)
        return np.array(X)

    def evaluate(self, X, U):
        Z = np.hstack([X, U])
        cost = 0.5 * np.einsum('ki,kij,kj->', Z, self.W, Z) + np.vdot(self.w, Z)
        return Evaluation(float(cost), self._miss(X, U), self._g(X, U))

    def linearise(self, X, U, hessian='gauss_newton'):
        n = self.size.state
        Z = np.hstack([X, U])
        slope = np.einsum('kij,kj->ki', self.W, Z) + self.w
        return Linearisation(
            A=self.A,
            B=self.B,
            L_X=slope[:, :n].copy(),
            L_U=slope[:, n:].copy(),
            L_XX=self.W[:, :n, :n].copy(),
            L_UX=self.W[:, n:, :n].copy(),
            L_UU=self.W[:, n:, n:].copy(),
            output_error=self._miss(X, U),
            h_X=self.h_X,
            h_U=self.h_U,
            g=self._g(X, U),
            g_X=self.g_X,
            g_U=self.g_U,
        )

    def _miss(self, X, U):
        return self.h_X @ X[-1] + self.h_U @ U[-1] - self.target

    def _g(self, X, U):
        g = np.einsum('kli,ki->kl', self.g_X, X) + np.einsum('kli,ki->kl', self.g_U, U)
        return np.where(self.applies, g - self.room, -np.inf)


@dataclass
class VanDerPol(OptimalControlProblem):
    """A forced Van der Pol oscillator under Euler steps, in a speed corridor.

    ``floor`` bounds the velocity from below and ``mixed`` the sum of position and control from
    above; both may be infinite, and then take no row. ``passes`` says whether it must pass the
    goal at the end.
    """

    horizon: int = 20
    start: tuple[float, float] = (1.0, 0.5)
    goal: tuple[float, float] = (0.0, 0.0)
    step: float = 0.1
    damping: float = 1.0
    floor: float = -np.inf
    mixed: float = np.inf
    limit: float = np.inf
    passes: bool = True

    def __post_init__(self):
        outputs = 2 if self.passes else 0
        self.size = Dimensions(self.horizon, 2, 1, outputs, 2)
        self.control_upper = np.full((self.horizon + 1, 1), self.limit)
        self.control_lower = -self.control_upper
        self.target = np.array(self.goal[:outputs])

    def predict(self, U):
        X = np.empty((self.horizon + 1, 2))
        X[0] = self.start
        with np.errstate(all='ignore'):
            for k in range(self.horizon):
                x, v = X[k]
                pull = self.damping * (1.0 - x * x) * v - x + U[k, 0]
                X[k + 1] = x + self.step * v, v + self.step * pull
        return X

    def evaluate(self, X, U):
        with np.errstate(all='ignore'):
            cost = (
                0.5 * (np.vdot(X, X) + np.vdot(U, U)) + 0.25 * (X[:, 0] ** 2 * U[:, 0] ** 2).sum()
            )
            return Evaluation(float(cost), self._miss(X), self._g(X, U))

    def linearise(self, X, U, hessian='gauss_newton'):
        stages, (x, v), u = len(X), X.T, U[:, 0]
        A = np.tile(np.eye(2), (stages - 1, 1, 1))
        A[:, 0, 1] = self.step
        A[:, 1, 0] = self.step * (-2.0 * self.damping * x * v - 1.0)[:-1]
        A[:, 1, 1] += self.step * self.damping * (1.0 - x * x)[:-1]
        B = np.tile([[0.0], [self.step]], (stages - 1, 1, 1))
        L_XX = np.tile(np.eye(2), (stages, 1, 1))
        L_XX[:, 0, 0] += 0.5 * u * u
        L_UX = np.zeros((stages, 1, 2))
        L_UX[:, 0, 0] = x * u
        g_X, g_U = np.zeros((stages, 2, 2)), np.zeros((stages, 2, 1))
        g_X[:, 0, 1], g_X[:, 1, 0], g_U[:, 1, 0] = -1.0, 1.0, 1.0
        return Linearisation(
            A=A,
            B=B,
            L_X=np.column_stack([x + 0.5 * x * u * u, v]),
            L_U=U + 0.5 * (x * x)[:, None] * U,
            L_XX=L_XX,
            L_UX=L_UX,
            L_UU=(1.0 + 0.5 * x * x)[:, None, None] * np.ones((stages, 1, 1)),
            output_error=self._miss(X),
            h_X=np.eye(2)[: self.size.output],
            h_U=np.zeros((self.size.output, 1)),
            g=self._g(X, U),
            g_X=g_X,
            g_U=g_U,
        )

    def _miss(self, X):
        return X[-1, : self.size.output] - self.target

    def _g(self, X, U):
        g = np.column_stack([self.floor - X[:, 1], X[:, 0] + U[:, 0] - self.mixed])
        g[0, 0] = -np.inf
        return g


def differences(function, at, step=1e-6):
    """Central differences: shape of the function's value, then the shape of ``at``."""
    columns = []
    for place in np.ndindex(at.shape):
        ahead, behind = at.copy(), at.copy()
        ahead[place] += step
        behind[place] -= step
        columns.append((function(ahead) - function(behind)) / (2.0 * step))
    columns = np.array(columns)
    return np.moveaxis(columns, 0, -1).reshape(*columns.shape[1:], *at.shape)


def assert_derivatives(problem, U, hessian=None, proximal=0.0, atol=1e-6):
    """Every array of a linearisation is that of `predict` and `evaluate`.

    Args:
        problem: The problem.
        U: Where, shape ``(N + 1, r)``.
        hessian: Kind whose second derivatives of the cost are to be compared; None for none.
        proximal: What the linearisation adds to the diagonal of ``L_UU`` by intent.
        atol: Largest error.
    """
    X = problem.predict(U)
    lin, here = problem.linearise(X, U), problem.evaluate(X, U)
    lin.check(problem.size)
    np.testing.assert_array_equal(lin.output_error, here.output_error)
    np.testing.assert_array_equal(lin.g, here.g)
    report = check_derivatives(problem, U, atol, hessian, proximal)
    assert report.is_right, report


def assert_same_problem(found, wanted, U, kinds, atol):
    """Prediction, value and derivatives with each kind of Hessian are the same."""
    X = wanted.predict(U)
    np.testing.assert_allclose(found.predict(U), X, atol=1e-12)
    here, there = found.evaluate(X, U), wanted.evaluate(X, U)
    assert here.cost == pytest.approx(there.cost, rel=1e-12)
    np.testing.assert_allclose(here.output_error, there.output_error, atol=1e-12)
    np.testing.assert_allclose(here.g, there.g, atol=1e-12)
    applies = np.isfinite(there.g)
    for kind in kinds:
        lin, reference = found.linearise(X, U, kind), wanted.linearise(X, U, kind)
        lin.check(found.size)
        for name, array in vars(reference).items():
            mask = applies if name in {'g_X', 'g_U'} else ...
            pair = getattr(lin, name)[mask], array[mask]
            np.testing.assert_allclose(*pair, atol=atol, err_msg=f'{name} {kind}')
            assert getattr(lin, name).flags.c_contiguous


def options_for(problem, **changes):
    size = problem.size
    given = Options(np.full(size.output, 1e3), np.full(size.path, 1e3))
    return replace(given, **changes)


def zeros(problem):
    return np.zeros(problem.control_lower.shape)


def run(problem, guess, options, iterations):
    solution = solve(problem, guess, options, iterations)
    return solution.iterate, solution.status


class TooFlat(VanDerPol):
    """Problem with a fraction of the true Hessian, so that every step is far too long."""

    fraction = 1e-3

    def linearise(self, X, U, hessian='gauss_newton'):
        lin = super().linearise(X, U, hessian)
        L_XX, L_UX, L_UU = (self.fraction * part for part in (lin.L_XX, lin.L_UX, lin.L_UU))
        return replace(lin, L_XX=L_XX, L_UX=L_UX, L_UU=L_UU)


class HalfHearted(LinearQuadratic):
    """Problem with a quarter of the true Hessian: full steps overshoot by a factor of three."""

    def linearise(self, X, U, hessian='gauss_newton'):
        lin = super().linearise(X, U, hessian)
        return replace(lin, L_XX=lin.L_XX / 4.0, L_UX=lin.L_UX / 4.0, L_UU=lin.L_UU / 4.0)
