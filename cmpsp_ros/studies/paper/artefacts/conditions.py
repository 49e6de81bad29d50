"""The conditions of Theorem 2 along a driven history, as far as they can be measured."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from cmpsp_ros.arrays import Array
from cmpsp_ros.guidance.formulation import GuidanceProblem, sample_space
from cmpsp_ros.mpsp.qp.dense import CondensedQP, condense
from cmpsp_ros.studies.paper.drives import Path

# A constraint this near to its bound [m] counts as active, a wheel this near to its limit [rad/s].
_ACTIVE = 1e-6
_DIFFERENCE = 1e-3


@dataclass(frozen=True)
class Conditions:
    """Numbers behind conditions (ii) and (iii).

    Attributes:
        size: ``q``, number of unknowns.
        rank_S_N: Rank of the output sensitivity (55).
        path_rows: Path constraints (92) (93) that are active.
        wheel_rows: Wheel limits (94) that are active.
        rank_G: Rank of ``G`` of Theorem 2.
        least_eigenvalue: Least eigenvalue of the exact Hessian of (95), ``R`` of its second term
            included.
        neglected: What (45) leaves out of the Hessian of the first term, relative to it in norm.
    """

    size: int
    rank_S_N: int
    path_rows: int
    wheel_rows: int
    rank_G: int
    least_eigenvalue: float
    neglected: float

    @property
    def columns_G(self) -> int:
        """Columns of ``G``: outputs and active constraints."""
        return 2 + self.path_rows + self.wheel_rows


def measure(path: Path) -> Conditions:
    """Evaluate the conditions at the control history driven, seen from the start."""
    settings = path.settings
    weights = settings.weights
    problem = GuidanceProblem(
        settings.robot,
        sample_space(settings, settings.world),
        replace(weights, control_effort=0.0),
        path.poses[0],
        np.array(settings.goal),
        path.durations,
    )
    U = np.vstack([path.controls, path.controls[-1:]])
    qp = _condensed(problem, U)
    path_rows = qp.B_C[qp.g < _ACTIVE]
    # The last control moves nothing and is not counted.
    wheel_rows = np.eye(U.size)[
        np.flatnonzero(settings.robot.max_wheel_speed - np.abs(U[:-1].ravel()) < _ACTIVE)
    ]
    exact = _hessian(problem, U)
    gradients = np.vstack([qp.S_N, path_rows, wheel_rows])
    return Conditions(
        size=U.size,
        rank_S_N=int(np.linalg.matrix_rank(qp.S_N)),
        path_rows=len(path_rows),
        wheel_rows=len(wheel_rows),
        rank_G=int(np.linalg.matrix_rank(gradients)),
        least_eigenvalue=float(np.linalg.eigvalsh(exact).min()) + weights.control_change,
        neglected=float(np.linalg.norm(exact - _condensed_hessian(problem, path, U), 2))
        / float(np.linalg.norm(exact, 2)),
    )


def _hessian(problem: GuidanceProblem, U: Array) -> Array:
    """Second derivative of the cost by differences of its analytic gradient; no Gauss-Newton."""
    columns = []
    for direction in np.eye(U.size).reshape(-1, *U.shape):
        ahead = _condensed(problem, U + _DIFFERENCE * direction).c
        behind = _condensed(problem, U - _DIFFERENCE * direction).c
        columns.append((ahead - behind) / (2.0 * _DIFFERENCE))
    hessian = np.array(columns)
    symmetric: Array = (hessian + hessian.T) / 2.0
    return symmetric


def _condensed_hessian(problem: GuidanceProblem, path: Path, U: Array) -> Array:
    """Hessian (45) of the first term, with the exact second derivative of the stage cost."""
    settings = path.settings
    linear = problem.linearise(path.poses, U)
    out = path.poses[:, :2] - settings.world.annulus.center
    radius = np.linalg.norm(out, axis=1)
    along = np.column_stack([-out[:, 1], out[:, 0]]) / radius[:, None]
    bend = (settings.world.annulus.center_radius / radius)[:, None, None]
    L_XX = np.zeros_like(linear.L_XX)
    L_XX[:, :2, :2] = np.eye(2) - bend * along[:, :, None] * along[:, None, :]
    L_XX *= settings.weights.road_center
    linear = replace(linear, L_XX=L_XX, L_UU=np.zeros_like(linear.L_UU))
    H: Array = condense(linear, problem.control_lower - U, problem.control_upper - U).H
    return H


def _condensed(problem: GuidanceProblem, U: Array) -> CondensedQP:
    linear = problem.linearise(problem.predict(U), U)
    return condense(linear, problem.control_lower - U, problem.control_upper - U)
