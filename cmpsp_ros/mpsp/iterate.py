"""Where the iteration stands, and what its last step did."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from cmpsp_ros.mpsp.problem import Array, Evaluation, not_finite
from cmpsp_ros.mpsp.qp import QPStatus

SLACK_TOLERANCE = 1e-6
"""Violation of a linearised constraint up to which it counts as met."""

# A relaxed subproblem that leaves this much of the violation has nothing left to gain.
_NOTHING_GAINED = 0.99


@dataclass(frozen=True)
class Step:
    """What one iteration did.

    Attributes:
        qp_status: How the subproblem ended.
        elastic: Whether it had to be relaxed.
        slack_terminal: Violation of the linearised terminal constraint that was left, ``(m,)``.
        slack_path: Violation of the linearised path constraints that was left, ``(N + 1, l)``.
        length: Step length taken; 0 where no step was.
        terminal_multipliers: ``lambda``, shape ``(m,)``.
        path_multipliers: ``rho``, shape ``(N + 1, l)``.
        bound_multipliers: Of the control bounds, positive at the upper one, ``(N + 1, r)``.
        active_rows: Number of path rows, trust rows and bounds that are active.
        qp_iterations: Iterations of the QP back end.
        full_change: Relative change of the controls that the full step asks for, as compared with
            ``eps_U`` in Sec. 4; the change made, where the length is 1.
        shift: Added to the Hessian's diagonal because curvature was lost, else 0.
        corrected: Whether the line search went along a second-order correction.
        not_finite: The first number of the subproblem that is not finite; empty where all are.
    """

    qp_status: QPStatus
    elastic: bool
    slack_terminal: Array
    slack_path: Array
    length: float
    terminal_multipliers: Array
    path_multipliers: Array
    bound_multipliers: Array
    active_rows: int
    qp_iterations: int
    full_change: float = 0.0
    shift: float = 0.0
    corrected: bool = False
    not_finite: str = ''

    @property
    def slack(self) -> float:
        """Largest violation that the relaxation left in the linearised constraints."""
        parts = np.abs(self.slack_terminal).max(initial=0.0), self.slack_path.max(initial=0.0)
        return float(max(parts))

    @property
    def needed_slack(self) -> bool:
        """Whether the relaxation left a violation."""
        return self.elastic and self.slack > SLACK_TOLERANCE

    def gains_nothing_on(self, evaluation: Evaluation) -> bool:
        """Whether the relaxed subproblem leaves the violation it started from as it was."""
        left = np.abs(self.slack_terminal).sum() + self.slack_path.sum()
        now = np.abs(evaluation.output_error).sum() + np.maximum(evaluation.g, 0.0).sum()
        return self.needed_slack and bool(left >= _NOTHING_GAINED * now)


class Size(NamedTuple):
    """Magnitudes that grow without bound where a run diverges, each plus 1."""

    cost: float
    control: float


@dataclass(frozen=True)
class Iterate:
    """State of the iteration.

    Attributes:
        index: Iterations done, ``i``.
        U: Controls, shape ``(N + 1, r)``.
        X: Predicted states, shape ``(N + 1, n)``.
        evaluation: Value along them.
        guess_size: Cost and controls of the guess.
        previous_U: Controls before the last step; None at the start.
        step: The last step; None at the start.
    """

    index: int
    U: Array
    X: Array
    evaluation: Evaluation
    guess_size: Size
    previous_U: Array | None = field(default=None)
    step: Step | None = field(default=None)

    @property
    def not_finite(self) -> str:
        """The first number of prediction or cost that is not finite; empty where all are."""
        cost = self.evaluation.cost
        in_X = not_finite('the prediction', self.X)
        return in_X or ('' if np.isfinite(cost) else f'the cost: found {cost}')
