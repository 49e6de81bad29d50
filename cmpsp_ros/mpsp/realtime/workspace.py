"""Room for one plan while it is improved; nothing is allocated after it has been made."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cmpsp_ros.mpsp.problem import Array, Dimensions
from cmpsp_ros.mpsp.riccati.solver import Solver, solver
from cmpsp_ros.mpsp.riccati.stage_qp import Penalty, StageQP, empty_qp

Indices = NDArray[np.int64]


class Trajectory(NamedTuple):
    """Controls, the states they lead to, and their value.

    Attributes:
        U: Controls, shape ``(N + 1, r)``.
        X: States, shape ``(N + 1, n)``.
        output_error: ``Y_N - Y_N*``, shape ``(m,)``.
        g: Path constraints, shape ``(N + 1, l)``.
        cost: ``J``, shape ``(1,)``.
    """

    U: Array
    X: Array
    output_error: Array
    g: Array
    cost: Array


class Workspace(NamedTuple):
    """Room for one plan of at most so many steps.

    Attributes:
        qp: The subproblem.
        solver: Its solver.
        at: The present iterate.
        trial: What the line search tries.
        lower: Least controls, shape ``(N + 1, r)``.
        upper: Largest controls, shape ``(N + 1, r)``.
        most: Penalties in force, infinite where a row is hard; see `giving_way`.
        relaxed: Penalties of the relaxation.
        merit: Weights of the merit function, at least the relaxed penalties.
        bend: Second-order correction, shape ``(N + 1, r)``.
        slack: Largest slack of each path constraint and terminal output, shape ``(l + m,)``.
        counts: See `iteration`, shape ``(6,)``.
    """

    qp: StageQP
    solver: Solver
    at: Trajectory
    trial: Trajectory
    lower: Array
    upper: Array
    most: Penalty
    relaxed: Penalty
    merit: Penalty
    bend: Array
    slack: Array
    counts: Indices


def workspace(
    size: Dimensions, penalty_terminal: Array, penalty_path: Array, trust_radius: Array
) -> Workspace:
    """Room for plans of a problem.

    Args:
        size: Its dimensions; the horizon is the longest there will be.
        penalty_terminal: Weight of each terminal output in merit and relaxation, shape ``(m,)``.
        penalty_path: Weight of each path constraint in merit and relaxation, shape ``(l,)``.
        trust_radius: Largest predicted change of each state in one iteration, infinite where
            free, shape ``(n,)``.
    """
    N, n, r, m, l = size.horizon, size.state, size.control, size.output, size.path  # noqa: E741
    qp = empty_qp(N, n, r, m, l)
    qp.trust_radius[:] = trust_radius
    K = N + 1
    relaxed = Penalty(penalty_terminal.copy(), np.tile(penalty_path, (K, 1)))
    return Workspace(
        qp=qp,
        solver=solver(N, n, r, m, l),
        at=_trajectory(size),
        trial=_trajectory(size),
        lower=np.full((K, r), -np.inf),
        upper=np.full((K, r), np.inf),
        most=Penalty(np.full(m, np.inf), np.full((K, l), np.inf)),
        relaxed=relaxed,
        merit=Penalty(relaxed.terminal.copy(), relaxed.path.copy()),
        bend=np.zeros((K, r)),
        slack=np.zeros(l + m),
        counts=np.zeros(6, np.int64),
    )


def _trajectory(size: Dimensions) -> Trajectory:
    K = size.horizon + 1
    return Trajectory(
        np.zeros((K, size.control)),
        np.zeros((K, size.state)),
        np.zeros(size.output),
        np.zeros((K, size.path)),
        np.zeros(1),
    )
