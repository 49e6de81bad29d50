"""Memory of an iteration; nothing is allocated after it has been made."""

from enum import IntEnum
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cmpsp_ros.arrays import Array
from cmpsp_ros.mpsp.problem import Dimensions
from cmpsp_ros.mpsp.qp.riccati.program import Program, Records, empty_program


class Phase(IntEnum):
    """Point at which the iteration goes on."""

    START = 0
    EVALUATED = 1
    LINEARISED = 2
    QP_ANSWERED = 3
    SEARCHING = 4
    CORRECTED = 5
    FULL_STEP = 6


class Request(IntEnum):
    """Next request of the iteration, as `iteration.advance` returns it."""

    DONE = 0
    EVALUATE = 1
    LINEARISE = 2
    SOLVE_QP = 3
    ADD_CURVATURE = 4
    CORRECT = 5


class Search(IntEnum):
    """Kind of the present trial of the line search."""

    FIRST = 0
    BACKTRACKING = 1
    BEST = 2
    LAST_RESORT = 3


_INTEGERS = (
    # Options.
    'max_iterations', 'line_search', 'elastic',
    # State.
    'phase', 'search', 'asked_for_curvature', 'is_corrected', 'best_is_corrected', 'level',
    'is_hard',
    # What came of it.
    'iterations', 'outcome', 'active_rows',
)  # fmt: skip
_NUMBERS = (
    # Options.
    'output_tolerance', 'control_tolerance', 'violation_tolerance', 'slack_tolerance',
    'growth_limit',
    # State.
    'cost_limit', 'control_limit', 'predicted', 'before', 'scale', 'longest', 'trying', 'best',
    'best_length',
    # What came of it; the costs of the iterate and of the trial.
    'cost', 'trial_cost', 'length', 'full_change',
)  # fmt: skip

# Options, state and results of an iteration, one record.
RUN: Final = np.dtype(
    [(name, np.int64) for name in _INTEGERS] + [(name, np.float64) for name in _NUMBERS]
)


class Trajectory(NamedTuple):
    """``U (N + 1, r)``, ``X (N + 1, n)``, ``Y_N - Y_N* (m,)`` and (4) ``(N + 1, l)``."""

    U: Array
    X: Array
    output_error: Array
    g: Array


class Workspace(NamedTuple):
    """Memory for one plan of at most ``N`` steps.

    `run` is of type `RUN`; the head of `program` has the horizon; `now` is the iterate, and `trial`
    that of the line search, on entry the guess. Controls lie between `lower` and `upper` ``(N +
    1, r)``; `slack` is the largest of each path constraint and terminal output ``(l + m,)``.
    """

    run: Records
    program: Program
    now: Trajectory
    trial: Trajectory
    lower: Array
    upper: Array
    slack: Array


def workspace(
    size: Dimensions, penalty_terminal: Array, penalty_path: Array, trust_radius: Array
) -> Workspace:
    """Memory for plans of a problem, with the options that C-MPSP has by default.

    The horizon is the longest there will be. Weights in merit and relaxation are ``(m,)`` and
    ``(l,)``; the trust region is the largest predicted change of each state in one iteration,
    infinite where free, ``(n,)``.
    """
    sizes = size.horizon, size.state, size.control, size.output, size.path
    program = empty_program(*sizes)
    set_weights(program, penalty_terminal, penalty_path, trust_radius)
    run: NDArray[Any] = np.zeros(1, RUN)
    run['line_search'] = run['elastic'] = 1
    controls = (size.horizon + 1, size.control)
    return Workspace(
        run=run,
        program=program,
        now=_trajectory(size),
        trial=_trajectory(size),
        lower=np.full(controls, -np.inf),
        upper=np.full(controls, np.inf),
        slack=np.zeros(size.path + size.output),
    )


def set_weights(
    program: Program, penalty_terminal: Array, penalty_path: Array, trust_radius: Array
) -> None:
    """Set weights and trust region as of `workspace`."""
    program.terminal['weight'] = penalty_terminal
    program.path['weight'] = penalty_path
    program.head['trust_radius'][0, : len(trust_radius)] = trust_radius


def _trajectory(size: Dimensions) -> Trajectory:
    K = size.horizon + 1
    return Trajectory(
        np.zeros((K, size.control)),
        np.zeros((K, size.state)),
        np.zeros(size.output),
        np.zeros((K, size.path)),
    )
