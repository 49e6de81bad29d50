"""What the interior point works with."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from cmpsp_ros.mpsp.problem import Array
from cmpsp_ros.mpsp.riccati.barrier import Barrier, empty_barrier
from cmpsp_ros.mpsp.riccati.stage_qp import Multipliers, StageQP, empty_multipliers, empty_qp
from cmpsp_ros.mpsp.riccati.whitening import Whitening, whitening
from cmpsp_ros.mpsp.riccati.working_set import Indices

STEPS, CONFLICT = 0, 1
"""Places in `InteriorPoint.counts`."""


class InteriorPoint(NamedTuple):
    """Room for programs of some sizes, one at a time.

    Attributes:
        counts: Iterations done, and rows in `conflict`; shape ``(2,)``.
        model: The program with the cost of the Newton step.
        white: Factorisation of it.
        barrier: The rows.
        U: Iterate, shape ``(N + 1, r)``.
        X: Its states, shape ``(N + 1, n)``.
        step_U: Step, shape ``(N + 1, r)``.
        step_X: Its states, shape ``(N + 1, n)``.
        dU: Control deviations of the solution, shape ``(N + 1, r)``.
        multipliers: Multipliers of the solution.
        candidates: Multipliers of the iterate.
        costates: Scratch, shape ``(4, n)``.
        conflict: Rows that contradict each other, where infeasible; shape ``(rows,)``.
    """

    counts: Indices
    model: StageQP
    white: Whitening
    barrier: Barrier
    U: Array
    X: Array
    step_U: Array
    step_X: Array
    dU: Array
    multipliers: Multipliers
    candidates: Multipliers
    costates: Array
    conflict: Indices


def interior_room(N: int, n: int, r: int, m: int, l: int) -> InteriorPoint:  # noqa: E741
    """Room for programs of these sizes."""
    K = N + 1
    rows = m + K * (l + 2 * r + 2 * n)
    return InteriorPoint(
        counts=np.zeros(2, np.int64),
        model=empty_qp(N, n, r, m, l),
        white=whitening(N, n, r),
        barrier=empty_barrier(rows),
        U=np.zeros((K, r)),
        X=np.zeros((K, n)),
        step_U=np.zeros((K, r)),
        step_X=np.zeros((K, n)),
        dU=np.zeros((K, r)),
        multipliers=empty_multipliers(N, n, r, m, l),
        candidates=empty_multipliers(N, n, r, m, l),
        costates=np.zeros((4, n)),
        conflict=np.zeros(rows, np.int64),
    )
