"""Every solver that the qpsolvers package knows, by its name there."""

from __future__ import annotations

import warnings
from dataclasses import replace

import numpy as np
import qpsolvers
from scipy import sparse

from cmpsp_ros.mpsp.condensing import CondensedQP
from cmpsp_ros.mpsp.problem import Array
from cmpsp_ros.mpsp.qp.solution import Penalties, QPSolution, QPStatus

# Solvers that factor the Hessian want it positive definite, slack variables included.
_SLACK_CURVATURE = 1e-6


class QpsolversBackend:
    """Solves condensed programs with one solver of the qpsolvers package."""

    def __init__(self, solver: str) -> None:
        """Take the name of an installed solver."""
        self._solver = solver

    def __call__(self, qp: CondensedQP, penalties: Penalties | None) -> QPSolution:
        """Solve, with slack variables for the relaxed rows where penalties are given."""
        if penalties is None:
            return self._solve(qp)
        q = len(qp.c)
        relaxed = self._solve(_with_slacks(qp, penalties))
        return replace(relaxed, dU=relaxed.dU[:q], bounds=relaxed.bounds[:q])

    def _solve(self, qp: CondensedQP) -> QPSolution:
        problem = qpsolvers.Problem(
            qp.H,
            qp.c,
            np.concatenate([qp.B_C, qp.T, -qp.T]),
            np.concatenate([qp.g, qp.radius, qp.radius]),
            qp.S_N if len(qp.S_N) else None,
            -qp.output_error if len(qp.S_N) else None,
            qp.lower,
            qp.upper,
        )
        if self._solver in qpsolvers.sparse_solvers:
            for name in ('P', 'G', 'A'):
                matrix = getattr(problem, name)
                setattr(problem, name, None if matrix is None else sparse.csc_matrix(matrix))
        with warnings.catch_warnings():
            # Some solvers warn of every program without a solution; that is an answer here.
            warnings.simplefilter('ignore')
            answer = qpsolvers.solve_problem(problem, solver=self._solver)
        if not answer.found or answer.x is None:
            says = str(answer.extras.get('status', '')).lower()
            infeasible = 'infeasible' in says and 'dual' not in says
            return QPSolution.unsolved(qp, QPStatus.INFEASIBLE if infeasible else QPStatus.FAILED)
        p, t = len(qp.g), len(qp.radius)
        path, above, below = np.split(_or_zeros(answer.z, p + 2 * t), [p, p + t])
        return QPSolution(
            QPStatus.SOLVED,
            answer.x,
            _or_zeros(answer.y, len(qp.S_N)),
            path,
            above - below,
            _or_zeros(answer.z_box, len(qp.c)),
        )


def _with_slacks(qp: CondensedQP, penalties: Penalties) -> CondensedQP:
    """The L1 relaxation written out, with slacks ``(miss above, miss below, path)``."""
    m, p, q = len(qp.output_error), len(qp.g), len(qp.c)
    slacks = 2 * m + p
    H = np.zeros((q + slacks, q + slacks))
    H[:q, :q] = qp.H
    H[range(q, q + slacks), range(q, q + slacks)] = _SLACK_CURVATURE
    return replace(
        qp,
        H=H,
        c=np.concatenate([qp.c, penalties.terminal, penalties.terminal, penalties.path]),
        S_N=np.hstack([qp.S_N, -np.eye(m), np.eye(m), np.zeros((m, p))]),
        B_C=np.hstack([qp.B_C, np.zeros((p, 2 * m)), -np.eye(p)]),
        T=np.hstack([qp.T, np.zeros((len(qp.T), slacks))]),
        lower=np.concatenate([qp.lower, np.zeros(slacks)]),
        upper=np.concatenate([qp.upper, np.full(slacks, np.inf)]),
    )


def _or_zeros(multipliers: Array | None, length: int) -> Array:
    if multipliers is None or len(multipliers) != length:
        return np.zeros(length)
    return multipliers
