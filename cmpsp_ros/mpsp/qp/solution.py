"""What a QP back end is asked and what it answers."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import Protocol

import numpy as np

from cmpsp_ros.mpsp.condensing import CondensedQP
from cmpsp_ros.mpsp.problem import Array

TOLERANCE = 1e-5
"""Relative violation of the optimality conditions up to which an answer is a solution."""


class QPStatus(Enum):
    """How a quadratic program ended; the value is a sentence for the user."""

    SOLVED = 'The quadratic program was solved.'
    INFEASIBLE = 'No control satisfies all linearised constraints.'
    FAILED = 'The QP back end gave up or returned a point that is not a solution.'


@dataclass(frozen=True)
class Penalties:
    """Weights of the exact L1 relaxation: cost of violating each row by one unit.

    Attributes:
        terminal: One for each terminal output, shape ``(m,)``.
        path: One for each path row of the program, shape ``(p,)``.
    """

    terminal: Array
    path: Array


@dataclass(frozen=True)
class QPSolution:
    """Solution of a condensed quadratic program.

    Attributes:
        status: How it ended; where not solved, the arrays hold zeros.
        dU: Control deviations, shape ``(q,)``.
        terminal: Multipliers ``lambda`` of (54), shape ``(m,)``, of either sign.
        path: Multipliers ``rho`` of (57), shape ``(p,)``, not negative.
        trust: Multipliers of the trust region, shape ``(t,)``, signed as ``T dU``.
        bounds: Multipliers of the control bounds, shape ``(q,)``, positive at the upper one.
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
    def unsolved(cls, qp: CondensedQP, status: QPStatus) -> QPSolution:
        """The answer of a back end that has none."""
        return cls(
            status,
            np.zeros_like(qp.c),
            np.zeros_like(qp.output_error),
            np.zeros_like(qp.g),
            np.zeros_like(qp.radius),
            np.zeros_like(qp.c),
        )


class Backend(Protocol):
    """Solves a condensed quadratic program, hard or relaxed."""

    def __call__(self, qp: CondensedQP, penalties: Penalties | None) -> QPSolution:
        """Solve with hard rows, or with (54) and (57) relaxed where penalties are given."""


def kkt_residual(qp: CondensedQP, solution: QPSolution, penalties: Penalties | None) -> float:
    """Largest violation of the optimality conditions, relative to the size of the data.

    Covers stationarity, feasibility (of the rows that are hard), signs of multipliers, and
    complementarity, in which a relaxed row may be violated only at its full penalty.
    """
    dU = solution.dU
    gradient = qp.H @ dU + qp.c
    pulls = (
        qp.S_N.T @ solution.terminal,
        qp.B_C.T @ solution.path,
        qp.T.T @ solution.trust,
        solution.bounds,
    )
    scale = 1.0 + max(np.abs(part).max(initial=0.0) for part in (gradient, *pulls))
    worst = np.abs(gradient + sum(pulls)).max() / scale

    terminal = qp.S_N @ dU + qp.output_error
    path = qp.B_C @ dU - qp.g
    trust = np.abs(qp.T @ dU) - qp.radius
    reach = np.maximum(qp.lower - dU, dU - qp.upper)
    size = 1.0 + np.abs(dU).max()
    hard = [trust, reach]
    signs = [-solution.path]
    if penalties is None:
        hard += [np.abs(terminal), path]
        gaps = [solution.path * path]
    else:
        signs += [solution.path - penalties.path, np.abs(solution.terminal) - penalties.terminal]
        excess, miss = np.maximum(path, 0.0), np.abs(terminal)
        gaps = [
            solution.path * np.minimum(path, 0.0),
            excess * (penalties.path - solution.path),
            miss * penalties.terminal - terminal * solution.terminal,
        ]
    gaps += [solution.trust * trust, solution.bounds * np.where(solution.bounds, reach, 0.0)]
    worst = max(worst, *(part.max(initial=0.0) / size for part in hard))
    worst = max(worst, *(part.max(initial=0.0) / scale for part in signs))
    return float(max(worst, *(np.abs(part).max(initial=0.0) / (scale * size) for part in gaps)))
