"""The paper's demonstrative example (91)-(95) as an optimal control problem."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cmpsp_ros.mpsp.problem import (
    Dimensions,
    Evaluation,
    Hessian,
    Linearisation,
    OptimalControlProblem,
)
from cmpsp_ros.robot.clear_space import ClearSpace
from cmpsp_ros.robot.differential_drive import DifferentialDrive
from cmpsp_ros.robot.distance import distances

Array = NDArray[np.float64]

# The centre line's distance has no second derivative at the road's centre; nearer than this [m]
# its curvature is held.
_LEAST_RADIUS = 1e-3

EDGES = 2
"""Path constraints of the road, outer edge first; the obstacles' follow."""


@dataclass(frozen=True)
class Cost:
    """Weights of the cost, each with the factor 1/2 of (95).

    Attributes:
        center_radius: ``r_p``, radius of the road's centre line [m].
        road_center: ``q``, on the squared distance to it [1/m^2].
        control_change: ``R``, on the squared change between iterations [s^2/rad^2]; it enters the
            Hessian alone, since at the trajectory that is linearised nothing has changed.
        control_effort: On the squared wheel speeds [s^2/rad^2].
    """

    center_radius: float
    road_center: float
    control_change: float
    control_effort: float


class GuidanceProblem(OptimalControlProblem):
    """Pass the goal at the end of the horizon, inside the road, clear of obstacles.

    States are poses ``(x, y, heading)``, controls wheel speeds ``(right, left)``; the last control
    ``U_N`` moves nothing. Constraints are distances, not their squares as in (92) and (93): their
    linearisation then errs on the safe side of every convex obstacle.
    """

    def __init__(
        self,
        robot: DifferentialDrive,
        space: ClearSpace,
        cost: Cost,
        pose: Array,
        goal: Array,
        durations: Array,
    ) -> None:
        """Set the problem up from where the robot is.

        Args:
            robot: Kinematics and wheel-speed limit.
            space: Where the robot's centre may be at the samples.
            cost: Weights of the cost.
            pose: Present pose, shape ``(3,)`` [m, m, rad].
            goal: Point to pass at the end, shape ``(2,)`` [m].
            durations: Length of every step, shape ``(N,)`` [s].
        """
        steps = len(durations)
        self.size = Dimensions(
            horizon=steps, state=3, control=2, output=2, path=EDGES + len(space.centers) - 1
        )
        self.control_upper = np.full((steps + 1, 2), robot.max_wheel_speed)
        self.control_lower = -self.control_upper
        self.target = goal
        self._robot = robot
        self._space = space
        self._cost = cost
        self._pose = pose
        self._durations = durations

    def predict(self, U: Array) -> Array:
        """Exact arcs under zero-order hold; shape ``(N + 1, 3)``."""
        return self._robot.roll_out(self._pose, U, self._durations)

    def evaluate(self, X: Array, U: Array) -> Evaluation:
        """Value of (95) without its proximal term, miss and constraint violations."""
        distance, _ = distances(X[:, :2], self._space.centers)
        off_center = distance[:, 0] - self._cost.center_radius
        cost = self._cost.road_center * (off_center @ off_center)
        cost += self._cost.control_effort * np.vdot(U, U)
        return Evaluation(0.5 * float(cost), X[-1, :2] - self.target, self._violations(distance))

    def linearise(self, X: Array, U: Array, hessian: Hessian = 'gauss_newton') -> Linearisation:
        """Analytic derivatives.

        The second derivative of ``(r - r_p)^2 / 2`` is ``n n' + (1 - r_p / r) t t'`` with unit
        vectors ``n`` across and ``t`` along the road. Gauss-Newton leaves the second term out. It
        is negative wherever ``r < r_p``, and there 0 in the projection.
        """
        size, cost = self.size, self._cost
        stages = size.horizon + 1
        A, B = self._robot.jacobians(X, U, self._durations)
        distance, gradient = distances(X[:, :2], self._space.centers)
        across = gradient[:, 0]
        off_center = distance[:, 0] - cost.center_radius

        L_X = np.zeros((stages, 3))
        L_X[:, :2] = cost.road_center * off_center[:, None] * across
        L_XX = np.zeros((stages, 3, 3))
        L_XX[:, :2, :2] = cost.road_center * across[:, :, None] * across[:, None, :]
        if hessian != 'gauss_newton':
            along = np.column_stack([-across[:, 1], across[:, 0]])
            radius = np.maximum(distance[:, 0], _LEAST_RADIUS)
            curvature = cost.road_center * off_center / radius
            if hessian == 'projected':
                curvature = np.maximum(curvature, 0.0)
            L_XX[:, :2, :2] += curvature[:, None, None] * along[:, :, None] * along[:, None, :]
        L_UU = np.zeros((stages, 2, 2))
        L_UU[:] = (cost.control_change + cost.control_effort) * np.eye(2)

        g_X = np.zeros((stages, size.path, 3))
        g_X[:, 0, :2] = across
        g_X[:, 1, :2] = -across
        g_X[:, EDGES:, :2] = -gradient[:, 1:]
        h_X = np.zeros((2, 3))
        h_X[0, 0] = h_X[1, 1] = 1.0
        return Linearisation(
            A=A,
            B=B,
            L_X=L_X,
            L_U=cost.control_effort * U,
            L_XX=L_XX,
            L_UX=np.zeros((stages, 2, 3)),
            L_UU=L_UU,
            output_error=X[-1, :2] - self.target,
            h_X=h_X,
            h_U=np.zeros((2, 2)),
            g=self._violations(distance),
            g_X=g_X,
            g_U=np.zeros((stages, size.path, 2)),
        )

    def _violations(self, distance: Array) -> Array:
        g = -self._space.clearance(distance, distance)
        g[0] = -np.inf
        return g
