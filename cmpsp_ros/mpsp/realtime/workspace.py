"""Room for one plan while it is improved; nothing is allocated after it has been made."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cmpsp_ros.mpsp.compiled import allocation_free
from cmpsp_ros.mpsp.problem import Array, Dimensions
from cmpsp_ros.mpsp.riccati.active_set import ActiveSet, shift_hint
from cmpsp_ros.mpsp.riccati.rows import rows_a_stage
from cmpsp_ros.mpsp.riccati.size import dimension
from cmpsp_ros.mpsp.riccati.solver import Solver, solver
from cmpsp_ros.mpsp.riccati.stage_qp import Multipliers, Penalty, StageQP, empty_qp
from cmpsp_ros.mpsp.riccati.whitening import Whitening

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
        hard: Penalties that keep every row hard.
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
    hard: Penalty
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
        hard=Penalty(np.full(m, np.inf), np.full((K, l), np.inf)),
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


def forget_hints(room: Workspace) -> None:
    """Begin the next subproblem with no active rows."""
    room.solver.hint_hard.count[0] = 0
    room.solver.hint_relaxed.count[0] = 0


@allocation_free
def shift_hints(room: Workspace, stages: int, N: int) -> None:
    """Move the active rows to a horizon of ``N`` steps that begins so many stages later."""
    terminal, width = room.qp.output_error.shape[0], rows_a_stage(room.qp)
    last = terminal + (N + 1) * width
    shift_hint(room.solver.hint_hard, terminal, stages * width, last)
    shift_hint(room.solver.hint_relaxed, terminal, stages * width, last)


@allocation_free
def shortened(room: Workspace, N: int) -> Workspace:
    """The same room for a horizon of ``N`` steps."""
    K, r = N + 1, dimension(room.qp.control)
    q = K * r
    white, active, multipliers = room.solver.white, room.solver.active, room.solver.multipliers
    rows = active.states.shape[0] - (room.lower.shape[0] - K) * (
        room.qp.g.shape[1] + 2 * r + 2 * dimension(room.qp.state)
    )
    solver = Solver(
        Whitening(
            white.optimum[:q],
            white.K[:K],
            white.L_inv[:K],
            white.A_cl[:N],
            white.B_cl[:N],
            white.covariance[:K],
            white.P,
            white.p,
            white.PA,
            white.PB,
            white.G,
            white.L,
            white.s,
            white.t,
            white.d,
        ),
        ActiveSet(
            active.counts,
            active.v[:q],
            active.basis,
            active.rows,
            active.multipliers,
            active.states[:rows],
            active.lengths[:rows],
            active.conflict,
            active.row[:q],
            active.inside,
            active.outside[:q],
            active.dependence,
        ),
        room.solver.hint_hard,
        room.solver.hint_relaxed,
        room.solver.dU[:K],
        room.solver.dX[:K],
        Multipliers(
            multipliers.terminal,
            multipliers.path[:K],
            multipliers.trust[:K],
            multipliers.bounds[:K],
        ),
        room.solver.deviation[:K],
        room.solver.costates,
    )
    return Workspace(
        StageQP(
            room.qp.state,
            room.qp.control,
            room.qp.A[:N],
            room.qp.B[:N],
            room.qp.L_X[:K],
            room.qp.L_U[:K],
            room.qp.L_XX[:K],
            room.qp.L_UX[:K],
            room.qp.L_UU[:K],
            room.qp.output_error,
            room.qp.h_X,
            room.qp.h_U,
            room.qp.g[:K],
            room.qp.g_X[:K],
            room.qp.g_U[:K],
            room.qp.lower[:K],
            room.qp.upper[:K],
            room.qp.trust_radius,
        ),
        solver,
        _shortened(room.at, K),
        _shortened(room.trial, K),
        room.lower[:K],
        room.upper[:K],
        Penalty(room.hard.terminal, room.hard.path[:K]),
        Penalty(room.relaxed.terminal, room.relaxed.path[:K]),
        Penalty(room.merit.terminal, room.merit.path[:K]),
        room.bend[:K],
        room.slack,
        room.counts,
    )


@allocation_free
def _shortened(of: Trajectory, K: int) -> Trajectory:
    return Trajectory(of.U[:K], of.X[:K], of.output_error, of.g[:K], of.cost)
