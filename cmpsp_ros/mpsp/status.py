"""How a run of the iteration ended, in words and in numbers."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import TYPE_CHECKING

import numpy as np

from cmpsp_ros.arrays import Array
from cmpsp_ros.mpsp.problem import Evaluation

if TYPE_CHECKING:
    from cmpsp_ros.mpsp.iterate import Iterate, Record

_NAMED = 4


class Status(Enum):
    """End of a C-MPSP run; the value is a sentence for the user."""

    CONVERGED = (
        'Converged: terminal error, control change and constraint violation are below their '
        'tolerances.'
    )
    ITERATION_LIMIT = 'Stopped at the iteration limit before all tolerances were met.'
    INFEASIBLE = 'The linearised constraints contradict each other; slack was needed to the end.'
    DIVERGED = 'The controls or the cost grow without bound.'
    STALLED = 'No step along the search direction lowers the merit function any more.'
    QP_FAILED = 'The QP back end found no solution of the subproblem.'
    NOT_FINITE = 'The prediction or its derivatives are not finite numbers.'


@dataclass(frozen=True)
class Violation:
    """A constraint that is not met.

    Attributes:
        stage: Stage ``k``; ``N`` for a terminal output.
        index: Which of the stage's path constraints, or which component of the output.
        is_terminal: Whether it is a terminal output (5), else a path constraint (4).
        amount: By how much, positive for a path constraint, of either sign for an output.
    """

    stage: int
    index: int
    is_terminal: bool
    amount: float

    def __str__(self) -> str:
        """The constraint's name and the amount."""
        if self.is_terminal:
            return f'terminal output {self.index} is off by {self.amount:.3g}'
        return (
            f'path constraint {self.index} at stage {self.stage} is exceeded by {self.amount:.3g}'
        )


def violations(evaluation: Evaluation, terminal: float, path: float) -> tuple[Violation, ...]:
    """All constraints violated by more than a tolerance, the worst first.

    Args:
        evaluation: Value along a trajectory.
        terminal: Tolerance of each terminal output, absolute.
        path: Tolerance of each path constraint, absolute.
    """
    error, g = evaluation.output_error, evaluation.g
    last = len(g) - 1
    found = [
        Violation(last, int(i), True, float(error[i]))
        for i in np.flatnonzero(~(np.abs(error) <= terminal))
    ]
    found += [
        Violation(int(k), int(j), False, float(g[k, j])) for k, j in np.argwhere(~(g <= path))
    ]
    return tuple(sorted(found, key=lambda violation: -abs(violation.amount)))


@dataclass(frozen=True)
class Solution:
    """End of a run.

    Multipliers are those of the last subproblem, 0 where none was solved. Their signs make
    ``grad J + S_N' lambda + B_C' rho + beta = 0`` at a solution, (63) with the control bounds.

    Attributes:
        iterate: The last iterate.
        status: How the run ended.
        history: One record for every iterate, the guess first.
        terminal_multipliers: ``lambda``, shape ``(m,)``, of either sign.
        path_multipliers: ``rho``, shape ``(N + 1, l)``, not negative.
        bound_multipliers: ``beta``, shape ``(N + 1, r)``, positive at an upper bound, negative at
            a lower one.
        violated: Constraints not met at the last iterate, the worst first.
    """

    iterate: Iterate
    status: Status
    history: tuple[Record, ...]
    terminal_multipliers: Array
    path_multipliers: Array
    bound_multipliers: Array
    violated: tuple[Violation, ...]

    @property
    def curvature_lost(self) -> int:
        """Number of iterations whose Hessian had to be shifted to give a unique step."""
        return sum(record.shift > 0.0 for record in self.history)

    @property
    def sentence(self) -> str:
        """What a user wants to read: how it ended, after how many iterations, and what is wrong."""
        last = self.history[-1]
        step = self.iterate.step
        not_finite = self.iterate.not_finite or (step.not_finite if step is not None else '')
        parts = [
            self.status.value,
            *([f'First of them: {not_finite}.'] if not_finite else ()),
            f'Iterations: {self.iterate.index}; KKT residual {last.kkt_residual:.1e}.',
        ]
        if self.violated:
            named = '; '.join(str(violation) for violation in self.violated[:_NAMED])
            more = len(self.violated) - _NAMED
            parts.append(f'Not met: {named}' + (f'; and {more} more.' if more > 0 else '.'))
        if self.curvature_lost:
            parts.append(f'The Hessian had lost curvature in {self.curvature_lost} iterations.')
        return ' '.join(parts)
