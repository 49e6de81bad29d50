"""An optimal control problem from plain numpy functions, differentiated numerically."""

from abc import abstractmethod
from collections.abc import Callable
from copy import copy
from typing import Any, Literal, NamedTuple, Self, get_args

import numpy as np
from numpy.typing import ArrayLike

from cmpsp_ros.arrays import Array
from cmpsp_ros.mpsp.arguments import (
    ProblemError,
    control_bounds,
    free_final_time,
    terminal_target,
    vector,
    whole_number,
)
from cmpsp_ros.mpsp.models.derivatives import Scheme, StageFunction
from cmpsp_ros.mpsp.problem import (
    Dimensions,
    Evaluation,
    Hessian,
    Linearisation,
    OptimalControlProblem,
    check_hessian,
)
from cmpsp_ros.mpsp.qp.curvature import nearest_positive_semidefinite, project_stages


class StageProblem(OptimalControlProblem):
    """A problem whose derivatives come by ``Z_k = (X_k, U_k)``; the first ones are checked."""

    def __init__(
        self, size: Dimensions, start: Array, target: Array, bounds: tuple[Array, Array]
    ) -> None:
        """Take the sizes, the initial state ``(n,)``, the target ``(m,)`` and the bounds.

        Raises:
            ProblemError: They do not fit each other.
        """
        self.size, self.target = size, target
        self.control_lower, self.control_upper = bounds
        self.check()
        self._start, self._checked = start, False

    def updated(self, *, x0: ArrayLike | None = None, target: ArrayLike | None = None) -> Self:
        """The same problem from another initial state, or to another target; nothing is rebuilt.

        Raises:
            ProblemError: Names the argument, with the value found and the one wanted.
        """
        other = copy(self)
        if x0 is not None:
            vars(other)['_start'] = vector('x0', x0, self.size.state)
        if target is not None:
            other.target = vector('target', target, self.size.output)
        return other

    def linearise(self, X: Array, U: Array, hessian: Hessian = 'gauss_newton') -> Linearisation:
        """Derivatives along a trajectory.

        Raises:
            ProblemError: There is no such Hessian, or a derivative is not finite the first time.
        """
        check_hessian(hessian)
        result = self._linearised(X, U, hessian)
        if not self._checked:
            result.check(self.size)
            self._checked = True
        return result

    def constraint_curvature(
        self, X: Array, U: Array, costates: Array, terminal: Array, path: Array
    ) -> tuple[Array, Array, Array]:
        """Second derivatives, as described in `OptimalControlProblem`."""
        return self._blocks(self._curvature(X, U, costates, terminal, path))

    def _blocks(self, second: Array) -> tuple[Array, Array, Array]:
        n = self.size.state
        return second[:, :n, :n], second[:, n:, :n], second[:, n:, n:]

    @abstractmethod
    def _linearised(self, X: Array, U: Array, hessian: Hessian) -> Linearisation:
        """Derivatives along a trajectory, unchecked."""

    @abstractmethod
    def _curvature(
        self, X: Array, U: Array, costates: Array, terminal: Array, path: Array
    ) -> Array:
        """Weighted second derivatives by ``Z_k``, shape ``(N + 1, d, d)``."""


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
    final_time: ArrayLike | None = None,
) -> StageProblem:
    """Set up a problem (1)-(6) from functions of one stage, for trying things out.

    Functions take ``k``, a state of shape ``(n,)`` and a control of shape ``(r,)``, may depend on
    ``k`` in any way, and are called stage by stage.

    The cost is the sum of ``L`` and ``1/2 |residuals|^2``, of which one may be missing. With the
    Gauss-Newton Hessian, residuals contribute ``R' R`` with their Jacobian ``R``; ``L``, which
    has no such structure, contributes the positive semi-definite part of its second derivative.

    A path constraint does not apply where ``g`` returns ``-inf``. Nor do those at stage 0 that
    no control changes: the state there is known.

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
            ``central`` differences take any. ``auto`` lets CasADi differentiate, if it is there and
            the functions only do arithmetic (`tracing`): exact, and hundreds of times as fast.
            Else it takes, for each function apart, the complex step where it agrees with
            differences at a few points about ``x0``.
        final_time: Least, guessed and largest final time where it is free. All functions then take
            the final time ``T`` after ``u``, as for a step of ``T / N``. It becomes the last state,
            and its change from the guess the last control, which is free at stage 0 and 0 later:
            controls ``(N + 1, r + 1)``. A row of three for each of ``q`` phases makes ``T`` the
            vector of their times, ``(q,)``, of which each stage takes the one that it belongs to.

    Returns:
        The problem. Its first linearisation raises `ProblemError` where a derivative is not finite.

    Raises:
        ProblemError: Names the argument, with the value found and the one wanted.
    """
    N, r = whole_number('horizon', horizon), whole_number('controls', controls)
    start = vector('x0', x0)
    bounds = control_bounds(lower, upper, (N + 1, r))
    output: Callable[..., Any] | None = h and (lambda _, *of: h(*of))
    if final_time is not None:
        phases, is_one = len(np.atleast_2d(final_time)), np.ndim(final_time) == 1
        start, *limits = free_final_time(final_time, start, *bounds, phases)
        r, bounds = r + phases, (limits[0], limits[1])

        def with_time(function: Callable[..., Any]) -> Callable[[int, Any, Any], Any]:
            def of(k: int, z: Any, v: Any) -> Any:
                T = z[-phases:] + v[-phases:]
                return function(k, z[:-phases], v[:-phases], T[0] if is_one else T)

            return of

        step = with_time(F)
        L, residuals, g = (each and with_time(each) for each in (L, residuals, g))
        output = output and with_time(output)

        def F(k: int, z: Any, v: Any) -> Any:
            return np.append(step(k, z, v), z[-phases:] + v[-phases:])

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
        None if output is None else stage('h', output, None),
        None if g is None else stage('g', g, None),
    )
    reach = terminal_target(target, None if functions.h is None else functions.h.shape[0])
    size = Dimensions(N, n, r, len(reach), 0 if functions.g is None else functions.g.shape[0])
    problem = _FunctionsProblem(size, start, functions, reach, bounds)
    if derivatives != 'auto':
        return problem
    from cmpsp_ros.mpsp.models.tracing import traced_problem  # noqa: PLC0415 (a circle)

    given = {name: each for name, each in functions._asdict().items() if each is not None}
    return traced_problem(problem, given, start, probes, problem.fixed) or problem


def _probes(start: Array, lower: Array, upper: Array) -> list[Array]:
    """The initial state and a few points ``Z_k`` about it, the same ones every time."""
    rng = np.random.default_rng(0)
    r = lower.shape[1]
    X = start + 0.1 * (1.0 + np.abs(start)) * rng.uniform(-1.0, 1.0, (_PROBES, len(start)))
    U = rng.uniform(-1.0, 1.0, (_PROBES, r))
    X[0], U[0] = start, 0.0
    return list(np.hstack([X, np.clip(U, lower[0], upper[0])]))


class _Functions(NamedTuple):
    F: StageFunction
    L: StageFunction | None
    residuals: StageFunction | None
    h: StageFunction | None
    g: StageFunction | None


class _FunctionsProblem(StageProblem):
    def __init__(
        self,
        size: Dimensions,
        start: Array,
        functions: _Functions,
        target: Array,
        bounds: tuple[Array, Array],
    ) -> None:
        super().__init__(size, start, target, bounds)
        self._functions = functions
        self.fixed = np.empty(0, dtype=bool)
        if functions.g is not None:
            Z = np.array(_probes(start, *bounds))
            Z[:, : size.state] = start
            values = np.array([functions.g(0, each) for each in Z])
            # Of the path constraints at stage 0, those that no control changes.
            self.fixed = (values == values[0]).all(axis=0)

    def predict(self, U: Array) -> Array:
        X = np.empty((self.size.horizon + 1, self.size.state))
        X[0] = self._start
        for k in range(self.size.horizon):
            X[k + 1] = self._functions.F(k, np.concatenate([X[k], U[k]]))
        return X

    def next_states(self, X: Array, U: Array) -> Array:
        Z = np.hstack([X, U])
        return np.array([self._functions.F(k, Z[k]) for k in range(self.size.horizon)])

    def evaluate(self, X: Array, U: Array) -> Evaluation:
        Z, f = np.hstack([X, U]), self._functions
        cost, g = 0.0, np.empty((len(Z), self.size.path))
        for k in range(len(Z)):
            if f.L is not None:
                cost += float(f.L(k, Z[k]))
            if f.residuals is not None:
                residuals = f.residuals(k, Z[k])
                cost += 0.5 * float(residuals @ residuals)
            if f.g is not None:
                g[k] = f.g(k, Z[k])
        g[0, self.fixed] = -np.inf
        output = np.empty(0) if f.h is None else f.h(self.size.horizon, Z[-1])
        return Evaluation(cost, output - self.target, g)

    def _linearised(self, X: Array, U: Array, hessian: Hessian) -> Linearisation:
        n, at = self.size.state, self.evaluate(X, U)
        F_Z, L_Z, L_ZZ, h_Z, g_Z = self._derivatives(X, U, hessian)
        g_Z[at.g == -np.inf] = 0.0
        blocks = self._blocks(L_ZZ)
        if hessian == 'projected':
            blocks = project_stages(*blocks)
        arrays = (
            F_Z[..., :n], F_Z[..., n:], L_Z[:, :n], L_Z[:, n:], *blocks,
            at.output_error, h_Z[:, :n], h_Z[:, n:], at.g, g_Z[..., :n], g_Z[..., n:],
        )  # fmt: skip
        return Linearisation(*map(np.ascontiguousarray, arrays))

    def _derivatives(self, X: Array, U: Array, hessian: Hessian) -> tuple[Array, ...]:
        """Jacobians and Hessians by ``Z_k``."""
        Z, f, N = np.hstack([X, U]), self._functions, self.size.horizon
        stages, d = Z.shape
        F_Z = np.array([f.F.jacobian(k, Z[k]) for k in range(N)])
        L_Z, L_ZZ = np.zeros((stages, d)), np.zeros((stages, d, d))
        h_Z = np.zeros((0, d)) if f.h is None else f.h.jacobian(N, Z[N])
        g_Z = np.zeros((stages, self.size.path, d))
        for k in range(stages):
            if f.L is not None:
                L_Z[k] += f.L.jacobian(k, Z[k])
                of_L = f.L.hessian(k, Z[k])
                is_gauss_newton = hessian == 'gauss_newton'
                L_ZZ[k] += nearest_positive_semidefinite(of_L) if is_gauss_newton else of_L
            if f.residuals is not None:
                value, R = f.residuals(k, Z[k]), f.residuals.jacobian(k, Z[k])
                L_Z[k] += value @ R
                L_ZZ[k] += R.T @ R
                if hessian != 'gauss_newton':
                    L_ZZ[k] += _weighted(f.residuals, value).hessian(k, Z[k])
            if f.g is not None:
                g_Z[k] = f.g.jacobian(k, Z[k])
        return F_Z, L_Z, L_ZZ, h_Z, g_Z

    def _curvature(
        self, X: Array, U: Array, costates: Array, terminal: Array, path: Array
    ) -> Array:
        Z, f, N = np.hstack([X, U]), self._functions, self.size.horizon
        second = np.zeros((N + 1, Z.shape[1], Z.shape[1]))
        for k in range(N):
            second[k] = _weighted(f.F, costates[k]).hessian(k, Z[k])
        if f.h is not None:
            second[N] += _weighted(f.h, terminal).hessian(N, Z[N])
        if f.g is not None:
            for k in np.flatnonzero(path.any(axis=1)).tolist():
                second[k] += _weighted(f.g, path[k]).hessian(k, Z[k])
        return second


def _weighted(function: StageFunction, weights: Array) -> StageFunction:
    """``weights' function`` as a function; where a weight is 0, values may be ``-inf``."""

    def total(k: int, x: Array, u: Array) -> Any:
        return weights @ np.where(weights == 0.0, 0.0, function(k, np.concatenate([x, u])))

    result = StageFunction(function.name, total, 0, ())
    result.scheme = function.scheme
    return result
