"""Stage-wise programs of the size (3, 2), the same ones written out densely, and their solver.

Code is compiled for each size: tests share one.
"""

from dataclasses import fields
from typing import NamedTuple

import numpy as np

from cmpsp_ros.mpsp import Linearisation
from cmpsp_ros.mpsp.qp import Subproblem
from cmpsp_ros.mpsp.qp.active_set import solve
from cmpsp_ros.mpsp.qp.active_set.records import Space, fill, solution_in, space
from cmpsp_ros.mpsp.qp.active_set.solver import TOLERANCE
from cmpsp_ros.mpsp.qp.active_set.state import RowState
from cmpsp_ros.mpsp.qp.riccati import Outcome, kkt
from cmpsp_ros.mpsp.qp.subproblem import Penalties, QPSolution

# A subproblem whose arrays stand side by side.
DERIVATIVES = [field.name for field in fields(Linearisation)]
BESIDE = 'lower', 'upper', 'trust_radius'
StageQP = NamedTuple('StageQP', [(name, np.ndarray) for name in (*DERIVATIVES, *BESIDE)])
STATES, CONTROLS = 3, 2
UNLIMITED = np.iinfo(np.int64).max


def empty(N, m=0, l=0):  # noqa: E741 (the paper's l)
    """All numbers 0 but ``L_UU``, the identity; no limits, and no path row that applies."""
    n, r, K = STATES, CONTROLS, N + 1
    shapes = {'A': (N, n, n), 'B': (N, n, r), 'L_X': (K, n), 'L_U': (K, r), 'L_XX': (K, n, n)}
    shapes |= {'L_UX': (K, r, n), 'output_error': (m,), 'h_X': (m, n), 'h_U': (m, r)}
    shapes |= {'g_X': (K, l, n), 'g_U': (K, l, r)}
    return StageQP(
        L_UU=np.tile(np.eye(r), (K, 1, 1)),
        g=np.full((K, l), -np.inf),
        lower=np.full((K, r), -np.inf),
        upper=np.full((K, r), np.inf),
        trust_radius=np.full(n, np.inf),
        **{name: np.zeros(shape) for name, shape in shapes.items()},
    )


def random_program(rng, N=5, m=2, l=2, bound=np.inf, trust=np.inf):  # noqa: E741
    """A convex program with cross terms, whose path rows are met at 0."""
    n, r, qp = STATES, CONTROLS, empty(N, m, l)
    A = np.eye(n) + rng.normal(size=(N, n, n)) / (2.0 * np.sqrt(n))
    qp.A[:] = A / np.abs(np.linalg.eigvals(A)).max(axis=1)[:, None, None]
    root = rng.normal(size=(N + 1, n + r, n + r)) / 2.0
    weight = root @ root.transpose(0, 2, 1) + 0.2 * np.eye(n + r)
    qp.L_XX[:], qp.L_UX[:] = weight[:, :n, :n], weight[:, n:, :n]
    qp.L_UU[:] = weight[:, n:, n:]
    for name in ('B', 'L_X', 'L_U', 'output_error', 'h_X', 'h_U', 'g_X', 'g_U'):
        array = getattr(qp, name)
        array[:] = rng.normal(size=array.shape)
    qp.g[:] = -rng.uniform(0.1, 1.0, size=qp.g.shape)
    qp.lower[:], qp.upper[:], qp.trust_radius[:] = -bound, bound, trust
    return qp


def chain(N, target=None, l=0, m=1):  # noqa: E741
    """``x <- x + u`` from 0 at the cost ``1/2 |U|^2``, to end at a target if there is one.

    The first state and the first control; the others do nothing.
    """
    qp = empty(N, 0 if target is None else m, l)
    qp.A[:], qp.B[:, 0, 0] = np.eye(STATES), 1.0
    if target is not None:
        qp.h_X[:, 0], qp.output_error[:] = 1.0, -np.asarray(target)
    return qp


def sailing(rng, N, bound=1.0, pull=1.0, l=2, m=2):  # noqa: E741
    """A robot-like program whose wheel limits are active on about half of the stages."""
    qp = empty(N, m, l)
    heading = np.cumsum(rng.normal(size=N)) * 0.3 / np.sqrt(N)
    dt = 10.0 / N
    qp.A[:] = np.eye(3)
    qp.A[:, 0, 2], qp.A[:, 1, 2] = -dt * np.sin(heading), dt * np.cos(heading)
    qp.B[:, 0], qp.B[:, 1] = (
        0.5 * dt * np.cos(heading)[:, None],
        0.5 * dt * np.sin(heading)[:, None],
    )
    qp.B[:, 2] = dt * np.array([1.0, -1.0])
    weight = rng.uniform(0.5, 2.0, size=N + 1)
    qp.L_XX[:, :2, :2] = weight[:, None, None] * np.eye(2) * 10.0 / N
    phase = rng.uniform(0.0, 2.0 * np.pi, size=3)
    wave = np.sin(np.linspace(0.0, 20.0, N + 1)[:, None] + phase)
    qp.L_X[:] = pull * wave * 40.0 / N * [1.0, 1.0, 0.3]
    qp.L_U[:] = rng.normal(size=(N + 1, 2)) * 0.3 * pull
    qp.L_UU[:] = np.eye(2)
    qp.h_X[:] = np.eye(3)[:m]
    qp.output_error[:] = rng.normal(size=m) * 0.3
    qp.lower[:], qp.upper[:] = -bound * rng.uniform(0.5, 1.0, (2, N + 1, 1)) * [[[1.0]], [[-1.0]]]
    direction = rng.uniform(0.0, 2.0 * np.pi, size=(N + 1, l))
    qp.g_X[:, :, 0], qp.g_X[:, :, 1] = np.cos(direction), np.sin(direction)
    qp.g[1:] = -rng.uniform(0.3, 1.5, size=(N, l))
    return qp


def staged(qp):
    """The program as back ends are given it."""
    lin = Linearisation(*qp[: len(DERIVATIVES)])
    return Subproblem(lin, qp.lower, qp.upper, qp.trust_radius)


def relaxed(qp, terminal=5.0, path=5.0):
    return Penalties(np.full(len(qp.output_error), terminal), np.full(qp.g.shape, path))


class Run(NamedTuple):
    """A program on its records, and what the solver made of it."""

    outcome: int
    space: Space
    warm: np.ndarray
    dU: np.ndarray
    dX: np.ndarray
    multipliers: QPSolution

    def __getattr__(self, name):
        """A counter of the head."""
        return int(self.space.program.head[name][0])

    @property
    def conflict(self):
        return set(self.space.active.conflict[: self.conflicting].tolist())


def run(qp, penalties=None, warm=None, begun=0, work_limit=UNLIMITED, mine=None):
    """Solve a program; `warm` is used and left as the solver leaves it."""
    mine = mine or space(staged(qp).size)
    fill(mine, staged(qp), penalties)
    head, stages = mine.program.head, mine.program.stages
    head['begun'], head['work_limit'] = begun, work_limit
    warm = mine.warm if warm is None else warm
    outcome = solve(mine.program, mine.active, warm)
    found = Run(outcome, mine, warm, stages['dU'].copy(), stages['dX'].copy(), solution_in(mine))
    if outcome == Outcome.SOLVED:
        assert kkt.kkt_residual(mine.program) <= TOLERANCE
    return found


def warm_with(qp, rows, states=RowState.ACTIVE):
    """A warm start with these rows."""
    warm = space(staged(qp).size).warm
    warm.head['rows'] = len(rows)
    warm.rows['row'][: len(rows)], warm.rows['state'][: len(rows)] = rows, states
    return warm


def place(qp, kind, k, component, sign=1.0):
    """Number of an inequality, by hand."""
    m, l = len(qp.output_error), qp.g.shape[1]  # noqa: E741
    first = m + k * (l + 2 * CONTROLS + 2 * STATES)
    if kind == 'path':
        return first + component
    first += l + 2 * component + (sign < 0.0)
    return first if kind == 'bound' else first + 2 * CONTROLS


class Dense(NamedTuple):
    """``1/2 dU' H dU + c' dU`` with ``rows dU <= limits``, equal for the first ``m`` rows.

    Attributes:
        H: Shape ``(q, q)``.
        c: Shape ``(q,)``.
        rows: All rows in the order of their numbers, shape ``(rows, q)``.
        limits: Shape ``(rows,)``.
        states: ``dX = states dU``, shape ``(N + 1, n, q)``.
    """

    H: np.ndarray
    c: np.ndarray
    rows: np.ndarray
    limits: np.ndarray
    states: np.ndarray


def dense(qp):
    """The program condensed by matrix products, which share nothing with the sweeps."""
    N, n, r = qp.B.shape
    q = (N + 1) * r
    states, controls = np.zeros((N + 1, n, q)), np.eye(q).reshape(N + 1, r, q)
    for k in range(N):
        states[k + 1] = qp.A[k] @ states[k] + qp.B[k] @ controls[k]
    H, c = np.zeros((q, q)), np.zeros(q)
    rows, limits = [*(qp.h_X @ states[N] + qp.h_U @ controls[N])], [*-qp.output_error]
    for k in range(N + 1):
        x, u = states[k], controls[k]
        cross = u.T @ qp.L_UX[k] @ x
        H += x.T @ qp.L_XX[k] @ x + u.T @ qp.L_UU[k] @ u + cross + cross.T
        c += qp.L_X[k] @ x + qp.L_U[k] @ u
        rows += [*(qp.g_X[k] @ x + qp.g_U[k] @ u)]
        limits += [*-qp.g[k]]
        for unit, upper, lower in zip(u, qp.upper[k], qp.lower[k], strict=True):
            rows += [unit, -unit]
            limits += [upper, -lower]
        for unit, radius in zip(x, qp.trust_radius, strict=True):
            rows += [unit, -unit]
            limits += [radius, radius]
    return Dense(H, c, np.array(rows).reshape(-1, q), np.array(limits), states)


def cost(qp, dU, penalties=None):
    """Cost, and price of what is violated, by one roll-out."""
    program = staged(qp)
    dX = program.propagate(dU)
    total = np.vdot(qp.L_X, dX) + np.vdot(qp.L_U, dU)
    total += 0.5 * np.einsum('ki,kij,kj->', dX, qp.L_XX, dX) + np.einsum(
        'ka,kai,ki->', dU, qp.L_UX, dX
    )
    total += 0.5 * np.einsum('ka,kab,kb->', dU, qp.L_UU, dU)
    if penalties is None:
        return total
    over = np.maximum(program.path(dU, dX), 0.0)
    path = np.where(over > 0.0, penalties.path, 0.0)
    terminal = np.abs(program.terminal(dU, dX))
    return total + _priced(penalties.terminal, terminal) + _priced(path, over)


def _priced(weight, amount):
    """Violations of hard rows are rounding."""
    return np.vdot(np.where(np.isinf(weight), 0.0, weight), amount)
