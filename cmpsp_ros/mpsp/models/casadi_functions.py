"""An optimal control problem from CasADi expressions, differentiated by CasADi."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Self

import numpy as np
from numpy.typing import ArrayLike

from cmpsp_ros.arrays import Array, BoolArray
from cmpsp_ros.mpsp.arguments import (
    ProblemError,
    control_bounds,
    numbers,
    terminal_target,
    vector,
    whole_number,
)
from cmpsp_ros.mpsp.models.functions import StageProblem
from cmpsp_ros.mpsp.problem import Dimensions, Evaluation, Hessian
from cmpsp_ros.mpsp.qp.curvature import nearest_positive_semidefinite

if TYPE_CHECKING:
    from types import ModuleType


def from_casadi(
    *,
    horizon: int,
    x0: ArrayLike,
    x: Any,
    u: Any,
    F: Any,
    L: Any = None,
    residuals: Any = None,
    h: Any = None,
    target: ArrayLike | None = None,
    g: Any = None,
    lower: ArrayLike | None = None,
    upper: ArrayLike | None = None,
    p: Any = None,
    p_values: ArrayLike | None = None,
    applies: ArrayLike | None = None,
    T: Any = None,
    final_time: tuple[float, float, float] | None = None,
) -> CasadiProblem:
    """Set up a problem (1)-(6) from CasADi expressions of one stage.

    The cost is the sum of ``L`` and ``1/2 |residuals|^2``, of which one may be missing. With the
    Gauss-Newton Hessian, residuals contribute ``R' R`` with their Jacobian ``R``; ``L``, which
    has no such structure, contributes the positive semi-definite part of its second derivative.

    Data that vary from stage to stage, such as ``k``, are a symbol ``p`` with its values.

    Args:
        horizon: ``N``, at least 1.
        x0: Initial state (6), shape ``(n,)``.
        x: Symbol of the state, SX or MX, a column.
        u: Symbol of the control, likewise.
        F: Dynamics (1), a column like ``x``, or a list of its components.
        L: Cost of a stage (3), a scalar.
        residuals: Column or list.
        h: Terminal output (2), column or list; None for none.
        target: ``Y_N*`` of (5), shape ``(m,)``.
        g: Path constraints (4), column or list, met where not positive; None for none. Those that
            do not depend on ``u`` do not apply at stage 0: nothing can change them.
        lower: Least controls: a number, shape ``(r,)`` or ``(N + 1, r)``; None for no limit.
        upper: Largest controls, likewise.
        p: Symbol of the data that vary with the stage, a column; None for none.
        p_values: Its values, shape ``(N + 1, size of p)`` or, for a scalar ``p``, ``(N + 1,)``.
        applies: Which path constraints apply at which stage, shape ``(N + 1, l)``; None for all.
        T: Symbol of a final time that is free, a scalar; ``F``, ``L``, ``residuals``, ``h`` and
            ``g`` may depend on it, as on a step of length ``T / N``. None where it is fixed.
        final_time: Least, guessed and largest final time. It becomes the last state, and its
            change from the guess the last control, which is free at stage 0 and 0 later: controls
            ``(N + 1, r + 1)``.

    Returns:
        The problem. Its first linearisation raises `ProblemError` where a derivative is not finite.

    Raises:
        ImportError: CasADi is not installed.
        ProblemError: Names the argument, with the value found and the one wanted.
    """
    casadi = _casadi()
    if T is not None:
        if final_time is None or not 0.0 < final_time[0] <= final_time[1] <= final_time[2]:
            order = '0 < least <= guess <= largest'
            raise ProblemError(f'final_time: found {final_time}, wanted {order}')
        bounds = control_bounds(lower, upper, (whole_number('horizon', horizon) + 1, u.shape[0]))
        lower, upper = _with_time_bounds(*bounds, final_time)
        x0 = np.append(vector('x0', x0), final_time[1])
        old = [x, u, T]
        x, u = (type(each).sym(name, each.shape[0] + 1) for name, each in {'x': x, 'u': u}.items())
        ahead = x[-1] + u[-1]
        new = [x[:-1], u[:-1], ahead]
        F, L, residuals, h, g = (
            None
            if each is None
            else casadi.substitute([_column(casadi, 'expression', each, type(x))], old, new)[0]
            for each in (F, L, residuals, h, g)
        )
        F = casadi.vertcat(F, ahead)
    elif final_time is not None:
        raise ProblemError('T: found none with final_time, wanted its symbol')
    N, start = whole_number('horizon', horizon), vector('x0', x0)
    n = len(start)
    if p is None:
        if p_values is not None:
            raise ProblemError('p: found none with p_values, wanted their symbol')
        p = (casadi.MX if isinstance(x, casadi.MX) else casadi.SX).sym('p', 0)
    symbols = {'x': x, 'u': u, 'p': p}
    for name, symbol in symbols.items():
        if not (isinstance(symbol, (casadi.SX, casadi.MX)) and symbol.is_valid_input()):
            raise ProblemError(f'{name}: found {symbol!r}, wanted a symbol, SX or MX')
        if symbol.shape[1] != 1:
            raise ProblemError(f'{name}: found shape {symbol.shape}, wanted a column')
    if x.shape[0] != n:
        raise ProblemError(f'x: found {x.shape[0]} components, wanted {n}, as many as x0 has')
    if L is None and residuals is None:
        raise ProblemError('L: found none and no residuals, wanted one of them')

    given = {'F': F, 'L': L, 'residuals': residuals, 'h': h, 'g': g}
    columns = {name: _column(casadi, name, value, type(x)) for name, value in given.items()}
    for name, length in {'F': n, 'L': 0 if L is None else 1}.items():
        found = columns[name].shape
        if found[0] != length:
            raise ProblemError(f'{name}: found shape {found}, wanted {(length, 1)}')
    expressions = _Expressions(casadi, symbols, columns)

    r, path = u.shape[0], columns['g'].shape[0]
    applying = np.ones((N + 1, path), dtype=bool)
    if applies is not None:
        wanted = np.array(applies, dtype=bool)
        if wanted.shape != applying.shape:
            raise ProblemError(f'applies: found shape {wanted.shape}, wanted {applying.shape}')
        applying &= wanted
    applying[0] &= np.array(casadi.which_depends(columns['g'], u, 1, True), dtype=bool)[:path]
    return CasadiProblem(
        Dimensions(N, n, r, columns['h'].shape[0], path),
        start,
        expressions,
        terminal_target(target, None if h is None else columns['h'].shape[0]),
        control_bounds(lower, upper, (N + 1, r)),
        _values(p_values, (N + 1, p.shape[0])),
        applying,
    )


def _casadi() -> ModuleType:
    try:
        import casadi  # noqa: PLC0415 (an optional extra)
    except ImportError as error:
        raise ImportError(
            "from_casadi needs CasADi, which is the extra 'casadi': pip install 'cmpsp_ros[casadi]'"
        ) from error
    module: ModuleType = casadi
    return module


def _with_time_bounds(
    lower: Array, upper: Array, final_time: tuple[float, float, float]
) -> tuple[Array, Array]:
    """Bounds with those of the change of the final time, which happens at stage 0."""
    least, guess, largest = final_time
    change = np.zeros((2, len(lower), 1))
    change[:, 0, 0] = least - guess, largest - guess
    return np.hstack([lower, change[0]]), np.hstack([upper, change[1]])


def _column(casadi: ModuleType, name: str, value: Any, kind: type) -> Any:
    """``value`` as a dense column of the symbols' kind; an empty one for None."""
    if value is None:
        return kind(0, 1)
    try:
        if isinstance(value, (list, tuple)):
            value = casadi.vertcat(*value)
        column = casadi.densify(kind(value))
    except (NotImplementedError, RuntimeError, TypeError) as error:
        raise ProblemError(
            f'{name}: found {value!r}, wanted an expression in x, u and p of the same kind as x'
        ) from error
    if column.shape[1] != 1:
        raise ProblemError(f'{name}: found shape {column.shape}, wanted a column')
    return column


def _values(values: ArrayLike | None, shape: tuple[int, int]) -> Array:
    array = np.zeros((shape[0], 0)) if values is None else numbers('p_values', values)
    if array.shape == shape[:1] and shape[1] == 1:
        array = array[:, None]
    if array.shape != shape:
        raise ProblemError(f'p_values: found shape {array.shape}, wanted {shape}')
    return array


class _Expressions:
    """Functions of one stage."""

    def __init__(
        self, casadi: ModuleType, symbols: dict[str, Any], columns: dict[str, Any]
    ) -> None:
        self._casadi, self._symbols, self._columns = casadi, symbols, columns
        self._cost = casadi.sum1(columns['L']) + 0.5 * casadi.sumsqr(columns['residuals'])
        for name, column in columns.items():
            self._function(name, [column])

    def made(self, name: str) -> Any:
        """A function by its name; derivatives are by ``(x, u)``.

        - ``step``: ``F``; ``value``: cost, ``h`` and ``g``.
        - ``first``: Jacobians of ``F``, ``h``, ``g`` and cost; ``exact``: Hessian of the cost.
        - ``gauss_newton``: Hessian of ``L``, and the residuals' Gauss-Newton Hessian.
        - ``curvature``: Hessian of ``F``, ``h`` and ``g``, weighted with ``w``.
        """
        casadi, columns, by_z = self._casadi, self._columns, self._by_z
        F, h, g, L, R = (columns[each] for each in ('F', 'h', 'g', 'L', 'residuals'))
        if name == 'step':
            return self._function(name, [F])
        if name == 'value':
            return self._function(name, [self._cost, h, g])
        if name == 'first':
            return self._function(name, [by_z(column) for column in (F, h, g, self._cost)])
        if name == 'exact':
            return self._function(name, [by_z(by_z(self._cost).T)])
        if name == 'gauss_newton':
            R = by_z(R)
            return self._function(name, [by_z(by_z(casadi.sum1(L)).T), R.T @ R])
        column = casadi.vertcat(F, h, g)
        w = type(self._symbols['x']).sym('w', column.shape[0])
        return self._function(name, [by_z(by_z(casadi.dot(w, column)).T)], w)

    def _by_z(self, column: Any) -> Any:
        jacobian = self._casadi.jacobian
        return self._casadi.horzcat(*(jacobian(column, self._symbols[name]) for name in 'xu'))

    def _function(self, name: str, outputs: list[Any], *more: Any) -> Any:
        dense = [self._casadi.densify(output) for output in outputs]
        try:
            return self._casadi.Function(name, [*self._symbols.values(), *more], dense)
        except RuntimeError as error:
            raise ProblemError(f'{name}: found a symbol other than x, u and p: {error}') from error


class CasadiProblem(StageProblem):
    """A problem from CasADi expressions."""

    def __init__(
        self,
        size: Dimensions,
        start: Array,
        expressions: _Expressions,
        target: Array,
        bounds: tuple[Array, Array],
        p_values: Array,
        applies: BoolArray,
    ) -> None:
        super().__init__(size, start, target, bounds)
        self._expressions, self._p, self._applies = expressions, p_values, applies
        self._roll_out = expressions.made('step').mapaccum(size.horizon)
        self._mapped: dict[str, Any] = {}

    def updated(
        self,
        *,
        x0: ArrayLike | None = None,
        target: ArrayLike | None = None,
        p_values: ArrayLike | None = None,
    ) -> Self:
        """As `StageProblem.updated`, or with other data ``p_values``."""
        other = super().updated(x0=x0, target=target)
        if p_values is not None:
            vars(other)['_p'] = _values(p_values, self._p.shape)
        return other

    def predict(self, U: Array) -> Array:
        """States along controls."""
        ahead = self._roll_out(self._start, U[:-1].T, self._p[:-1].T).full()
        return np.vstack([self._start, ahead.T])

    def next_states(self, X: Array, U: Array) -> Array:
        """Dynamics of each stage."""
        return self._over_horizon('step', X, U)[0][:-1, :, 0]

    def evaluate(self, X: Array, U: Array) -> Evaluation:
        """Cost, terminal error and path constraints."""
        cost, h, g = self._over_horizon('value', X, U)
        g = np.where(self._applies, g[:, :, 0], -np.inf)
        return Evaluation(float(cost.sum()), h[-1, :, 0] - self.target, g)

    def _derivatives(self, X: Array, U: Array, hessian: Hessian) -> tuple[Array, ...]:
        F_Z, h_Z, g_Z, L_Z = self._over_horizon('first', X, U)
        if hessian == 'gauss_newton':
            of_L, of_residuals = self._over_horizon('gauss_newton', X, U)
            L_ZZ = nearest_positive_semidefinite(of_L) + of_residuals
        else:
            (L_ZZ,) = self._over_horizon('exact', X, U)
        return F_Z, L_Z[:, 0], L_ZZ, h_Z[-1], g_Z

    def _curvature(
        self, X: Array, U: Array, costates: Array, terminal: Array, path: Array
    ) -> Array:
        n, N = self.size.state, self.size.horizon
        weights = np.zeros((N + 1, n + self.size.output + self.size.path))
        weights[:N, :n] = costates
        weights[N, n : n + self.size.output] = terminal
        weights[:, n + self.size.output :] = path
        return self._over_horizon('curvature', X, U, weights)[0]

    def _over_horizon(self, name: str, X: Array, U: Array, *more: Array) -> list[Array]:
        """Outputs of a function at all stages, each of shape ``(N + 1, rows, columns)``.

        One call of a mapped function: several times faster than a call a stage, most of which is
        conversion.
        """
        stages = self.size.horizon + 1
        if name not in self._mapped:
            self._mapped[name] = self._expressions.made(name).map(stages)
        outputs = self._mapped[name].call([X.T, U.T, self._p.T, *(each.T for each in more)])
        return [
            output.full().reshape(output.shape[0], stages, output.shape[1] // stages).swapaxes(0, 1)
            for output in outputs
        ]
