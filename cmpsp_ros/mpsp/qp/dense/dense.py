"""Between stages and rows, for the back ends that solve the condensed program."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from cmpsp_ros.mpsp.problem import Array
from cmpsp_ros.mpsp.qp.dense.condensing import CondensedQP
from cmpsp_ros.mpsp.qp.solution import Penalties, QPSolution, QPStatus
from cmpsp_ros.mpsp.qp.subproblem import Subproblem


class DensePenalties(NamedTuple):
    """`Penalties` with one number for each row.

    Attributes:
        terminal: Shape ``(m,)``.
        path: Shape ``(p,)``.
    """

    terminal: Array
    path: Array


class DenseSolution(NamedTuple):
    """`QPSolution` with one number for each row of a `CondensedQP`.

    Attributes:
        status: How it ended; where not solved, the arrays hold zeros.
        dU: Shape ``(q,)``.
        terminal: Shape ``(m,)``.
        path: Shape ``(p,)``.
        trust: Signed as ``T dU``, shape ``(t,)``.
        bounds: Shape ``(q,)``.
        iterations: Iterations of the back end, 0 where it does not tell.
    """

    status: QPStatus
    dU: Array
    terminal: Array
    path: Array
    trust: Array
    bounds: Array
    iterations: int = 0

    @classmethod
    def unsolved(cls, qp: CondensedQP, status: QPStatus) -> DenseSolution:
        """The answer of a back end that has none."""
        return cls(
            status,
            np.zeros_like(qp.c),
            np.zeros_like(qp.output_error),
            np.zeros_like(qp.g),
            np.zeros_like(qp.radius),
            np.zeros_like(qp.c),
        )


def gather(qp: CondensedQP, penalties: Penalties | None) -> DensePenalties | None:
    """Penalties of the rows there are."""
    if penalties is None:
        return None
    return DensePenalties(penalties.terminal, penalties.path[qp.path_stage, qp.path_index])


def scatter(subproblem: Subproblem, dense: DenseSolution) -> QPSolution:
    """A solution of ``subproblem.condensed`` in the shapes of the stages."""
    qp, size = subproblem.condensed, subproblem.size
    N = size.horizon
    path = np.zeros((N + 1, size.path))
    path[qp.path_stage, qp.path_index] = dense.path
    trust = np.zeros((N + 1, size.state))
    trust[1:, subproblem.trust_radius != np.inf] = dense.trust.reshape(-1, N).T
    return QPSolution(
        dense.status,
        dense.dU.reshape(N + 1, size.control),
        dense.terminal,
        path,
        trust,
        dense.bounds.reshape(N + 1, size.control),
        dense.iterations,
    )
