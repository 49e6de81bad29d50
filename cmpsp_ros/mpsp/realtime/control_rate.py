"""A cost on the change of the control from one stage to the next, for any compiled problem."""

from __future__ import annotations

from typing import Any, NamedTuple

from cmpsp_ros.mpsp.jit.compiled import implements
from cmpsp_ros.mpsp.problem import Array
from cmpsp_ros.mpsp.realtime import functions
from cmpsp_ros.mpsp.riccati.stage_qp import StageQP


class ControlRateData(NamedTuple):
    """Adds ``w/2 sum |U_k - U_(k-1)|^2``; see `cmpsp_ros.mpsp.control_rate.ControlRateProblem`.

    The control before it joins the state of each stage, as its last ``r`` components.

    Attributes:
        inner: The problem without the cost.
        weight: ``w``.
        previous: Control held before the horizon begins, shape ``(r,)``.
    """

    inner: Any
    weight: float
    previous: Array


@implements(functions.predict, ControlRateData)
def predict(data: ControlRateData, U: Array, X: Array) -> None:
    """States of the inner problem, each beside the control before it."""
    functions.predict(data.inner, U, X)
    r = U.shape[1]
    n = X.shape[1] - r
    for k in range(U.shape[0]):
        for a in range(r):
            X[k, n + a] = U[k - 1, a] if k else data.previous[a]


@implements(functions.evaluate, ControlRateData)
def evaluate(data: ControlRateData, X: Array, U: Array, output_error: Array, g: Array) -> float:
    """Value of the inner problem and the cost of its changes of control."""
    cost = functions.evaluate(data.inner, X, U, output_error, g)
    r = U.shape[1]
    n = X.shape[1] - r
    total = 0.0
    for k in range(U.shape[0]):
        for a in range(r):
            change = U[k, a] - X[k, n + a]
            total += change * change
    return cost + 0.5 * data.weight * total


@implements(functions.linearise, ControlRateData)
def linearise(data: ControlRateData, X: Array, U: Array, qp: StageQP) -> None:
    """Derivatives of the inner problem, with those of the added cost and state."""
    functions.linearise(data.inner, X, U, qp)
    r = U.shape[1]
    n = X.shape[1] - r
    for k in range(U.shape[0]):
        for a in range(r):
            pull = data.weight * (U[k, a] - X[k, n + a])
            qp.L_X[k, n + a] = -pull
            qp.L_U[k, a] += pull
            qp.L_XX[k, n + a, n + a] = data.weight
            qp.L_UX[k, a, n + a] = -data.weight
            qp.L_UU[k, a, a] += data.weight
            if k < qp.A.shape[0]:
                qp.B[k, n + a, a] = 1.0
