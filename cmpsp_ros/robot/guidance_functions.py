"""The demonstrative example (91)-(95) as functions for compiled code, and their data."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cmpsp_ros.mpsp.compiled import allocation_free, implements
from cmpsp_ros.mpsp.realtime import functions
from cmpsp_ros.mpsp.riccati.stage_qp import StageQP
from cmpsp_ros.robot.differential_drive import drive, drive_and_differentiate

Array = NDArray[np.float64]

# The centre line's distance has no second derivative at the road's centre; nearer than this [m]
# its curvature is held.
_LEAST_RADIUS = 1e-3

EDGES = 2
"""Path constraints of the road, outer edge first; the obstacles' follow."""

GAUSS_NEWTON, PROJECTED, EXACT = 0, 1, 2
"""Which Hessian of the cost."""


class GuidanceData(NamedTuple):
    """One robot's problem from where it is.

    Radii are those of one clear space for all stages, or one for each: ``K`` is 1 or ``N + 1``.

    Attributes:
        pose: Present pose, shape ``(3,)`` [m, m, rad].
        goal: Point to pass at the end, shape ``(2,)`` [m].
        durations: Length of every step, shape ``(N,)`` [s].
        centers: Centres of the road and then of the obstacles, shape ``(1 + M, 2)`` [m].
        inner: Least distance from the road's centre, shape ``(K,)`` [m].
        outer: Greatest distance from it, shape ``(K,)`` [m].
        radii: Least distances from the obstacles' centres, shape ``(K, M)`` [m].
        wheel_radius: The paper's ``r`` [m].
        half_track: The paper's ``L`` [m].
        center_radius: ``r_p``, radius of the road's centre line [m].
        road_center: ``q``, on the squared distance to it [1/m^2].
        control_change: ``R``, on the squared change between iterations [s^2/rad^2].
        control_effort: On the squared wheel speeds [s^2/rad^2].
        hessian: `GAUSS_NEWTON`, `PROJECTED` or `EXACT`.
    """

    pose: Array
    goal: Array
    durations: Array
    centers: Array
    inner: Array
    outer: Array
    radii: Array
    wheel_radius: float
    half_track: float
    center_radius: float
    road_center: float
    control_change: float
    control_effort: float
    hessian: int


@implements(functions.predict, GuidanceData)
def predict(data: GuidanceData, U: Array, X: Array) -> None:
    """Exact arcs under zero-order hold; see `functions.predict`."""
    for i in range(3):
        X[0, i] = data.pose[i]
    for k in range(data.durations.shape[0]):
        drive(X, U, k, data.durations[k], data.wheel_radius, data.half_track)


@implements(functions.evaluate, GuidanceData)
def evaluate(data: GuidanceData, X: Array, U: Array, output_error: Array, g: Array) -> float:
    """Value of (95) without its proximal term; see `functions.evaluate`."""
    cost = 0.0
    N = data.durations.shape[0]
    for k in range(N + 1):
        off_center = _constrain(data, X, k, g) - data.center_radius
        cost += data.road_center * off_center * off_center
        cost += data.control_effort * (U[k, 0] * U[k, 0] + U[k, 1] * U[k, 1])
    for i in range(2):
        output_error[i] = X[N, i] - data.goal[i]
    return 0.5 * cost


@implements(functions.linearise, GuidanceData)
def linearise(data: GuidanceData, X: Array, U: Array, qp: StageQP) -> None:
    """Analytic derivatives; see `functions.linearise`.

    The second derivative of ``(r - r_p)^2 / 2`` is ``n n' + (1 - r_p / r) t t'`` with unit
    vectors ``n`` across and ``t`` along the road. Gauss-Newton leaves the second term out. It
    is negative wherever ``r < r_p``, and there 0 in the projection.
    """
    N = data.durations.shape[0]
    q = data.road_center
    curvature = data.control_change + data.control_effort
    for k in range(N + 1):
        if k < N:
            duration = data.durations[k]
            drive_and_differentiate(
                qp.A, qp.B, X, U, k, duration, data.wheel_radius, data.half_track
            )
        distance = _constrain(data, X, k, qp.g)
        off_center = distance - data.center_radius
        x, y = _away(data, X, k, 0, distance)
        along = 0.0
        if data.hessian != GAUSS_NEWTON:
            along = off_center / max(distance, _LEAST_RADIUS)
            if data.hessian == PROJECTED:
                along = max(along, 0.0)
        qp.L_X[k, 0] = q * off_center * x
        qp.L_X[k, 1] = q * off_center * y
        qp.L_XX[k, 0, 0] = q * (x * x + along * y * y)
        qp.L_XX[k, 0, 1] = q * (x * y - along * x * y)
        qp.L_XX[k, 1, 0] = qp.L_XX[k, 0, 1]
        qp.L_XX[k, 1, 1] = q * (y * y + along * x * x)
        for a in range(2):
            qp.L_U[k, a] = data.control_effort * U[k, a]
            for b in range(2):
                qp.L_UU[k, a, b] = curvature if a == b else 0.0
        qp.g_X[k, 0, 0] = x
        qp.g_X[k, 0, 1] = y
        qp.g_X[k, 1, 0] = -x
        qp.g_X[k, 1, 1] = -y
        for j in range(1, data.centers.shape[0]):
            x, y = _away(data, X, k, j, _distance(data, X, k, j))
            qp.g_X[k, EDGES - 1 + j, 0] = -x
            qp.g_X[k, EDGES - 1 + j, 1] = -y
    for i in range(2):
        qp.output_error[i] = X[N, i] - data.goal[i]
        qp.h_X[i, i] = 1.0


@allocation_free
def _constrain(data: GuidanceData, X: Array, k: int, g: Array) -> float:
    """Constraints of a stage, not positive where met; returns the distance to the road's centre.

    They are distances, not their squares as in (92) and (93): their linearisation then errs on
    the safe side of every convex obstacle. Where the robot is now it cannot be changed.
    """
    distance = _distance(data, X, k, 0)
    if k == 0:
        for j in range(g.shape[1]):
            g[0, j] = -math.inf
        return distance
    at = min(k, data.inner.shape[0] - 1)
    g[k, 0] = distance - data.outer[at]
    g[k, 1] = data.inner[at] - distance
    for j in range(1, data.centers.shape[0]):
        g[k, EDGES - 1 + j] = data.radii[at, j - 1] - _distance(data, X, k, j)
    return distance


@allocation_free
def _distance(data: GuidanceData, X: Array, k: int, j: int) -> float:
    """Distance of a pose from a centre."""
    dx, dy = X[k, 0] - data.centers[j, 0], X[k, 1] - data.centers[j, 1]
    return math.sqrt(dx * dx + dy * dy)


@allocation_free
def _away(data: GuidanceData, X: Array, k: int, j: int, distance: float) -> Any:
    """Unit vector away from a centre; along x at the centre itself, so that a solver can leave."""
    if distance > 0.0:
        dx, dy = X[k, 0] - data.centers[j, 0], X[k, 1] - data.centers[j, 1]
        return dx / distance, dy / distance
    return 1.0, 0.0
