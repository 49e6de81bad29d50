"""Iterates, the record that is kept of each, and how a run ended, in words and in numbers."""

from dataclasses import dataclass
from enum import Enum
from functools import cached_property
from typing import NamedTuple

import numpy as np

from cmpsp_ros.arrays import Array
from cmpsp_ros.mpsp.arguments import not_finite
from cmpsp_ros.mpsp.problem import Evaluation, Linearisation
from cmpsp_ros.mpsp.qp import QPStatus

SLACK_TOLERANCE = 1e-6
"""Violation of a linearised constraint up to which it counts as met."""

# A relaxed subproblem that leaves this much of the violation has nothing left to gain.
_NOTHING_GAINED = 0.99


@dataclass(frozen=True)
class Step:
    """Outcome of one iteration.

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
        """True where the relaxation left a violation."""
        return self.elastic and self.slack > SLACK_TOLERANCE

    def gains_nothing_on(self, evaluation: Evaluation) -> bool:
        """True where the relaxed subproblem leaves the violation as it was."""
        left = np.abs(self.slack_terminal).sum() + self.slack_path.sum()
        now = np.abs(evaluation.output_error).sum() + np.maximum(evaluation.g, 0.0).sum()
        return self.needed_slack and bool(left >= _NOTHING_GAINED * now)


class Size(NamedTuple):
    """Magnitudes that grow without bound where a run diverges, each plus 1."""

    cost: float
    control: float


@dataclass(frozen=True)
class Iterate:
    """State of the iteration after `index` = ``i`` steps: ``U``, ``X`` and their evaluation.

    `guess_size` is that of the guess; controls before the last step, and that step, are None at the
    start. `gap` is the largest gap between the states and the dynamics (1), 0 where the controls
    lead to these states; only multiple shooting has gaps.
    """

    index: int
    U: Array
    X: Array
    evaluation: Evaluation
    guess_size: Size
    previous_U: Array | None = None
    step: Step | None = None
    gap: float = 0.0

    @property
    def multipliers(self) -> tuple[Array, Array, Array]:
        """``lambda``, ``rho`` and ``beta`` of the last step, 0 at the guess."""
        if (step := self.step) is None:
            value = self.evaluation
            return np.zeros_like(value.output_error), np.zeros_like(value.g), np.zeros_like(self.U)
        return step.terminal_multipliers, step.path_multipliers, step.bound_multipliers

    def multipliers_on(self, lin: Linearisation) -> tuple[Array, Array, Array]:
        """`multipliers`, 0 for path constraints that do not apply."""
        terminal, path, bounds = self.multipliers
        return terminal, np.where(lin.g == -np.inf, 0.0, path) if path.size else path, bounds

    @cached_property
    def not_finite(self) -> str:
        """The first number of prediction or cost that is not finite; empty where all are."""
        cost = self.evaluation.cost
        in_X = not_finite('the prediction', self.X)
        return in_X or ('' if np.isfinite(cost) else f'the cost: found {cost}')


@dataclass(frozen=True)
class Record:
    """Measurements of one iterate.

    Attributes:
        index: Iterations done, ``i``.
        U: Controls ``U^i``, shape ``(N + 1, r)``.
        cost: ``J``.
        step_norm: ``|U^i - U^(i-1)|``, Euclidean; 0 at the guess.
        step_length: Length that the line search took; 0 at the guess.
        terminal_error: ``|Y_N - Y_N*|``.
        violation: Largest path constraint (4), 0 where all are met.
        gap: Largest gap between states and dynamics, in scaled units; 0 but for multiple shooting.
        kkt_residual: Violation of the optimality conditions of the problem itself at the iterate,
            with its latest multipliers (0 at the guess): stationarity, feasibility, signs and
            complementarity, relative to the size of the data; of the scaled problem. NaN where they
            are.
        terminal_multipliers: ``lambda``, shape ``(m,)``.
        path_multipliers: ``rho``, shape ``(N + 1, l)``.
        bound_multipliers: ``beta``, shape ``(N + 1, r)``, positive at the upper bound.
        shift: Term added to the diagonal of the Hessian because curvature was lost.
    """

    index: int
    U: Array
    cost: float
    step_norm: float
    step_length: float
    terminal_error: float
    violation: float
    gap: float
    kkt_residual: float
    terminal_multipliers: Array
    path_multipliers: Array
    bound_multipliers: Array
    shift: float

    @property
    def active_path(self) -> frozenset[tuple[int, int]]:
        """Active path constraints, each as ``(stage, index)``: those with a multiplier."""
        return frozenset((int(k), int(j)) for k, j in np.argwhere(self.path_multipliers > 0.0))

    @property
    def active_bounds(self) -> frozenset[tuple[int, int]]:
        """Active control bounds, each as ``(stage, component)``: those with a multiplier."""
        return frozenset((int(k), int(j)) for k, j in np.argwhere(self.bound_multipliers))


_NAMED = 4


class Status(Enum):
    """End of a C-MPSP run; the value is a sentence for the user."""

    CONVERGED = (
        'Converged: optimality conditions, terminal error, control change and constraint violation '
        'are within their tolerances.'
    )
    ITERATION_LIMIT = (
        'Stopped at the iteration limit before all tolerances were met. Raise the limit, or start '
        'nearer.'
    )
    TIME_LIMIT = 'Stopped at the time limit before all tolerances were met.'
    INFEASIBLE = (
        'The linearised constraints contradict each other; slack was needed to the end. Relax what '
        'is not met, or start from a guess on another side of it.'
    )
    DIVERGED = (
        'The controls or the cost grow without bound. Bound the controls, or check the sign of the '
        'cost.'
    )
    STALLED = (
        'No step along the search direction lowers the merit function any more. Check the '
        'derivatives (check_derivatives) and whether the functions have kinks.'
    )
    NOT_A_MINIMUM = (
        'The first-order conditions hold, but the cost curves down along the constraints: a '
        'maximum or a saddle. Start from a guess without symmetries.'
    )
    QP_FAILED = (
        'The QP back end found no solution of the subproblem. Try another one (Options.qp), or a '
        'positive weight on every control.'
    )
    NOT_FINITE = (
        'The prediction or its derivatives are not finite numbers. Start from controls along which '
        'they are.'
    )


@dataclass(frozen=True)
class Violation:
    """A path constraint (4) at a stage, or a terminal output (5) at ``N``, that is not met.

    `amount` is positive for a path constraint, of either sign for an output.
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
    """All constraints violated by more than absolute tolerances, the worst first."""
    error, g = evaluation.output_error, evaluation.g
    if (np.abs(error) <= terminal).all() and (g <= path).all():
        return ()
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
        is_minimum: True where the cost was found not to curve down along the active constraints;
            None where this was not judged: the run did not converge, or the problem does not give
            the curvature of its constraints.
        scaling: Units in which it was solved; printed, they are one line.
    """

    iterate: Iterate
    status: Status
    history: tuple[Record, ...]
    terminal_multipliers: Array
    path_multipliers: Array
    bound_multipliers: Array
    violated: tuple[Violation, ...]
    is_minimum: bool | None = None
    scaling: object = None

    @property
    def curvature_lost(self) -> int:
        """Number of iterations whose Hessian had to be shifted to give a unique step."""
        return sum(record.shift > 0.0 for record in self.history)

    @property
    def sentence(self) -> str:
        """Status, number of iterations and violated constraints in words."""
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
        if self.status is Status.CONVERGED and self.is_minimum is None:
            parts.append('Second-order conditions were not judged: no constraint_curvature.')
        if self.curvature_lost:
            parts.append(f'The Hessian had lost curvature in {self.curvature_lost} iterations.')
        return ' '.join(parts)
