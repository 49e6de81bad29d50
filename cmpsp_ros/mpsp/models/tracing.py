"""Numpy functions of a stage as CasADi expressions, from their operations on numbers that record.

A tape has the operations of a function at one stage. Stages whose tapes differ in constants alone
share an expression, and constants that vary are data of the stage; others are chosen by data.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final

import numpy as np

from cmpsp_ros.arrays import Array, BoolArray
from cmpsp_ros.mpsp.models.casadi_functions import CasadiProblem, from_casadi
from cmpsp_ros.mpsp.models.derivatives import StageFunction
from cmpsp_ros.mpsp.problem import OptimalControlProblem

_UNARY: Final = (
    'sin', 'cos', 'tan', 'arcsin', 'arccos', 'arctan', 'sinh', 'cosh', 'tanh', 'arcsinh', 'arccosh',
    'arctanh', 'exp', 'log', 'log10', 'log1p', 'expm1', 'sqrt',
)  # fmt: skip
_BINARY: Final[dict[str, Callable[[Any, Any], Any]]] = {
    'add': lambda a, b: a + b,
    'sub': lambda a, b: a - b,
    'mul': lambda a, b: a * b,
    'truediv': lambda a, b: a / b,
    'pow': lambda a, b: a**b,
}
_COMPARISONS: Final = ('eq', 'ne', 'lt', 'le', 'gt', 'ge', 'bool')
# Tapes of one function that are chosen from, and operations on one of them.
_MOST, _LONGEST = 4, 5000


class Tape:
    """Operations ``(name, operands)`` in their order, and the constants among them."""

    def __init__(self) -> None:
        self.nodes: list[tuple[str, int, int]] = []
        self.constants: list[float] = []

    def add(self, name: str, a: int, b: int = -1) -> Number:
        """The result of an operation on earlier nodes."""
        if len(self.nodes) == _LONGEST:
            raise TypeError(f'more than {_LONGEST} operations')
        self.nodes.append((name, a, b))
        return Number(self, len(self.nodes) - 1)

    def node(self, value: Any) -> int:
        """Number of the node that has a value; a constant, unless it was recorded."""
        if not isinstance(value, Number):
            self.constants.append(float(value))
            value = self.add('constant', len(self.constants) - 1)
        return int(value.node)

    def play(self, casadi: Any, z: Any, constants: Any) -> list[Any]:
        """All nodes as expressions of ``z = (x, u)``."""
        found: list[Any] = []
        for name, a, b in self.nodes:
            if name in {'input', 'constant'}:
                found.append((z if name == 'input' else constants)[a])
            elif name in _BINARY:
                found.append(_BINARY[name](found[a], found[b]))
            else:
                found.append(getattr(casadi, name)(*(found[i] for i in (a, b) if i >= 0)))
        return found


class Number:
    """A number that records operations on it; it has no value, so comparing it raises TypeError."""

    def __init__(self, tape: Tape, node: int) -> None:
        self.tape, self.node = tape, node

    def __neg__(self) -> Number:
        return self.tape.add('mul', self.node, self.tape.node(-1.0))

    def __pos__(self) -> Number:
        return self


def _binary(name: str, *, swapped: bool) -> Callable[[Number, Any], Any]:
    def operation(self: Number, other: Any) -> Any:
        if isinstance(other, np.ndarray):
            return NotImplemented
        pair = self.node, self.tape.node(other)
        return self.tape.add(name, *(pair[::-1] if swapped else pair))

    return operation


def _unary(name: str) -> Callable[[Number], Number]:
    return lambda self: self.tape.add(name, self.node)


def _no_value(self: Number, *_: Any) -> bool:
    raise TypeError(f'{self!r} has no value')


for _name in _BINARY:
    setattr(Number, f'__{_name}__', _binary(_name, swapped=False))
    setattr(Number, f'__r{_name}__', _binary(_name, swapped=True))
for _name in ('arctan2', 'hypot'):
    setattr(Number, _name, _binary(_name, swapped=False))
for _name in _UNARY:
    setattr(Number, _name, _unary(_name))
for _name in _COMPARISONS:
    setattr(Number, f'__{_name}__', _no_value)
setattr(Number, '__abs__', _unary('fabs'))  # noqa: B010 (as the others)


class _Stage:
    """A function's operations at a stage; outputs that do not apply (``-inf``) have none."""

    def __init__(self, function: StageFunction, k: int, sizes: tuple[int, int]) -> None:
        self.tape = tape = Tape()
        z = np.array([tape.add('input', i) for i in range(sum(sizes))], dtype=object)
        x, u = z[: sizes[0]].copy(), z[sizes[0] :].copy()
        value = np.asarray(function.function(k, x, u), dtype=object)
        if value.shape != function.shape:
            raise TypeError(f'shape {value.shape}')
        self.outputs = tuple(
            -1 if not isinstance(each, Number) and float(each) == -np.inf else tape.node(each)
            for each in value.ravel()
        )
        self.structure = (*tape.nodes, self.outputs)


class TracedFunction:
    """A function of one stage at all of its stages."""

    applies: BoolArray  # components that are not ``-inf``, shape ``(stages, length)``
    data: Array  # constants that vary with the stage, and then choices, shape ``(stages, any)``

    def __init__(self, function: StageFunction, stages: list[int], sizes: tuple[int, int]) -> None:
        """Trace a function of ``n`` states and ``r`` controls.

        Raises:
            TypeError: It does more than arithmetic, or differs too much from stage to stage.
        """
        tapes = {k: _Stage(function, k, sizes) for k in dict.fromkeys(stages)}
        traced = [tapes[k] for k in stages]
        self._kinds = list(dict.fromkeys(each.structure for each in traced))
        if len(self._kinds) > _MOST:
            raise TypeError('too many kinds of stages')
        kind = np.array([self._kinds.index(each.structure) for each in traced])
        self.applies = np.array([[node >= 0 for node in each.outputs] for each in traced])
        self._stages = [int(np.argmax(kind == i)) for i in range(len(self._kinds))]
        self._first = [traced[k] for k in self._stages]
        self._varying, columns = [], []
        for i, first in enumerate(self._first):
            values = np.tile(np.array(first.tape.constants), (len(traced), 1))
            for k in np.flatnonzero(kind == i).tolist():
                values[k] = traced[k].tape.constants
            self._varying.append(np.flatnonzero((values != values[0]).any(axis=0)))
            columns.append(values[:, self._varying[-1]])
        chosen = (kind[:, None] == np.arange(len(self._kinds))).astype(float)
        self.data = np.hstack([*columns, chosen])

    def finite_at(self, function: StageFunction, probes: list[Array]) -> Array:
        """The last probe at which each tape is finite."""
        for Z in probes[::-1]:
            values = [function(k, Z).ravel()[self.applies[k]] for k in self._stages]
            if np.isfinite(np.concatenate(values)).all():
                return Z
        raise TypeError('not finite')

    def expression(self, casadi: Any, z: Any, data: Any, at: Array) -> Any:
        """Column of ``z`` and the stage's data; tapes that are not chosen are evaluated at `at`."""
        total, first, kinds = 0, 0, len(self._kinds)
        for i, (stage, varying) in enumerate(zip(self._first, self._varying, strict=True)):
            constants: list[Any] = [*stage.tape.constants]
            for j in varying.tolist():
                constants[j], first = data[first], first + 1
            is_chosen = data[data.shape[0] - kinds + i]
            here = z if kinds == 1 else at + casadi.if_else(is_chosen, z - at, 0)
            nodes = stage.tape.play(casadi, here, constants)
            column = casadi.vertcat(*(nodes[j] if j >= 0 else 0 for j in stage.outputs))
            total += column if kinds == 1 else casadi.if_else(is_chosen, column, 0)
        return total


def traced_problem(
    problem: OptimalControlProblem,
    functions: dict[str, StageFunction],
    start: Array,
    probes: list[Array],
    fixed: BoolArray,
) -> CasadiProblem | None:
    """The problem of ``F``, ``L``, ``residuals``, ``h`` and ``g`` from expressions of CasADi.

    `probes` are points ``Z_k``; `fixed` path constraints do not apply at stage 0. None where CasADi
    is not installed, a function cannot be traced, or values at the probes differ.
    """
    try:
        import casadi  # noqa: PLC0415 (an optional extra)
    except ImportError:
        return None
    N, sizes = problem.size.horizon, (problem.size.state, problem.size.control)
    stages, every = {'F': [*range(N), N - 1], 'h': [N] * (N + 1)}, list(range(N + 1))
    x, u = (casadi.SX.sym(name, length) for name, length in zip('xu', sizes, strict=True))
    parameters, values, applies, expressions = [], [], None, {}
    try:
        for name, function in functions.items():
            found = TracedFunction(function, stages.get(name, every), sizes)
            parameters.append(casadi.SX.sym(name, found.data.shape[1]))
            values.append(found.data)
            z, at = casadi.vertcat(x, u), found.finite_at(function, probes)
            expressions[name] = found.expression(casadi, z, parameters[-1], at)
            if name == 'g':
                applies = found.applies
                applies[0] &= ~fixed
            elif not found.applies.all():
                return None
        traced = from_casadi(
            horizon=N, x0=start, x=x, u=u, p=casadi.vertcat(*parameters),
            p_values=np.hstack(values), target=problem.target if 'h' in functions else None,
            lower=problem.control_lower, upper=problem.control_upper, applies=applies,
            **expressions,
        )  # fmt: skip
        return traced if _agree(problem, traced, np.resize(probes, (N + 1, sum(sizes)))) else None
    # Any error on numbers that have no value means that the function needs their values.
    except Exception:
        return None


def _agree(one: OptimalControlProblem, other: OptimalControlProblem, Z: Array) -> bool:
    """True where two problems have the same values; impure functions have others when traced."""
    X, U = (np.ascontiguousarray(part) for part in np.split(Z, [one.size.state], axis=1))
    found = [each.evaluate_with_next(X, U) for each in (one, other)]
    values = ([ahead, at.cost, at.output_error, at.g] for at, ahead in found)
    return all(np.allclose(a, b, 1e-9, 1e-9, equal_nan=True) for a, b in zip(*values, strict=True))
