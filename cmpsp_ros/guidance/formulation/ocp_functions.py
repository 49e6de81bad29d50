"""Demonstrative example (91)-(95) of the paper as compiled functions, and their data.

    minimise   J = 1/2 sum_k [ q e_k^2 + R |dU_k|^2 + w |U_k|^2 ]                          (95)
    subject to X_k+1 = arc from X_k under U_k    (1), (91)
               -d_inner <= e_k <= d_outer        (92)  two edges, for each disc of the robot
               r_j - |X_k - O_j| <= 0            (93)  obstacles, for each disc of the robot
               |U_k| <= largest wheel speed      (94)
               |v_k w_k| <= largest lateral acceleration, for speed v_k and turn rate w_k
               Y_N = Y_N*                        (5)   goal

with lateral error e_k, change dU_k between iterations, and controls U_k, whose weight w is 0 in the
paper. Constraints are distances, not their squares as in (92) and (93): their linearisation then
errs on the safe side of every convex obstacle.
"""

import math
from enum import IntEnum
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cmpsp_ros.arrays import Array
from cmpsp_ros.mpsp.jit import allocation_free
from cmpsp_ros.robots.motion import (
    Kinematics,
    lateral_acceleration,
    point_of,
    put_gradients,
    put_lateral_gradient,
    roll_out,
)
from cmpsp_ros.world import SpaceData
from cmpsp_ros.world.obstacles import away_from
from cmpsp_ros.world.roads import road_functions

Records = NDArray[np.void]

N_EDGE_CONSTRAINTS = 2  # path constraints of a disc at edges; then obstacles, then wheels
WHEEL_ROUNDING: Final = 1e-6  # distance of plans from a wheel limit, for rounding [rad/s]

LATERAL_PART: Final = 0.99
"""Part of the lateral acceleration that plans use: iterations that are not at their end exceed it.
"""


class CostHessian(IntEnum):
    """Hessian of the squared lateral error."""

    GAUSS_NEWTON = 0
    PROJECTED = 1
    EXACT = 2


class TerminalConstraint(IntEnum):
    """Terminal constraint; the value is the number of outputs."""

    LINE = 1
    POINT = 2
    POSE = 3


HEADING_SCALE: Final = 0.02  # weight of a radian, relative to a metre, in the terminal error [m]


PARAMETERS: Final = np.dtype(
    [
        ('goal', np.float64, (2,)),  # point to pass at the end [m]
        ('heading', np.float64),  # of a `POSE`, or across the line of a `LINE` [rad]
        ('road_center', np.float64),  # q of (95) [1/m^2]
        ('control_change', np.float64),  # R of (95) [s^2/rad^2]
        ('control_effort', np.float64),  # weight of the squared controls [s^2/rad^2]
        ('hessian', np.int64),  # a `CostHessian`
    ]
)
"""Numbers that stay the same from one control step to the next."""


class GuidanceData(NamedTuple):
    """The problem of one robot from its present pose."""

    pose: Array  # at present ``(3,)`` [m, m, rad]
    progress: float  # arc length along the road of a place near the pose, NaN if unknown [m]
    durations: Array  # length of every step, shape ``(N,)`` [s]
    parameters: Records  # one record of `PARAMETERS`, shape ``(1,)``, which is never written to
    robot: Kinematics
    # number of path constraints that limit its wheel speeds; those of its lateral acceleration and
    # of a control rate follow in a stage
    wheel_rows: int
    space: SpaceData  # for all stages or one for each


@allocation_free
def predict(data: GuidanceData, U: Array, X: Array) -> None:
    """Fill X ``(N + 1, n)`` by (1): exact arcs under U ``(N + 1, r)``; arrays may be longer."""
    for i in range(3):
        X[0, i] = data.pose[i]
    roll_out(X, U, data.durations, data.robot)


@allocation_free
def evaluate(data: GuidanceData, X: Array, U: Array, output_error: Array, g: Array) -> float:
    """Cost J of (95) without its proximal term; fills output error (5) and path constraints (4)."""
    p, cost = data.parameters[0], 0.0
    N, outputs = data.durations.shape[0], output_error.shape[0]
    road, shapes, radii, discs = data.space
    progress = road_functions.project(road, X[0, 0], X[0, 1], X[0, 2], data.progress)
    rows = N_EDGE_CONSTRAINTS + radii.shape[1]
    wheels = discs.shape[0] * rows
    for k in range(N + 1):
        progress, off_center, first, second = road_functions.lateral_error(
            road, k, X[k, 0], X[k, 1], progress
        )
        at, there = min(k, radii.shape[0] - 1), min(k, shapes.corners.shape[0] - 1)
        for i in range(discs.shape[0]):
            x, y, out_x, out_y = _disc_at(data, X, k, i)
            over, over_other = first, second
            if out_x != 0.0 or out_y != 0.0:
                _, _, over, over_other = road_functions.lateral_error(road, k, x, y, progress)
            row = i * rows
            g[k, row], g[k, row + 1] = (over, over_other) if k > 0 else (-math.inf, -math.inf)
            for j in range(radii.shape[1]):
                distance, _, _ = away_from(shapes, there, j, x, y)
                g[k, row + N_EDGE_CONSTRAINTS + j] = _keep_away(distance, radii[at, j], k)
        for i in range(data.wheel_rows):
            g[k, wheels + i] = _over_limit(data, U, k, i)
        if data.robot.max_lateral_acceleration < math.inf:
            for i in range(2):
                g[k, wheels + data.wheel_rows + i] = _over_lateral_limit(data, U, k, i)
        squared = 0.0
        for a in range(U.shape[1]):
            squared += U[k, a] * U[k, a]
        for i in range(U.shape[1], data.robot.wheels.shape[0]):
            speed = _wheel_speed(data, U, k, i)
            squared += speed * speed
        cost += p.road_center * off_center * off_center
        cost += p.control_effort * squared
    errors = _terminal_error(p, X[N, 0], X[N, 1], X[N, 2], outputs)
    for j in range(outputs):
        output_error[j] = errors[j]
    return 0.5 * cost


@allocation_free
def linearise(
    data: GuidanceData, X: Array, U: Array, stages: Records, path: Records, terminal: Records
) -> None:
    """Analytic derivatives along a trajectory, for ``n`` states of which the pose is the first.

    Half the squared lateral error has the gradient ``e n`` and the Hessian ``n n' + a t t'``, with
    unit vectors ``n`` across and ``t`` along the road. Gauss-Newton omits the second term; the
    projection omits it where ``a`` is negative, on the inner side of a curve.

    Stages ``(N + 1,)`` are records of `layout.stage_type`, path constraints ``(N + 1, l)`` and
    terminal constraints ``(m,)`` of `layout.row_type`. Entries that are always 0 are not written.
    """
    p, N = data.parameters[0], data.durations.shape[0]
    q, curvature = p.road_center, p.control_change + p.control_effort
    road, shapes, radii, discs = data.space
    rows = N_EDGE_CONSTRAINTS + radii.shape[1]
    wheels = discs.shape[0] * rows
    _linearise_motion(data, X, U, stages)
    progress = road_functions.project(road, X[0, 0], X[0, 1], X[0, 2], data.progress)
    for k in range(N + 1):
        stage = stages[k]
        progress, off_center, first, second = road_functions.lateral_error(
            road, k, X[k, 0], X[k, 1], progress
        )
        gradients = road_functions.gradients(road, X[k, 0], X[k, 1], progress)
        x, y, along, _, _, _, _ = gradients
        if p.hessian == CostHessian.GAUSS_NEWTON:
            along = 0.0
        elif p.hessian == CostHessian.PROJECTED:
            along = max(along, 0.0)
        stage.L_X[0] = q * off_center * x
        stage.L_X[1] = q * off_center * y
        L_XX = stage.L_XX
        L_XX[0, 0] = q * (x * x + along * y * y)
        L_XX[0, 1] = q * (x * y - along * x * y)
        L_XX[1, 0] = L_XX[0, 1]
        L_XX[1, 1] = q * (y * y + along * x * x)
        for a in range(U.shape[1]):
            stage.L_U[a] = p.control_effort * U[k, a]
            stage.L_UU[a, a] = curvature
        if data.robot.wheels.shape[0] > U.shape[1]:
            _weigh_all_wheels(data, U, k, stage.L_U, stage.L_UU)
        at, there = min(k, radii.shape[0] - 1), min(k, shapes.corners.shape[0] - 1)
        for i in range(discs.shape[0]):
            x, y, out_x, out_y = _disc_at(data, X, k, i)
            is_beside = out_x != 0.0 or out_y != 0.0
            over, over_other, slopes = first, second, gradients
            if is_beside:
                place, _, over, over_other = road_functions.lateral_error(road, k, x, y, progress)
                slopes = road_functions.gradients(road, x, y, place)
            edge, other = path[k, i * rows], path[k, i * rows + 1]
            # The present pose cannot be changed: no constraint applies to it.
            edge.value, other.value = (over, over_other) if k > 0 else (-math.inf, -math.inf)
            _, _, _, edge.X[0], edge.X[1], other.X[0], other.X[1] = slopes
            if is_beside:
                edge.X[2] = edge.X[1] * out_x - edge.X[0] * out_y
                other.X[2] = other.X[1] * out_x - other.X[0] * out_y
            for j in range(radii.shape[1]):
                row = path[k, i * rows + N_EDGE_CONSTRAINTS + j]
                distance, away_x, away_y = away_from(shapes, there, j, x, y)
                row.value = _keep_away(distance, radii[at, j], k)
                row.X[0], row.X[1] = -away_x, -away_y
                if is_beside:
                    row.X[2] = away_x * out_y - away_y * out_x
        for i in range(data.wheel_rows):
            row = path[k, wheels + i]
            row.value = _over_limit(data, U, k, i)
            for a in range(U.shape[1]):
                row.U[a] = _sign(i) * data.robot.wheels[U.shape[1] + i // 2, a]
        if data.robot.max_lateral_acceleration < math.inf:
            for i in range(2):
                row = path[k, wheels + data.wheel_rows + i]
                row.value = _over_lateral_limit(data, U, k, i)
                put_lateral_gradient(row.U, _sign(i), U, k, data.robot)
    outputs = terminal.shape[0]
    errors = _terminal_error(p, X[N, 0], X[N, 1], X[N, 2], outputs)
    for j in range(outputs):
        terminal[j].value = errors[j]
    if outputs == TerminalConstraint.LINE:
        terminal[0].X[0], terminal[0].X[1] = math.cos(p.heading), math.sin(p.heading)
    else:
        terminal[0].X[0] = terminal[1].X[1] = 1.0
    if outputs == TerminalConstraint.POSE:
        terminal[2].X[2] = HEADING_SCALE


@allocation_free
def _linearise_motion(data: GuidanceData, X: Array, U: Array, stages: Records) -> None:
    """Fill `A` and `B`, in a loop of its own: together with the rest both take longer."""
    for k in range(data.durations.shape[0]):
        put_gradients(stages[k].A, stages[k].B, X[k, 2], U, k, data.durations[k], data.robot)


@allocation_free
def _disc_at(data: GuidanceData, X: Array, k: int, i: int) -> Any:
    """Centre of a disc at a stage, and its offset from the reference point [m]."""
    x, y = point_of(X[k, 0], X[k, 1], X[k, 2], data.space.discs, i)
    return x, y, x - X[k, 0], y - X[k, 1]


@allocation_free
def _over_limit(data: GuidanceData, U: Array, k: int, i: int) -> float:
    """Constraint of a wheel in one direction; the controls, its first wheels, have bounds."""
    if k == data.durations.shape[0]:
        return -math.inf
    speed = _wheel_speed(data, U, k, U.shape[1] + i // 2)
    return _sign(i) * speed - (data.robot.max_wheel_speed - WHEEL_ROUNDING)


@allocation_free
def _over_lateral_limit(data: GuidanceData, U: Array, k: int, i: int) -> float:
    """Constraint of the lateral acceleration to one side."""
    if k == data.durations.shape[0]:
        return -math.inf
    across = _sign(i) * lateral_acceleration(U, k, data.robot)
    return across - LATERAL_PART * data.robot.max_lateral_acceleration


@allocation_free
def _wheel_speed(data: GuidanceData, U: Array, k: int, wheel: int) -> float:
    speed = 0.0
    for a in range(U.shape[1]):
        speed += data.robot.wheels[wheel, a] * U[k, a]
    return speed


@allocation_free
def _weigh_all_wheels(data: GuidanceData, U: Array, k: int, L_U: Array, L_UU: Array) -> None:
    """Add the cost of wheels whose speeds are not controls: else a robot would favour one side."""
    p, wheels, r = data.parameters[0], data.robot.wheels, U.shape[1]
    for a in range(r):
        for b in range(r):
            if b != a:
                L_UU[a, b] = 0.0
    for i in range(r, wheels.shape[0]):
        speed = _wheel_speed(data, U, k, i)
        for a in range(r):
            L_U[a] += p.control_effort * wheels[i, a] * speed
            for b in range(r):
                L_UU[a, b] += (p.control_change + p.control_effort) * wheels[i, a] * wheels[i, b]


@allocation_free
def _sign(i: int) -> float:
    return 1.0 if i % 2 == 0 else -1.0


@allocation_free
def _terminal_error(p: Any, x: float, y: float, heading: float, outputs: int) -> Any:
    """Terminal output error Y_N - Y_N*; that of the heading is wrapped."""
    dx, dy = x - p.goal[0], y - p.goal[1]
    if outputs == TerminalConstraint.LINE:
        return math.cos(p.heading) * dx + math.sin(p.heading) * dy, 0.0, 0.0
    turn = heading - p.heading
    return dx, dy, HEADING_SCALE * (turn - 2.0 * math.pi * round(turn / (2.0 * math.pi)))


@allocation_free
def _keep_away(distance: float, least: float, k: int) -> float:
    """Constraint (93) of an obstacle, not positive where met."""
    return least - distance if k > 0 and least > -math.inf else -math.inf
