"""An optimal control problem from CasADi expressions, differentiated by CasADi."""

from __future__ import annotations

from copy import copy
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from numpy.typing import ArrayLike

from cmpsp_ros.arrays import Array, BoolArray
from cmpsp_ros.mpsp.arguments import (
    ProblemError,
    control_bounds,
    free_final_time,
    numbers,
    terminal_target,
    vector,
    whole_number,
)
from cmpsp_ros.mpsp.models.casadi_expressions import Expressions
from cmpsp_ros.mpsp.models.functions import StageProblem
from cmpsp_ros.mpsp.problem import Dimensions, Evaluation, Hessian, Linearisation
from cmpsp_ros.mpsp.qp.curvature import nearest_positive_semidefinite, project_stages

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
    final_time: ArrayLike | None = None,
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
        T: Symbol of a final time that is free; ``F``, ``L``, ``residuals``, ``h`` and ``g`` may
            depend on it, as on a step of length ``T / N``. None where it is fixed. A column of
            ``q`` are those of as many phases; ``p`` says to which of them a stage belongs.
        final_time: Least, guessed and largest final time, or a row of them for each phase. It
            becomes the last state, and its change from the guess the last control, which is free
            at stage 0 and 0 later: controls ``(N + 1, r + q)``.

    Returns:
        The problem. Its first linearisation raises `ProblemError` where a derivative is not finite.

    Raises:
        ImportError: CasADi is not installed.
        ProblemError: Names the argument, with the value found and the one wanted.
    """
    casadi = _casadi()
    if T is not None:
        shape = whole_number('horizon', horizon) + 1, u.shape[0]
        bounds, q, old = control_bounds(lower, upper, shape), T.shape[0], [x, u, T]
        x0, lower, upper = free_final_time(final_time, x0, *bounds, q)
        x, u = (type(each).sym(name, each.shape[0] + q) for name, each in {'x': x, 'u': u}.items())
        ahead = x[-q:] + u[-q:]
        new = [x[:-q], u[:-q], ahead]
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
    expressions = Expressions(casadi, symbols, columns)

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


class CasadiProblem(StageProblem):
    """A problem from CasADi expressions."""

    def __init__(
        self,
        size: Dimensions,
        start: Array,
        expressions: Expressions,
        target: Array,
        bounds: tuple[Array, Array],
        p_values: Array,
        applies: BoolArray,
    ) -> None:
        super().__init__(size, start, target, bounds)
        self._expressions, self._applies = expressions, applies
        self._all_apply = bool(applies.all())
        units = np.ones((len(p_values), sum(expressions.sizes)))
        self._data = np.hstack([p_values, units])
        self._roll_out = expressions.roll_out(size.horizon)
        self._evaluators: dict[str, Any] = {}

    @property
    def p_values(self) -> Array:
        """Data of the stages, shape ``(N + 1, size of p)``."""
        return self._data[:, : self._data.shape[1] - sum(self._expressions.sizes)].copy()

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
            count = self.p_values.shape[1]
            vars(other)['_data'] = self._data.copy()
            vars(other)['_data'][:, :count] = _values(p_values, (len(self._data), count))
        return other

    def in_units(
        self, state: Array, control: Array, output: Array, path: Array, cost: float
    ) -> Self:
        """The same problem in other units, which its functions work in."""
        other, units = copy(self), np.concatenate([state, control, output, path, [cost]])
        other.control_lower = self.control_lower / control
        other.control_upper = self.control_upper / control
        other.target = self.target / output
        data = self._data.copy()
        data[:, -len(units) :] = units
        vars(other).update(_start=self._start / state, _data=data)
        return other

    def predict(self, U: Array) -> Array:
        """States along controls."""
        return self._roll_out(self._start, U[:-1], self._data[:-1])

    def next_states(self, X: Array, U: Array) -> Array:
        """Dynamics of each stage."""
        ahead: Array = self._evaluated('value', X, U)[3][:-1]
        return ahead

    def evaluate(self, X: Array, U: Array) -> Evaluation:
        """Cost, terminal error and path constraints."""
        return self._evaluation(*self._evaluated('value', X, U)[:3])

    def evaluate_with_next(self, X: Array, U: Array) -> tuple[Evaluation, Array]:
        """Both at once."""
        *value, ahead = self._evaluated('value', X, U)
        return self._evaluation(*value), ahead[:-1]

    def _evaluation(self, cost: Array, h: Array, g: Array) -> Evaluation:
        if not self._all_apply:
            g[~self._applies] = -np.inf
        return Evaluation(float(cost.sum()), h[-1] - self.target, g)

    def _linearised(self, X: Array, U: Array, hessian: Hessian) -> Linearisation:
        name = 'gauss_newton' if hessian == 'gauss_newton' else 'exact'
        h, g, L_X, L_U, A, B, h_X, h_U, g_X, g_U, *second = self._evaluated(name, X, U)
        blocks, (of_L, *others) = tuple(second), second
        if len(others) == 1:
            blocks = self._blocks(nearest_positive_semidefinite(of_L) + others[0])
        if hessian == 'projected':
            blocks = project_stages(*blocks)
        if not self._all_apply:
            g[~self._applies] = -np.inf
            g_X[~self._applies], g_U[~self._applies] = 0.0, 0.0
        L_XX, L_UX, L_UU = (np.ascontiguousarray(block) for block in blocks)
        return Linearisation(
            A[:-1], B[:-1], L_X, L_U, L_XX, L_UX, L_UU,
            h[-1] - self.target, h_X[-1], h_U[-1], g, g_X, g_U,
        )  # fmt: skip

    def _curvature(
        self, X: Array, U: Array, costates: Array, terminal: Array, path: Array
    ) -> Array:
        n, N = self.size.state, self.size.horizon
        weights = np.zeros((N + 1, n + self.size.output + self.size.path))
        weights[:N, :n] = costates
        weights[N, n : n + self.size.output] = terminal
        weights[:, n + self.size.output :] = path
        return self._evaluated('curvature', X, U, weights)[0]

    def _evaluated(self, name: str, *inputs: Array) -> list[Array]:
        """Outputs of an evaluator, which is made at its first use, of ``X``, ``U`` and more."""
        if name not in self._evaluators:
            self._evaluators[name] = self._expressions.evaluator(name, len(inputs[0]))
        X, U, *more = inputs
        found: list[Array] = self._evaluators[name](X, U, self._data, *more)
        return found
