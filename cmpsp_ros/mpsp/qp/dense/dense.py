"""Rows of a condensed program, as the back ends that solve it want them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from cmpsp_ros.arrays import Array
from cmpsp_ros.mpsp.qp.dense.condensing import CondensedQP
from cmpsp_ros.mpsp.qp.solution import Penalties, QPSolution, QPStatus
from cmpsp_ros.mpsp.qp.subproblem import Subproblem


class DenseRows(NamedTuple):
    """Rows ``lower <= matrix dU <= upper``: terminal, path and trust ones.

    Attributes:
        matrix: Shape ``(R, q)``.
        lower: Shape ``(R,)``, ``-inf`` for path rows.
        upper: Shape ``(R,)``.
        weight: Penalty of each row, ``inf`` where hard, shape ``(R,)``.
    """

    matrix: Array
    lower: Array
    upper: Array
    weight: Array


def dense_rows(qp: CondensedQP, penalties: Penalties | None) -> DenseRows:
    """The rows of a condensed program, bounds left out."""
    least, weight = np.full(len(qp.g), -np.inf), np.full(len(qp.T), np.inf)
    if penalties is None:
        relaxed = np.full(len(qp.output_error) + len(qp.g), np.inf)
    else:
        path = penalties.path[qp.path_stage, qp.path_index]
        relaxed = np.concatenate([penalties.terminal, path])
    return DenseRows(
        np.concatenate([qp.S_N, qp.B_C, qp.T]),
        np.concatenate([-qp.output_error, least, -qp.radius]),
        np.concatenate([-qp.output_error, qp.g, qp.radius]),
        np.concatenate([relaxed, weight]),
    )


def dense_solution(
    subproblem: Subproblem, dU: Array, multipliers: Array, iterations: int = 0
) -> QPSolution:
    """A solution of ``subproblem.condensed`` in the shapes of the stages.

    Args:
        subproblem: The program.
        dU: Shape ``(q,)``.
        multipliers: Of `DenseRows` and the bounds, positive at upper limits, shape ``(R + q,)``.
        iterations: Iterations of the back end, 0 where unknown.
    """
    qp, size = subproblem.condensed, subproblem.size
    N, m, p, t = size.horizon, size.output, len(qp.g), len(qp.radius)
    path, trust = np.zeros((N + 1, size.path)), np.zeros((N + 1, size.state))
    terminal, of_path, of_trust, bounds = np.split(multipliers, [m, m + p, m + p + t])
    path[qp.path_stage, qp.path_index] = of_path
    trust[1:, subproblem.trust_radius != np.inf] = of_trust.reshape(-1, N).T
    shape = N + 1, size.control
    return QPSolution(
        QPStatus.SOLVED, dU.reshape(shape), terminal, path, trust, bounds.reshape(shape), iterations
    )
