"""Every solver that the qpsolvers package knows, by its name there."""

from __future__ import annotations

import warnings
from dataclasses import replace

import numpy as np
import qpsolvers
from numpy.typing import ArrayLike
from scipy import sparse

from cmpsp_ros.mpsp.problem import Array
from cmpsp_ros.mpsp.qp.dense.condensing import CondensedQP
from cmpsp_ros.mpsp.qp.dense.dense import DensePenalties, DenseSolution, gather, scatter
from cmpsp_ros.mpsp.qp.solution import Penalties, QPSolution, QPStatus
from cmpsp_ros.mpsp.qp.subproblem import Subproblem

# Solvers that factor the Hessian want it positive definite, slack variables included.
_SLACK_CURVATURE = 1e-6


class QpsolversBackend:
    """Condenses, and solves with one solver of the qpsolvers package."""

    def __init__(self, solver: str) -> None:
        """Take the name of an installed solver."""
        self._solver = solver

    def __call__(self, subproblem: Subproblem, penalties: Penalties | None) -> QPSolution:
        """Solve, with slack variables for the relaxed rows where penalties are given."""
        qp = subproblem.condensed
        weights = gather(qp, penalties)
        if weights is None:
            return scatter(subproblem, self._solve(qp))
        q = len(qp.c)
        relaxed = self._solve(_with_slacks(qp, weights))
        return scatter(subproblem, relaxed._replace(dU=relaxed.dU[:q], bounds=relaxed.bounds[:q]))

    def _solve(self, qp: CondensedQP) -> DenseSolution:
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
            return DenseSolution.unsolved(
                qp, QPStatus.INFEASIBLE if infeasible else QPStatus.FAILED
            )
        p, t = len(qp.g), len(qp.radius)
        path, above, below = np.split(_or_zeros(answer.z, p + 2 * t), [p, p + t])
        return DenseSolution(
            QPStatus.SOLVED,
            np.array(answer.x, dtype=float),
            _or_zeros(answer.y, len(qp.S_N)),
            path,
            above - below,
            _or_zeros(answer.z_box, len(qp.c)),
        )


def _with_slacks(qp: CondensedQP, penalties: DensePenalties) -> CondensedQP:
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


def _or_zeros(multipliers: ArrayLike | None, length: int) -> Array:
    found = np.zeros(0) if multipliers is None else np.array(multipliers, dtype=float)
    return found if found.shape == (length,) else np.zeros(length)
