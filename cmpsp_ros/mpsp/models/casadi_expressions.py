"""Functions of one stage made from CasADi expressions, and evaluated at all stages at once."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from cmpsp_ros.arrays import Array
from cmpsp_ros.mpsp.arguments import ProblemError
from cmpsp_ros.mpsp.jit import StageCode

if TYPE_CHECKING:
    from types import ModuleType

_FEW = 4
_ROUNDING = 1e-14


class Expressions:
    """Functions of one stage, of ``z = (x, u)`` and ``data``: ``p`` and then units.

    The units are of ``x``, ``u``, ``h``, ``g`` and the cost; values and arguments are in them. MX
    becomes SX where it can.
    """

    def __init__(
        self, casadi: ModuleType, symbols: dict[str, Any], columns: dict[str, Any]
    ) -> None:
        """Take the symbols ``x, u, p`` and the columns ``F, L, residuals, h, g``, in this order.

        Raises:
            ProblemError: An expression has another symbol.
        """
        self._casadi = casadi
        given = self._function('given', symbols, columns)
        kind = type(symbols['x'])
        with suppress(RuntimeError):
            given, kind = given.expand(), casadi.SX
        n, r, p = (each.shape[0] for each in symbols.values())
        self.sizes = n, r, columns['h'].shape[0], columns['g'].shape[0], 1
        self._z, self._data = kind.sym('z', n + r), kind.sym('data', p + sum(self.sizes))
        self._xu = kind.sym('x', n), kind.sym('u', r)
        self._stage = self._in_units(given, self._z[:n], self._z[n:])
        self._next = self._in_units(given, *self._xu)[0]

    def _function(self, name: str, symbols: dict[str, Any], columns: dict[str, Any]) -> Any:
        for each, column in columns.items():
            try:
                self._casadi.Function(each, [*symbols.values()], [column])
            except RuntimeError as error:
                message = f'{each}: found a symbol other than x, u and p: {error}'
                raise ProblemError(message) from error
        return self._casadi.Function(name, [*symbols.values()], [*columns.values()])

    def _in_units(self, given: Any, x: Any, u: Any) -> tuple[Any, ...]:
        """``F``, ``L``, ``residuals``, ``h`` and ``g``."""
        casadi = self._casadi
        p = self._data.shape[0] - sum(self.sizes)
        ends = np.cumsum([0, p, *self.sizes]).tolist()
        p, X, U, Y, G, J = (self._data[a:b] for a, b in pairwise(ends))
        F, L, R, h, g = given.call([x * X, u * U, p])
        return F / X, casadi.sum1(L) / J, R / casadi.sqrt(J), h / Y, g / G

    def roll_out(self, horizon: int) -> Callable[[Array, Array, Array], Array]:
        """States ``(N + 1, n)`` from the first one, controls ``(N, r)`` and data."""
        step = self._casadi.Function('step', [*self._xu, self._data], [self._dense(self._next)])
        try:
            return StageCode(step, 1).roll_out
        except NotImplementedError:
            whole = step.mapaccum(horizon)
        return lambda start, U, data: np.vstack([start, whole(start, U.T, data.T).full().T])

    def evaluator(self, name: str, stages: int) -> Callable[..., list[Array]]:
        """A function by its name, from and to arrays whose first axis is the stage.

        - ``value``: cost, ``h``, ``g`` and ``F``.
        - ``exact``: ``h`` and ``g``; then, by ``x`` and by ``u``, the cost, ``F``, ``h`` and ``g``;
          then the cost's second derivatives.
        - ``gauss_newton``: likewise, with those of Gauss and Newton for the residuals; those of
          ``L`` and of the residuals by themselves unless the former are known to be convex.
        - ``curvature``: the Hessian of ``F``, ``h`` and ``g``, weighted with ``w``.
        """
        casadi, n, z = self._casadi, self.sizes[0], self._z
        F, L, R, h, g = self._stage
        cost, more = L + 0.5 * casadi.sumsqr(R), []
        matrices: list[Any] = []
        if name == 'value':
            vectors = [cost, h, g, F]
        elif name == 'curvature':
            column, vectors = casadi.vertcat(F, h, g), []
            more = [type(z).sym('w', column.shape[0])]
            matrices = [casadi.hessian(casadi.dot(*more, column), z)[0]]
        else:
            gradient = casadi.gradient(cost, z)
            vectors = [h, g, gradient[:n], gradient[n:]]
            slopes = (casadi.jacobian(each, z) for each in (F, h, g))
            matrices = [part for slope in slopes for part in (slope[:, :n], slope[:, n:])]
            if name == 'exact':
                second = casadi.jacobian(gradient, z)
                matrices += [second[:n, :n], second[n:, :n], second[n:, n:]]
            else:
                R_Z = casadi.jacobian(R, z)
                of_L, of_R = casadi.jacobian(casadi.gradient(L, z), z), R_Z.T @ R_Z
                if self._is_convex(of_L):
                    second = of_L + of_R
                    matrices += [second[:n, :n], second[n:, :n], second[n:, n:]]
                else:
                    matrices += [of_L, of_R]
        outputs = [self._dense(each) for each in (*vectors, *(matrix.T for matrix in matrices))]
        whole = casadi.Function(name, [z, self._data, *more], outputs)
        inputs = [*self._xu, self._data, *more]
        function = casadi.Function(
            name, inputs, whole.call([casadi.vertcat(*self._xu), *inputs[2:]])
        )
        shapes = [each.shape[:1] for each in vectors] + [each.shape for each in matrices]
        try:
            return StageCode(function, 1 if stages < _FEW else _FEW, shapes)
        except NotImplementedError:
            mapped = function.map(stages)
        return lambda *arrays: [
            np.ascontiguousarray(found.full().T).reshape(stages, *shape)
            for found, shape in zip(mapped.call([each.T for each in arrays]), shapes, strict=True)
        ]

    def _is_convex(self, second: Any) -> bool:
        """True for a constant that is positive semi-definite in one choice of units: in all."""
        found = self._casadi.Function('second', [self._z, self._data], [second])
        data = found.jac_sparsity(0, 1).get_triplet()[1]
        first_unit = self._data.shape[0] - sum(self.sizes)
        if found.jac_sparsity(0, 0).nnz() or min(data, default=first_unit) < first_unit:
            return False
        values = np.linalg.eigvalsh(found(0.0, 1.0).full())
        return bool(values[0] >= -_ROUNDING * values[-1])

    def _dense(self, expression: Any) -> Any:
        return self._casadi.densify(expression)
