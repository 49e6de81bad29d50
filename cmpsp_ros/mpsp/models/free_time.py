"""A final time that is free, for compiled problems.

As in `from_functions`, it is a state, and its change from the guess a control of stage 0, so
``S_N`` has its sensitivity. The problem's functions read it from the state, at any stage.
"""

from typing import Any, Final, NamedTuple

from cmpsp_ros.arrays import Array
from cmpsp_ros.mpsp.jit.compiled import allocation_free, call, call_for_float
from cmpsp_ros.mpsp.qp.active_set.state import Indices
from cmpsp_ros.mpsp.qp.riccati.program import Records
from cmpsp_ros.mpsp.sqp.driver import Functions


class FreeTimeData(NamedTuple):
    """Data of a compiled problem whose final time is free."""

    inner: object  # data of the problem with this time among its states
    steps: int  # ``N``
    # Final time of the guess; bounds on the control are the least and largest less this.
    guess: float
    state: int  # index of the time among the states, which only this wrapper fills
    control: int  # index of its change among the controls, likewise
    functions: Indices | None = None  # `Functions.addresses` of the problem


@allocation_free
def _predict(data: Any, U: Array, X: Array) -> None:
    for k in range(data.steps + 1):
        X[k, data.state] = data.guess + U[0, data.control]
    call(data.functions[0], (data.inner, U, X))
    X[0, data.state] = data.guess


@allocation_free
def _evaluate(data: Any, X: Array, U: Array, output_error: Array, g: Array) -> float:
    X[0, data.state] = data.guess + U[0, data.control]
    cost: float = call_for_float(data.functions[1], (data.inner, X, U, output_error, g))
    X[0, data.state] = data.guess
    return cost


@allocation_free
def _linearise(
    data: Any, X: Array, U: Array, stages: Records, path: Records, terminal: Records
) -> None:
    n, r, first = data.state, data.control, stages[0]
    X[0, n] = data.guess + U[0, r]
    call(data.functions[2], (data.inner, X, U, stages, path, terminal))
    X[0, n] = data.guess
    for k in range(data.steps + 1):
        stages[k].A[n, n] = 1.0
        stages[k].L_UU[r, r] = 1.0 if k else first.L_XX[n, n]
    for i in range(X.shape[1]):
        first.B[i, r] = first.A[i, n]
    first.L_U[r] = first.L_X[n]
    for a in range(U.shape[1]):
        if a != r:
            first.L_UU[a, r] = first.L_UU[r, a] = first.L_UX[a, n]
    for j in range(path.shape[1]):
        path[0, j].U[r] = path[0, j].X[n]


# A compiled problem with a free final time, for `FreeTimeData`.
FREE_TIME: Final = Functions(_predict, _evaluate, _linearise)
