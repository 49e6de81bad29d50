"""Second derivatives of the Lagrangian, and directions along which it curves down."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from cmpsp_ros.arrays import Array, BoolArray
from cmpsp_ros.mpsp.jit import allocation_free
from cmpsp_ros.mpsp.problem import Linearisation, OptimalControlProblem
from cmpsp_ros.mpsp.qp.active_set.records import is_positive_definite
from cmpsp_ros.mpsp.qp.dense.condensing import condense
from cmpsp_ros.mpsp.qp.subproblem import Subproblem
from cmpsp_ros.mpsp.results import Iterate

# Relative sizes: a multiplier or a distance that counts as 0, and a curvature that does.
_ACTIVE = 1e-6
_CURVATURE = 1e-7
# Weight of rows that hold, relative to the Hessian, where curvature along them is looked for.
_HELD = 1e4


class Curvature(NamedTuple):
    """Derivatives at an iterate, and the Hessian of its Lagrangian."""

    linearisation: Linearisation  # derivatives, with the exact Hessian of the cost
    costates: Array  # multipliers of the dynamics, as `costates`
    H: Array  # blocks by ``(X_k, U_k)``, shape ``(N + 1, n + r, n + r)``


def costates(lin: Linearisation, terminal: Array, path: Array) -> Array:
    """Multipliers of the dynamics (1), for which the Lagrangian is stationary in the states.

    The gradient of the cost to go by ``X_k``, shape ``(N + 1, n)``, from ``lambda (m,)`` and
    ``rho (N + 1, l)``.
    """
    found: Array = lin.L_X.copy()
    if path.size:
        found += np.einsum('kli,kl->ki', lin.g_X, np.where(lin.g == -np.inf, 0.0, path))
    found[-1] += lin.h_X.T @ terminal
    _backward(np.ascontiguousarray(lin.A), found)
    return found


def control_gradient(lin: Linearisation, costates: Array, terminal: Array, path: Array) -> Array:
    """Gradient of the Lagrangian by the controls, ``(N + 1, r)``, without multipliers of bounds."""
    found: Array = lin.L_U + np.einsum('kla,kl->ka', lin.g_U, np.where(lin.g == -np.inf, 0.0, path))
    found[:-1] += np.einsum('kja,kj->ka', lin.B, costates[1:])
    found[-1] += lin.h_U.T @ terminal
    return found


@allocation_free
def _backward(A: Array, costates: Array) -> None:
    for k in range(A.shape[0] - 1, -1, -1):
        for i in range(A.shape[1]):
            for j in range(A.shape[2]):
                costates[k, j] += A[k, i, j] * costates[k + 1, i]


def lagrangian_curvature(
    problem: OptimalControlProblem, at: Iterate, lin: Linearisation | None = None
) -> Curvature:
    """Hessian blocks of the Lagrangian at an iterate, with its latest multipliers.

    Raises:
        ProblemError: The problem does not give the curvature of its constraints.
    """
    if lin is None:
        lin = problem.linearise(at.X, at.U, 'exact')
    terminal, path, _ = at.multipliers_on(lin)
    mu = costates(lin, terminal, path)
    XX, UX, UU = problem.constraint_curvature(at.X, at.U, mu[1:], terminal, path)
    return Curvature(lin, mu, stage_blocks(lin.L_XX + XX, lin.L_UX + UX, lin.L_UU + UU))


def stage_blocks(XX: Array, UX: Array, UU: Array) -> Array:
    """Blocks by ``X``, ``UX`` and ``U`` as one by ``(X_k, U_k)``."""
    n = XX.shape[1]
    joint: Array = np.empty((len(XX), n + UU.shape[1], n + UU.shape[1]))
    joint[:, :n, :n], joint[:, n:, n:], joint[:, n:, :n] = XX, UU, UX
    joint[:, :n, n:] = UX.swapaxes(1, 2)
    return joint


def with_hessian(lin: Linearisation, H: Array) -> Linearisation:
    """A linearisation with other Hessian blocks by ``(X_k, U_k)``."""
    n = lin.A.shape[1]
    return replace(lin, L_XX=H[:, :n, :n], L_UX=H[:, n:, :n], L_UU=H[:, n:, n:])


def _with_rows(found: Curvature, path: BoolArray, bounds: BoolArray, weight: float) -> Array:
    """Hessian with ``weight |row|^2`` for terminal, path and bound rows that hold.

    The masks are ``(N + 1, l)`` and ``(N + 1, r)``. Along the rows nothing changes; a Hessian that
    is positive there becomes positive everywhere, if the weight is large enough.
    """
    lin, H = found.linearisation, found.H.copy()
    h_Z = np.hstack([lin.h_X, lin.h_U])
    H[-1] += weight * h_Z.T @ h_Z
    if path.any():
        g_Z = np.where(path[:, :, None], np.concatenate([lin.g_X, lin.g_U], axis=2), 0.0)
        H += weight * g_Z.swapaxes(1, 2) @ g_Z
    np.einsum('kaa->ka', H)[:, lin.A.shape[1] :] += weight * bounds
    return H


def descent_curvature(
    problem: OptimalControlProblem, at: Iterate, lin: Linearisation | None = None
) -> Array | None:
    """Direction along which the cost falls by curvature alone; None at a minimum.

    A direction ``(N + 1, r)`` of length 1 that keeps the active constraints and along which the
    Hessian of the Lagrangian is negative: the iterate, at which the first-order conditions hold, is
    a saddle or a maximum. One Riccati sweep at a minimum, else eigenvalues of the condensed one.
    `lin` has the exact Hessian of the cost.

    Raises:
        ProblemError: The problem does not give the curvature of its constraints.
    """
    found = lagrangian_curvature(problem, at, lin)
    lin, size = found.linearisation, problem.size
    _, rho, beta = at.multipliers_on(lin)
    scale = _ACTIVE * (1.0 + float(np.abs(found.costates).max()))
    size_H = float(np.abs(found.H).max())
    lower, upper = problem.control_lower - at.U, problem.control_upper - at.U
    is_bound = (np.abs(beta) > scale) | (lower == upper)
    held = with_hessian(lin, _with_rows(found, rho > scale, is_bound, _HELD * size_H))
    free = np.full(size.state, np.inf)
    if is_positive_definite(Subproblem(held, lower, upper, free), _CURVATURE * size_H):
        return None
    qp = condense(with_hessian(lin, found.H), lower, upper)
    tight = -qp.g > -_ACTIVE
    strong = tight & (rho[qp.path_stage, qp.path_index] > scale)
    unit = np.eye(len(qp.c))
    weak = np.concatenate([
        qp.B_C[tight & ~strong],
        unit[(qp.upper <= _ACTIVE) & ~is_bound.ravel()],
        -unit[(-qp.lower <= _ACTIVE) & ~is_bound.ravel()],
    ])  # fmt: skip
    rows = np.concatenate([qp.S_N, qp.B_C[strong], unit[is_bound.ravel()]])
    for constraints in (rows, np.concatenate([rows, weak])):
        direction = _most_negative(qp.H, constraints)
        if direction is None:
            return None
        for sign in (1.0, -1.0):
            if (weak @ (sign * direction) <= _ACTIVE).all():
                return sign * direction.reshape(at.U.shape)
    return None


def _most_negative(H: Array, rows: Array) -> Array | None:
    """Unit vector of the least eigenvalue of ``H`` along ``rows d = 0``; None if not negative."""
    length = np.linalg.norm(rows, axis=1, keepdims=True)
    _, values, right = np.linalg.svd(rows / np.where(length > 0.0, length, 1.0))
    Z = right[int(np.count_nonzero(values > 1e-10 * values.max(initial=0.0))) :].T
    if not Z.shape[1]:
        return None
    eigenvalues, vectors = np.linalg.eigh(Z.T @ H @ Z)
    if eigenvalues[0] >= -_CURVATURE * np.abs(H).max():
        return None
    found: Array = Z @ vectors[:, 0]
    # Eigenvectors have no sign of their own.
    return found * np.sign(found[np.abs(found).argmax()])
