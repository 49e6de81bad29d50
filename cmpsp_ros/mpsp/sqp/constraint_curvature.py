"""The constraints' curvature, which (45) leaves out of the Hessian of the Lagrangian of (62)."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from cmpsp_ros.mpsp.iterate import Iterate, Step
from cmpsp_ros.mpsp.problem import Array, Linearisation, OptimalControlProblem


def add_constraint_curvature(
    problem: OptimalControlProblem, at: Iterate, linearisation: Linearisation
) -> Linearisation:
    """The derivatives at an iterate, with the constraints' curvature in the Hessian.

    Args:
        problem: The problem.
        at: An iterate with a step, whose multipliers are the weights.
        linearisation: Derivatives there.

    Raises:
        ProblemError: The problem does not tell the curvature.
    """
    assert at.step is not None  # noqa: S101 (without one there are no multipliers)
    path = np.where(linearisation.g == -np.inf, 0.0, at.step.path_multipliers)
    XX, UX, UU = problem.constraint_curvature(
        at.X, at.U, costates(linearisation, at.step)[1:], at.step.terminal_multipliers, path
    )
    return replace(
        linearisation,
        L_XX=linearisation.L_XX + XX,
        L_UX=linearisation.L_UX + UX,
        L_UU=linearisation.L_UU + UU,
    )


def costates(linearisation: Linearisation, step: Step) -> Array:
    """Multipliers of the dynamics (1), for which the Lagrangian is stationary in the states.

    Args:
        linearisation: Derivatives along a trajectory.
        step: The multipliers of its constraints.

    Returns:
        Gradient of the cost to go by ``X_k``, shape ``(N + 1, n)``.
    """
    lin = linearisation
    rows = np.einsum('kli,kl->ki', lin.g_X, step.path_multipliers)
    found: Array = lin.L_X + rows
    found[-1] += lin.h_X.T @ step.terminal_multipliers
    for k in reversed(range(len(lin.A))):
        found[k] += lin.A[k].T @ found[k + 1]
    return found
