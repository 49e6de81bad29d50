"""What a QP back end is asked and what it answers."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import Protocol

import numpy as np

from cmpsp_ros.arrays import Array
from cmpsp_ros.mpsp.problem import Dimensions
from cmpsp_ros.mpsp.qp.subproblem import Row, Subproblem

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
        path: One for each path constraint, of no effect where it does not apply, shape
            ``(N + 1, l)``.
    """

    terminal: Array
    path: Array


@dataclass(frozen=True)
class QPSolution:
    """Solution of a subproblem; where not solved, the arrays hold zeros.

    Attributes:
        status: How it ended.
        dU: Control deviations, shape ``(N + 1, r)``.
        terminal: Multipliers ``lambda`` of (54), of either sign, shape ``(m,)``.
        path: Multipliers ``rho`` of (57), not negative, 0 where a constraint does not apply,
            shape ``(N + 1, l)``.
        trust: Multipliers of the trust region, positive at ``+trust_radius``, shape
            ``(N + 1, n)``.
        bounds: Multipliers ``beta`` of the control bounds, positive at the upper one, shape
            ``(N + 1, r)``.
        iterations: Iterations of the back end, 0 where unknown.
        conflict: Constraints that contradict each other, as far as the back end names them.
    """

    status: QPStatus
    dU: Array
    terminal: Array
    path: Array
    trust: Array
    bounds: Array
    iterations: int = 0
    conflict: tuple[Row, ...] = ()

    @classmethod
    def unsolved(
        cls, size: Dimensions, status: QPStatus, conflict: tuple[Row, ...] = ()
    ) -> QPSolution:
        """The answer of a back end that has none."""
        stages = size.horizon + 1
        return cls(
            status,
            np.zeros((stages, size.control)),
            np.zeros(size.output),
            np.zeros((stages, size.path)),
            np.zeros((stages, size.state)),
            np.zeros((stages, size.control)),
            conflict=conflict,
        )


class Backend(Protocol):
    """Solves a subproblem, hard or relaxed."""

    def __call__(self, subproblem: Subproblem, penalties: Penalties | None) -> QPSolution:
        """Solve with hard rows, or with (54) and (57) relaxed where penalties are given."""
