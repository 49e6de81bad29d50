"""An optimal control problem from plain numpy functions, differentiated numerically."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cmpsp_ros.mpsp.errors import ProblemError
from cmpsp_ros.mpsp.models.arguments import (
    check_hessian,
    control_bounds,
    terminal_target,
    vector,
    whole_number,
)
from cmpsp_ros.mpsp.models.differences import Scheme, StageFunction
from cmpsp_ros.mpsp.problem import (
    Array,
    Dimensions,
    Evaluation,
    Hessian,
    Linearisation,
    OptimalControlProblem,
)
from cmpsp_ros.mpsp.qp.curvature import nearest_positive_semidefinite, project_stages

Derivatives = Literal['auto', Scheme]

_PROBES = 4


def from_functions(
    *,
    horizon: int,
    x0: ArrayLike,
    controls: int,
    F: Callable[[int, Any, Any], Any],
    L: Callable[[int, Any, Any], Any] | None = None,
    residuals: Callable[[int, Any, Any], Any] | None = None,
    h: Callable[[Any, Any], Any] | None = None,
    target: ArrayLike | None = None,
    g: Callable[[int, Any, Any], Any] | None = None,
    lower: ArrayLike | None = None,
    upper: ArrayLike | None = None,
    derivatives: Derivatives = 'auto',
) -> OptimalControlProblem:
    """Set up a problem (1)-(6) from functions of one stage, for trying things out.

    Functions take ``k``, a state of shape ``(n,)`` and a control of shape ``(r,)``, may depend on
    ``k`` in any way, and are called stage by stage.

    The cost is the sum of ``L`` and ``1/2 |residuals|^2``, of which one may be missing. With the
    Gauss-Newton Hessian, residuals contribute ``R' R`` with their Jacobian ``R``; ``L``, which
    has no such structure, contributes the positive semi-definite part of its second derivative.

    A path constraint does not apply where ``g`` returns ``-inf``. Nor do those at stage 0 that
    have the same value whatever the control: the state there is known, nothing can change them.

    Args:
        horizon: ``N``, at least 1.
        x0: Initial state (6), shape ``(n,)``.
        controls: ``r``, the length of ``u``.
        F: Dynamics (1), ``F(k, x, u)`` for ``k < N``, value of shape ``(n,)``.
        L: Cost of a stage (3), ``L(k, x, u)`` for ``k <= N``, a number.
        residuals: ``residuals(k, x, u)`` for ``k <= N``, shape ``(any,)``, the same at all stages.
        h: Terminal output (2), ``h(x, u)`` at stage ``N``, shape ``(m,)``; None for none.
        target: ``Y_N*`` of (5), shape ``(m,)``.
        g: Path constraints (4), ``g(k, x, u)`` for ``k <= N``, shape ``(l,)``, met where not
            positive; None for none.
        lower: Least controls: a number, shape ``(r,)`` or ``(N + 1, r)``; None for no limit.
        upper: Largest controls, likewise.
        derivatives: ``complex_step`` is exact to rounding but wants functions that are analytic
            and take complex arrays: no ``abs``, ``norm``, ``arctan2``, no transpose-conjugate.
            ``central`` differences take any. ``auto`` decides for each function apart: the
            complex step where it agrees with differences at a few points about ``x0``.

    Returns:
        The problem. Its first linearisation raises `ProblemError` where a derivative is not finite.

    Raises:
        ProblemError: Names the argument, what was found and what was wanted.
    """
    N, r = whole_number('horizon', horizon), whole_number('controls', controls)
    start = vector('x0', x0)
    bounds = control_bounds(lower, upper, (N + 1, r))
    if derivatives not in get_args(Scheme) and derivatives != 'auto':
        wanted = ', '.join(('auto', *get_args(Scheme)))
        raise ProblemError(f'derivatives: found {derivatives!r}, wanted one of {wanted}')
    if L is None and residuals is None:
        raise ProblemError('L: found none and no residuals, wanted one of them')
    probes = _probes(start, *bounds)
    n = len(start)

    def stage(
        name: str, function: Callable[..., Any], shape: tuple[int, ...] | None
    ) -> StageFunction:
        if shape is None:
            with np.errstate(all='ignore'):
                shape = np.shape(function(0, probes[0][:n].copy(), probes[0][n:].copy()))
            if len(shape) != 1:
                raise ProblemError(f'{name}: found shape {shape}, wanted a vector')
        result = StageFunction(name, function, n, shape)
        last = N - 1 if name == 'F' else N
        result(0, probes[0])
        if derivatives == 'auto':
            result.choose_scheme((k * last // (_PROBES - 1), Z) for k, Z in enumerate(probes))
        else:
            result.scheme = derivatives
        return result

    functions = _Functions(
        stage('F', F, (n,)),
        None if L is None else stage('L', L, ()),
        None if residuals is None else stage('residuals', residuals, None),
        None if h is None else stage('h', lambda _, x, u: h(x, u), None),
        None if g is None else stage('g', g, None),
    )
    outputs = None if functions.h is None else functions.h.shape[0]
    return _FunctionsProblem(N, start, r, functions, terminal_target(target, outputs), bounds)


def _probes(start: Array, lower: Array, upper: Array) -> list[Array]:
    """The initial state and a few points ``Z_k`` about it, the same ones every time."""
    rng = np.random.default_rng(0)
    r = lower.shape[1]
    X = start + 0.1 * (1.0 + np.abs(start)) * rng.uniform(-1.0, 1.0, (_PROBES, len(start)))
    U = rng.uniform(-1.0, 1.0, (_PROBES, r))
    X[0], U[0] = start, 0.0
    return list(np.hstack([X, np.clip(U, lower[0], upper[0])]))


@dataclass(frozen=True)
class _Functions:
    F: StageFunction
    L: StageFunction | None
    residuals: StageFunction | None
    h: StageFunction | None
    g: StageFunction | None


class _FunctionsProblem(OptimalControlProblem):
    def __init__(
        self,
        horizon: int,
        start: Array,
        controls: int,
        functions: _Functions,
        target: Array,
        bounds: tuple[Array, Array],
    ) -> None:
        path = 0 if functions.g is None else functions.g.shape[0]
        self.size = Dimensions(horizon, len(start), controls, len(target), path)
        self.control_lower, self.control_upper = bounds
        self.target = target
        self.check()
        self._start = start
        self._functions = functions
        self._fixed = self._fixed_at_start()
        self._checked = False

    def _fixed_at_start(self) -> NDArray[np.bool_]:
        """Which path constraints at stage 0 no control changes, shape ``(l,)``."""
        if self._functions.g is None:
            return np.empty(0, dtype=bool)
        values = [
            self._functions.g(0, np.concatenate([self._start, probe[len(self._start) :]]))
            for probe in _probes(self._start, self.control_lower, self.control_upper)
        ]
        fixed: NDArray[np.bool_] = np.all([value == values[0] for value in values], axis=0)
        return fixed

    def predict(self, U: Array) -> Array:
        X = np.empty((self.size.horizon + 1, self.size.state))
        X[0] = self._start
        for k in range(self.size.horizon):
            X[k + 1] = self._functions.F(k, np.concatenate([X[k], U[k]]))
        return X

    def evaluate(self, X: Array, U: Array) -> Evaluation:
        Z = np.hstack([X, U])
        cost = 0.0
        for k in range(len(Z)):
            if self._functions.L is not None:
                cost += float(self._functions.L(k, Z[k]))
            if self._functions.residuals is not None:
                residuals = self._functions.residuals(k, Z[k])
                cost += 0.5 * float(residuals @ residuals)
        return Evaluation(cost, self._output_error(Z), self._g(Z))

    def linearise(self, X: Array, U: Array, hessian: Hessian = 'gauss_newton') -> Linearisation:
        check_hessian(hessian)
        N, n = self.size.horizon, self.size.state
        Z = np.hstack([X, U])
        F_Z = np.array([self._functions.F.jacobian(k, Z[k]) for k in range(N)])
        L_Z, L_ZZ = self._cost_derivatives(Z, hessian)
        h_Z = np.zeros((self.size.output, Z.shape[1]))
        if self._functions.h is not None:
            h_Z = self._functions.h.jacobian(N, Z[N])
        g, g_Z = self._g(Z), np.zeros((N + 1, self.size.path, Z.shape[1]))
        if self._functions.g is not None:
            for k in range(N + 1):
                g_Z[k] = self._functions.g.jacobian(k, Z[k])
        g_Z[g == -np.inf] = 0.0
        L_XX, L_UX, L_UU = L_ZZ[:, :n, :n], L_ZZ[:, n:, :n], L_ZZ[:, n:, n:]
        if hessian == 'projected':
            L_XX, L_UX, L_UU = project_stages(L_XX, L_UX, L_UU)
        arrays = (
            F_Z[:, :, :n], F_Z[:, :, n:],
            L_Z[:, :n], L_Z[:, n:], L_XX, L_UX, L_UU,
            self._output_error(Z), h_Z[:, :n], h_Z[:, n:],
            g, g_Z[:, :, :n], g_Z[:, :, n:],
        )  # fmt: skip
        result = Linearisation(*map(np.ascontiguousarray, arrays))
        if not self._checked:
            result.check(self.size)
            self._checked = True
        return result

    def _cost_derivatives(self, Z: Array, hessian: Hessian) -> tuple[Array, Array]:
        stages, d = Z.shape
        gradient, second = np.zeros((stages, d)), np.zeros((stages, d, d))
        L, residuals = self._functions.L, self._functions.residuals
        for k in range(stages):
            if L is not None:
                gradient[k] += L.jacobian(k, Z[k])
                L_ZZ = L.hessian(k, Z[k])
                if hessian == 'gauss_newton':
                    L_ZZ = nearest_positive_semidefinite(L_ZZ)
                second[k] += L_ZZ
            if residuals is not None:
                value, R = residuals(k, Z[k]), residuals.jacobian(k, Z[k])
                gradient[k] += value @ R
                second[k] += R.T @ R
                if hessian != 'gauss_newton':
                    second[k] += _weighted(residuals, value).hessian(k, Z[k])
        return gradient, second

    def constraint_curvature(
        self, X: Array, U: Array, costates: Array, terminal: Array, path: Array
    ) -> tuple[Array, Array, Array]:
        Z, n, N = np.hstack([X, U]), self.size.state, self.size.horizon
        second = np.zeros((N + 1, Z.shape[1], Z.shape[1]))
        for k in range(N):
            second[k] = _weighted(self._functions.F, costates[k]).hessian(k, Z[k])
        if self._functions.h is not None:
            second[N] += _weighted(self._functions.h, terminal).hessian(N, Z[N])
        if self._functions.g is not None:
            for k in np.flatnonzero(path.any(axis=1)).tolist():
                second[k] += _weighted(self._functions.g, path[k]).hessian(k, Z[k])
        return second[:, :n, :n], second[:, n:, :n], second[:, n:, n:]

    def _output_error(self, Z: Array) -> Array:
        if self._functions.h is None:
            return np.empty(0)
        output: Array = self._functions.h(self.size.horizon, Z[-1])
        return output - self.target

    def _g(self, Z: Array) -> Array:
        g = np.empty((len(Z), self.size.path))
        if self._functions.g is not None:
            for k in range(len(Z)):
                g[k] = self._functions.g(k, Z[k])
            g[0, self._fixed] = -np.inf
        return g


def _weighted(function: StageFunction, weights: Array) -> StageFunction:
    """``weights' function`` as a function."""
    result = StageFunction(
        function.name, lambda k, x, u: weights @ function(k, np.concatenate([x, u])), 0, ()
    )
    result.scheme = function.scheme
    return result
