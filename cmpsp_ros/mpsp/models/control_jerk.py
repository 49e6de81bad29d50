"""A limit on the second difference of the control, for a problem inside `CONTROL_RATE`.

The control two stages before joins the state, too: it comes before the last ``r`` components of
``X_k``, which are the previous control.
"""

from __future__ import annotations

from typing import Any, Final, NamedTuple

from cmpsp_ros.arrays import Array
from cmpsp_ros.mpsp.jit.compiled import allocation_free, call, call_for_float
from cmpsp_ros.mpsp.qp.active_set.state import Indices
from cmpsp_ros.mpsp.qp.riccati.program import Records
from cmpsp_ros.mpsp.sqp.driver import Functions


class ControlJerkData(NamedTuple):
    """Data of a compiled problem with a limit on ``U_k - 2 U_(k-1) + U_(k-2)``."""

    inner: object  # data of the problem without it
    steps: int  # ``N``
    before: Array  # the two controls held before the horizon begins, the earlier first, ``(2, r)``
    # Limit of each row of `rows` at the stages ``0 ... N - 1``.
    largest: float
    rows: Array  # limited linear functions of the control, shape ``(q, r)``
    # The same at the stage ``N``, as if the robot were at rest there; infinite for none.
    last: float
    first: int  # index of the first of its ``2 q`` path constraints of a stage
    functions: Indices | None = None  # `Functions.addresses` of the problem without it


@allocation_free
def _predict(data: Any, U: Array, X: Array) -> None:
    call(data.functions[0], (data.inner, U, X))
    r = U.shape[1]
    n = X.shape[1] - 2 * r
    for k in range(data.steps + 1):
        for a in range(r):
            X[k, n + a] = U[k - 2, a] if k > 1 else data.before[k, a]


@allocation_free
def _evaluate(data: Any, X: Array, U: Array, output_error: Array, g: Array) -> float:
    cost: float = call_for_float(data.functions[1], (data.inner, X, U, output_error, g))
    for k in range(data.steps + 1):
        for i in range(data.rows.shape[0]):
            found = _second_difference(data, i, U, X, k)
            largest = data.largest if k < data.steps else data.last
            g[k, data.first + 2 * i] = found - largest
            g[k, data.first + 2 * i + 1] = -found - largest
    return cost


@allocation_free
def _linearise(
    data: Any, X: Array, U: Array, stages: Records, path: Records, terminal: Records
) -> None:
    call(data.functions[2], (data.inner, X, U, stages, path, terminal))
    r = U.shape[1]
    n = X.shape[1] - 2 * r
    for k in range(data.steps + 1):
        for a in range(r):
            stages[k].A[n + a, n + r + a] = 1.0
        for i in range(data.rows.shape[0]):
            found = _second_difference(data, i, U, X, k)
            largest = data.largest if k < data.steps else data.last
            for side in range(2):
                row, sign = path[k, data.first + 2 * i + side], 1.0 - 2.0 * side
                row.value = sign * found - largest
                for a in range(r):
                    factor = sign * data.rows[i, a]
                    row.U[a] = factor if k < data.steps else 0.0
                    row.X[n + r + a], row.X[n + a] = -2.0 * factor, factor


@allocation_free
def _second_difference(data: Any, i: int, U: Array, X: Array, k: int) -> float:
    found, r = 0.0, U.shape[1]
    n = X.shape[1] - 2 * r
    for a in range(r):
        now = U[k, a] if k < data.steps else 0.0
        found += data.rows[i, a] * (now - 2.0 * X[k, n + r + a] + X[k, n + a])
    return found


# A compiled problem with that limit, for `ControlJerkData`, as the inner one of `CONTROL_RATE`.
#
# The problem's own functions leave the path constraints of the limit alone.
CONTROL_JERK: Final = Functions(_predict, _evaluate, _linearise)
