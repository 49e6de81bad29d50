"""Gradients of a solution by the data of its problem, from the KKT system at the solution."""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.sparse import block_diag, bmat, csc_array
from scipy.sparse.linalg import splu

from cmpsp_ros.arrays import Array, BoolArray
from cmpsp_ros.mpsp.arguments import ProblemError, numbers, vector
from cmpsp_ros.mpsp.models.casadi_functions import CasadiProblem
from cmpsp_ros.mpsp.models.functions import StageProblem
from cmpsp_ros.mpsp.problem import Linearisation
from cmpsp_ros.mpsp.results import Solution, Status
from cmpsp_ros.mpsp.sqp.lagrangian import control_gradient, costates, lagrangian_curvature

# Least multiplier of an active row, relative to the largest costate; step of differences by data.
_ACTIVE, _STEP = 1e-7, 1e-6


class Gradient(NamedTuple):
    """Change per unit of the data: of ``U (N + 1, r)``, of ``X (N + 1, n)`` and of the cost."""

    U: Array
    X: Array
    cost: float


def gradient(
    problem: StageProblem,
    solution: Solution,
    *,
    x0: ArrayLike | None = None,
    target: ArrayLike | None = None,
    p_values: ArrayLike | None = None,
) -> Gradient:
    """Derivative of a solution along a direction of the data.

    Rows that are active stay so: it is the derivative where each of them has a multiplier, else
    that of one side.

    Args:
        problem: The problem that was solved.
        solution: Its solution.
        x0: Direction of the initial state, shape ``(n,)``; None for none.
        target: Direction of the target, shape ``(m,)``.
        p_values: Direction of the data of a problem from CasADi, shape ``(N + 1, size of p)``.

    Raises:
        ProblemError: The run has not converged, or a direction does not fit the problem.
    """
    if solution.status is not Status.CONVERGED:
        raise ProblemError(f'solution: found {solution.status.name}, wanted CONVERGED')
    size, at = problem.size, solution.iterate
    n, r, N = size.state, size.control, size.horizon
    found = lagrangian_curvature(problem, at)
    lin, mu = found.linearisation, found.costates
    start = np.zeros(n) if x0 is None else vector('x0', x0, n)
    moved = _Moved(
        np.zeros((N + 1, n + r)), np.zeros((N, n)), np.zeros(size.output), np.zeros_like(lin.g), 0.0
    )
    if p_values is not None:
        moved = _moved(problem, solution, mu, p_values)
    if target is not None:
        moved = moved._replace(error=moved.error - vector('target', target, size.output))
    active = _ACTIVE * (1.0 + float(np.abs(mu).max()))
    rows, values = _rows(lin, moved, start, solution.path_multipliers > active)
    is_held = np.zeros((N + 1, n + r), bool)
    is_held[:, n:] = np.abs(solution.bound_multipliers) > active
    is_held[:, n:] |= problem.control_lower == problem.control_upper
    free = np.flatnonzero(~is_held.ravel())
    H, E = csc_array(block_diag([*map(csc_array, found.H)]))[free][:, free], rows[:, free]
    # A row twice over, or none of the free unknowns in it, is left to the last term.
    each = np.arange(E.shape[0])
    least = csc_array((np.full(len(each), -1e-12), (each, each)))
    system = bmat([[H, E.T], [E, least]])
    right = np.concatenate([-moved.gradient.ravel()[free], values])
    Z = np.zeros((N + 1) * (n + r))
    Z[free] = splu(csc_array(system)).solve(right)[: len(free)]
    dZ = Z.reshape(N + 1, n + r)
    cost = float(np.vdot(lin.L_X, dZ[:, :n]) + np.vdot(lin.L_U, dZ[:, n:])) + moved.cost
    return Gradient(dZ[:, n:], dZ[:, :n], cost)


class _Moved(NamedTuple):
    """Change of the KKT conditions by the data alone: Lagrangian's gradient, ``F, h, g``, cost."""

    gradient: Array
    F: Array
    error: Array
    g: Array
    cost: float


def _moved(problem: StageProblem, solution: Solution, mu: Array, p_values: ArrayLike) -> _Moved:
    if not isinstance(problem, CasadiProblem):
        raise ProblemError('p_values: found them for a problem that is not from CasADi')
    U, X, direction = solution.iterate.U, solution.iterate.X, numbers('p_values', p_values)
    direction = direction.reshape(len(U), -1)
    if direction.shape != problem.p_values.shape:
        wanted = problem.p_values.shape
        raise ProblemError(f'p_values: found shape {direction.shape}, wanted {wanted}')
    ends = []
    for sign in (1.0, -1.0):
        there = problem.updated(p_values=problem.p_values + sign * _STEP * direction)
        value, ahead = there.evaluate_with_next(X, U)
        lin = there.linearise(X, U)
        weights = solution.terminal_multipliers, solution.path_multipliers
        L_X = costates(lin, *weights)
        # Costates of one stage, with those of the next as they are at the solution.
        L_X[:-1] += np.einsum('kji,kj->ki', lin.A, mu[1:] - L_X[1:])
        g = np.where(value.g == -np.inf, 0.0, value.g)
        by_z = np.hstack([L_X, control_gradient(lin, mu, *weights)])
        ends.append((by_z, ahead, value.output_error, g, value.cost))
    return _Moved(*((a - b) / (2.0 * _STEP) for a, b in zip(*ends, strict=True)))


def _rows(
    lin: Linearisation, moved: _Moved, start: Array, path: BoolArray
) -> tuple[csc_array, Array]:
    """Rows that hold, by all ``(X_k, U_k)``, and their right-hand sides."""
    K, n = len(lin.g), lin.A.shape[1]
    d = n + lin.B.shape[2]
    m, active = len(lin.output_error), np.argwhere(path)
    E = np.zeros((K * n + m + len(active), K, d))
    for k in range(K):
        E[k * n : (k + 1) * n, k, :n] = np.eye(n)
    for k in range(K - 1):
        E[(k + 1) * n : (k + 2) * n, k] = -np.hstack([lin.A[k], lin.B[k]])
    E[K * n : K * n + m, -1] = np.hstack([lin.h_X, lin.h_U])
    for row, (k, j) in enumerate(active, K * n + m):
        E[row, k] = np.concatenate([lin.g_X[k, j], lin.g_U[k, j]])
    values = start, moved.F.ravel(), -moved.error, -moved.g[path]
    return csc_array(E.reshape(len(E), -1)), np.concatenate(values)
