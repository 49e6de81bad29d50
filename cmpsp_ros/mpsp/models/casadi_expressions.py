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
        - ``gauss_newton``: likewise, but those of ``L`` and, of Gauss and Newton, the residuals'.
        - ``curvature``: the Hessian of ``F``, ``h`` and ``g``, weighted with ``w``, times ``v``.
        """
        casadi, n, z = self._casadi, self.sizes[0], self._z
        F, L, R, h, g = self._stage
        cost, more = L + 0.5 * casadi.sumsqr(R), []
        matrices: list[Any] = []
        if name == 'value':
            vectors = [cost, h, g, F]
        elif name == 'curvature':
            column = casadi.vertcat(F, h, g)
            more = [type(z).sym('w', column.shape[0]), type(z).sym('v', z.shape[0])]
            gradient = casadi.gradient(casadi.dot(more[0], column), z)
            vectors = [casadi.jtimes(gradient, z, more[1])]
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
                of_L = casadi.jacobian(casadi.gradient(L, z), z)
                matrices += [of_L, R_Z.T @ R_Z]
        outputs = [self._dense(each) for each in (*vectors, *(matrix.T for matrix in matrices))]
        function = casadi.Function(name, [z, self._data, *more], outputs)
        shapes = [each.shape[:1] for each in vectors] + [each.shape for each in matrices]
        run = self._compiled(function, stages)
        return lambda *inputs: [
            found.reshape(len(inputs[0]), *shape)
            for found, shape in zip(run(*inputs), shapes, strict=True)
        ]

    def _compiled(self, function: Any, stages: int) -> Callable[..., list[Array]]:
        """A function of all stages, by CasADi itself where there is no machine code."""
        try:
            return StageCode(function, 1 if stages < _FEW else _FEW)
        except NotImplementedError:
            mapped = function.map(stages)
        return lambda *inputs: [
            np.ascontiguousarray(each.full().T) for each in mapped.call([x.T for x in inputs])
        ]

    def _dense(self, expression: Any) -> Any:
        return self._casadi.densify(expression)
