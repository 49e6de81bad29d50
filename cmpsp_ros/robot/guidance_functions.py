"""The demonstrative example (91)-(95) as functions for compiled code, and their data."""

from __future__ import annotations

import math
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cmpsp_ros.mpsp.jit.compiled import allocation_free, implements, inlined
from cmpsp_ros.mpsp.realtime import functions
from cmpsp_ros.mpsp.riccati.stage_qp import StageQP
from cmpsp_ros.robot import road_functions
from cmpsp_ros.robot.differential_drive import drive, drive_and_differentiate
from cmpsp_ros.robot.shape_functions import away_from

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

EDGES = 2
"""Path constraints of the road, one an edge; the obstacles' follow."""

GAUSS_NEWTON, PROJECTED, EXACT = 0, 1, 2
"""Which Hessian of the cost."""

LINE, POINT, POSE = 1, 2, 3
"""What the end of the horizon is to meet, told by the number of outputs."""

LEVER: Final = 0.02
"""What a radian of heading counts beside a metre of way in the miss of a pose [m]."""


class GuidanceData(NamedTuple):
    """One robot's problem from where it is.

    Corners and radii are those of one clear space for all stages, or one for each: ``K``, for
    either, is 1 or ``N + 1``.

    Attributes:
        pose: Present pose, shape ``(3,)`` [m, m, rad].
        goal: Point to pass at the end, shape ``(2,)`` [m].
        heading: Heading to pass it with, where there are three outputs. Where there is one it is
            the line through the goal across this direction that is to be passed [rad].
        durations: Length of every step, shape ``(N,)`` [s].
        road: Where on the road the robot's centre may be, as `road_functions` has it.
        near: Progress of a place near the pose, not a number where none is known [m].
        corners: Of the obstacles, as `shape_functions` has them, shape ``(K, C, 2)`` [m].
        first: Where the corners of each obstacle begin, shape ``(M + 1,)``.
        radii: Least distances from the obstacles without their radii, ``-inf`` where there is
            nothing to keep to, shape ``(K, M)`` [m].
        wheel_radius: The paper's ``r`` [m].
        half_track: The paper's ``L`` [m].
        road_center: ``q``, on the squared distance to the centre line [1/m^2].
        control_change: ``R``, on the squared change between iterations [s^2/rad^2].
        control_effort: On the squared wheel speeds [s^2/rad^2].
        hessian: `GAUSS_NEWTON`, `PROJECTED` or `EXACT`.
    """

    pose: Array
    goal: Array
    heading: float
    durations: Array
    road: Any
    near: float
    corners: Array
    first: Indices
    radii: Array
    wheel_radius: float
    half_track: float
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
    progress = road_functions.find(data.road, X[0, 0], X[0, 1], X[0, 2], data.near)
    for k in range(N + 1):
        progress, off_center = _keep_on_road(data, X, k, progress, g)
        for j in range(data.radii.shape[1]):
            g[k, EDGES + j], _, _ = _keep_away(data, X, k, j)
        cost += data.road_center * off_center * off_center
        cost += data.control_effort * (U[k, 0] * U[k, 0] + U[k, 1] * U[k, 1])
    _miss(data, X, output_error)
    return 0.5 * cost


@implements(functions.linearise, GuidanceData)
def linearise(data: GuidanceData, X: Array, U: Array, qp: StageQP) -> None:
    """Analytic derivatives; see `functions.linearise`.

    The second derivative of half the squared distance from the centre line is ``n n' + a t t'``
    with unit vectors ``n`` across and ``t`` along the road. Gauss-Newton leaves the second term
    out. Where ``a`` is negative, on the inner side of a curve, it is 0 in the projection.
    """
    N = data.durations.shape[0]
    q = data.road_center
    curvature = data.control_change + data.control_effort
    progress = road_functions.find(data.road, X[0, 0], X[0, 1], X[0, 2], data.near)
    for k in range(N + 1):
        if k < N:
            duration = data.durations[k]
            drive_and_differentiate(
                qp.A, qp.B, X, U, k, duration, data.wheel_radius, data.half_track
            )
        progress, off_center = _keep_on_road(data, X, k, progress, qp.g)
        x, y, along, first_x, first_y, second_x, second_y = road_functions.slopes(
            data.road, X[k, 0], X[k, 1], progress
        )
        if data.hessian == GAUSS_NEWTON:
            along = 0.0
        elif data.hessian == PROJECTED:
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
        qp.g_X[k, 0, 0] = first_x
        qp.g_X[k, 0, 1] = first_y
        qp.g_X[k, 1, 0] = second_x
        qp.g_X[k, 1, 1] = second_y
        for j in range(data.radii.shape[1]):
            qp.g[k, EDGES + j], x, y = _keep_away(data, X, k, j)
            qp.g_X[k, EDGES + j, 0] = -x
            qp.g_X[k, EDGES + j, 1] = -y
    _miss(data, X, qp.output_error)
    outputs = qp.output_error.shape[0]
    if outputs == LINE:
        qp.h_X[0, 0], qp.h_X[0, 1] = math.cos(data.heading), math.sin(data.heading)
    else:
        qp.h_X[0, 0] = qp.h_X[1, 1] = 1.0
    if outputs == POSE:
        qp.h_X[2, 2] = LEVER


@allocation_free
def _miss(data: GuidanceData, X: Array, output_error: Array) -> None:
    """What the last pose is off the goal; a heading by the shorter way round."""
    N, outputs = data.durations.shape[0], output_error.shape[0]
    dx, dy = X[N, 0] - data.goal[0], X[N, 1] - data.goal[1]
    if outputs == LINE:
        output_error[0] = math.cos(data.heading) * dx + math.sin(data.heading) * dy
    else:
        output_error[0], output_error[1] = dx, dy
    if outputs == POSE:
        turn = X[N, 2] - data.heading
        output_error[2] = LEVER * (turn - 2.0 * math.pi * round(turn / (2.0 * math.pi)))


@allocation_free
def _keep_on_road(data: GuidanceData, X: Array, k: int, progress: float, g: Array) -> Any:
    """Constraints (92) of the road's edges, not positive where met.

    Where the robot is now it cannot be changed: none applies there.

    Returns:
        Progress, and what is off the centre [m].
    """
    progress, off_center, first, second = road_functions.measure(
        data.road, k, X[k, 0], X[k, 1], progress
    )
    g[k, 0], g[k, 1] = (first, second) if k > 0 else (-math.inf, -math.inf)
    return progress, off_center


@inlined
def _keep_away(data: GuidanceData, X: Array, k: int, j: int) -> Any:
    """Constraint (93) of an obstacle, not positive where met, and the unit vector away from it.

    It is a distance, not its square: its linearisation then errs on the safe side of every convex
    obstacle.
    """
    at, there = min(k, data.radii.shape[0] - 1), min(k, data.corners.shape[0] - 1)
    distance, x, y = away_from(data.corners, data.first, there, j, X[k, 0], X[k, 1])
    applies = k > 0 and data.radii[at, j] > -math.inf
    return (data.radii[at, j] - distance if applies else -math.inf), x, y
