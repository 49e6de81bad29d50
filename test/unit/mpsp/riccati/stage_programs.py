"""Stage-wise programs, the same programs written out densely, and a way to solve them."""

from typing import NamedTuple

import numpy as np

from cmpsp_ros.mpsp.riccati.active_set import find_active_set
from cmpsp_ros.mpsp.riccati.size import dimension, fixed
from cmpsp_ros.mpsp.riccati.solver import solver
from cmpsp_ros.mpsp.riccati.stage_qp import Penalty, empty_qp
from cmpsp_ros.mpsp.riccati.whitening import factorise
from cmpsp_ros.mpsp.riccati.working_set import no_hint

PENALTY, LIMIT = 5.0, 1000


class Sizes(NamedTuple):
    """Dimensions of a program."""

    N: int = 5
    n: int = 3
    r: int = 2
    m: int = 2
    l: int = 2  # noqa: E741 (the paper's l)


def sizes_of(qp):
    N, l = len(qp.A), qp.g.shape[1]  # noqa: E741
    return Sizes(N, dimension(qp.state), dimension(qp.control), len(qp.output_error), l)


def empty(*sizes):
    """A program for code that is told the sizes."""
    N, n, r, m, l = sizes  # noqa: E741
    return empty_qp(N, n, r, m, l)._replace(state=n, control=r)


def for_its_sizes(qp):
    """The same program for code that is compiled for its sizes."""
    return qp._replace(state=fixed(qp.state), control=fixed(qp.control))


def random_program(rng, sizes=None, bound=np.inf, trust=np.inf):
    """A convex program with cross terms, whose path rows have room for 0."""
    N, n, r, *_ = sizes = sizes or Sizes()
    qp = empty(*sizes)
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


def chain(steps, target=None, path=0):
    """``x <- x + u`` from 0 with the cost ``1/2 |U|^2``, to end at a target if there is one."""
    qp = empty(steps, 1, 1, 0 if target is None else 1, path)
    qp.A[:], qp.B[:], qp.L_UU[:] = 1.0, 1.0, 1.0
    if target is not None:
        qp.h_X[:], qp.output_error[:] = 1.0, -target
    return qp


def hard(qp):
    return Penalty(np.full(len(qp.output_error), np.inf), np.full(qp.g.shape, np.inf))


def relaxed(qp, terminal=PENALTY, path=PENALTY):
    return Penalty(np.full(len(qp.output_error), terminal), np.full(qp.g.shape, path))


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
    N, n, r, *_ = sizes_of(qp)
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
        for a in range(r):
            rows += [u[a], -u[a]]
            limits += [qp.upper[k, a], -qp.lower[k, a]]
        for i in range(n):
            rows += [x[i], -x[i]]
            limits += [qp.trust_radius[i]] * 2
    return Dense(H, c, np.array(rows).reshape(-1, q), np.array(limits), states)


def room_for(qp):
    return solver(*sizes_of(qp))


def hint_of(qp, rows=()):
    hint = no_hint(*sizes_of(qp))
    hint.rows[: len(rows)] = rows
    hint.length[0] = len(rows)
    return hint


def find(qp, penalty=None, hint=None, limit=LIMIT, room=None):
    """Run the active-set method; its outcome, and the room with what it found."""
    room = room or room_for(qp)
    assert factorise(qp, room.white)
    outcome = find_active_set(
        qp,
        penalty or hard(qp),
        room.white,
        room.active,
        hint or hint_of(qp),
        room.dU,
        room.dX,
        room.multipliers,
        limit,
    )
    return outcome, room


def signed(qp, multipliers):
    """Multipliers of the dense rows, each pair of limits from its signed one."""
    m = len(qp.output_error)
    parts = [multipliers.terminal]
    for k in range(len(qp.g)):
        parts.append(multipliers.path[k])
        parts += [_both_sides(part[k]) for part in (multipliers.bounds, multipliers.trust)]
    every = np.concatenate(parts)
    assert (every[m:] >= 0.0).all()
    return every


def _both_sides(part):
    return np.column_stack([np.maximum(part, 0.0), np.maximum(-part, 0.0)]).ravel()


def assert_optimal(qp, penalty, room, atol=1e-9):
    """The optimality conditions, by the dense program."""
    written, every = dense(qp), signed(qp, room.multipliers)
    dU, m = room.dU.ravel(), len(qp.output_error)
    size = 1.0 + np.abs(every).max(initial=0.0)
    slope = written.H @ dU + written.c + written.rows.T @ every
    np.testing.assert_allclose(slope, 0.0, atol=atol * size)
    np.testing.assert_allclose(room.dX, written.states @ dU, atol=atol)
    most = np.full(len(every), np.inf)
    most[:m] = penalty.terminal
    N, n, r, _, l = sizes_of(qp)  # noqa: E741
    most[m:].reshape(N + 1, l + 2 * r + 2 * n)[:, :l] = penalty.path
    assert (np.abs(every) <= most).all()
    excess = written.rows @ dU - written.limits
    met = every < most
    assert (excess[m:][met[m:]] <= atol).all()
    np.testing.assert_allclose(excess[:m][np.abs(every[:m]) < most[:m]], 0.0, atol=atol)
    assert (np.sign(every[:m]) * excess[:m] >= -atol).all()
    slack = excess < -atol
    np.testing.assert_array_equal(every[m:][slack[m:]], 0.0)
