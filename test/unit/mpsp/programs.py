"""Any dense quadratic program as a subproblem, and the answers to it row by row."""

from dataclasses import replace

import numpy as np

from cmpsp_ros.mpsp import Linearisation
from cmpsp_ros.mpsp.qp import Penalties, QPSolution, Subproblem, kkt_residual, solve_qp
from cmpsp_ros.mpsp.qp.dense import CondensedQP


def staged(qp):
    """A subproblem of one step whose condensed program is ``qp`` and a control that does nothing.

    The control of stage 0 is all of ``dU``, and the state of stage 1 holds what its trust region
    and its outputs are rows of. The control of stage 1 costs ``1/2 |dU_1|^2`` and stays at 0.
    """
    q, m, p, t = len(qp.c), len(qp.output_error), len(qp.g), len(qp.radius)
    n = max(1, t + m)
    moved = np.zeros((1, n, q))
    moved[0, : t + m] = np.vstack([qp.T, qp.S_N])
    h_X = np.zeros((m, n))
    h_X[range(m), range(t, t + m)] = 1.0
    free, none = np.full((1, q), np.inf), np.zeros((1, q))
    return Subproblem(
        Linearisation(
            A=np.zeros((1, n, n)),
            B=moved,
            L_X=np.zeros((2, n)),
            L_U=np.vstack([qp.c, none]),
            L_XX=np.zeros((2, n, n)),
            L_UX=np.zeros((2, q, n)),
            L_UU=np.array([qp.H, np.eye(q)]),
            output_error=qp.output_error,
            h_X=h_X,
            h_U=np.zeros((m, q)),
            g=np.vstack([-qp.g, np.full(p, -np.inf)]),
            g_X=np.zeros((2, p, n)),
            g_U=np.array([qp.B_C, np.zeros((p, q))]),
        ),
        np.vstack([qp.lower, -free]),
        np.vstack([qp.upper, free]),
        np.concatenate([qp.radius, np.full(n - t, np.inf)]),
    )


def staged_penalties(qp, penalties):
    if penalties is None:
        return None
    return Penalties(penalties.terminal, np.vstack([penalties.path, np.zeros(len(qp.g))]))


def in_rows(qp, solution):
    """A solution of ``staged(qp)`` row by row."""
    assert not (np.abs(solution.dU[1]) > 1e-6).any()
    return replace(
        solution,
        dU=solution.dU[0],
        path=solution.path[0],
        trust=solution.trust[1, : len(qp.radius)],
        bounds=solution.bounds[0],
    )


def in_stages(qp, solution):
    """The inverse of `in_rows`."""
    whole = QPSolution.unsolved(staged(qp).size, solution.status)
    whole.dU[0], whole.path[0], whole.bounds[0] = solution.dU, solution.path, solution.bounds
    whole.trust[1, : len(qp.radius)] = solution.trust
    return replace(whole, terminal=solution.terminal)


def uniform(qp, terminal, path):
    """The same weight for all terminal rows, and for all path rows."""
    return Penalties(np.full(len(qp.output_error), terminal), np.full(len(qp.g), path))


def solve_rows(qp, solver, penalties=None):
    """Solve a dense program with a back end, by its name, or unchecked by its function."""
    given = staged(qp), staged_penalties(qp, penalties)
    if isinstance(solver, str):
        return in_rows(qp, solve_qp(given[0], solver, given[1]))
    return in_rows(qp, solver(*given))


def residual_of(qp, solution, penalties=None):
    """The check that no solver has a part in, of an answer row by row."""
    return kkt_residual(staged(qp), in_stages(qp, solution), staged_penalties(qp, penalties))


def program(seed=0, q=4, m=1, p=6, t=3, bound=2.0, slack=1.0):
    """A random program with 0 feasible in its inequalities where ``slack`` is positive.

    Stages have up to 8 states and 4 controls, for which the warm-up compiles the solver.
    """
    rng = np.random.default_rng(seed)
    root = rng.normal(size=(q, q))
    return CondensedQP(
        H=root @ root.T + 0.1 * np.eye(q),
        c=3.0 * rng.normal(size=q),
        S_N=rng.normal(size=(m, q)),
        output_error=0.3 * rng.normal(size=m),
        B_C=rng.normal(size=(p, q)),
        g=slack * rng.uniform(0.1, 1.0, size=p),
        path_stage=np.arange(p),
        path_index=np.zeros(p, dtype=np.int64),
        T=rng.normal(size=(t, q)),
        radius=np.full(t, 1.5),
        lower=np.full(q, -bound),
        upper=np.full(q, bound),
    )


def contradicting(seed=0):
    """The first two path rows want ``a dU <= -1`` and ``a dU >= 1``."""
    qp = program(seed)
    B_C, g = qp.B_C.copy(), qp.g.copy()
    B_C[1] = -B_C[0]
    g[:2] = -1.0
    return replace(qp, B_C=B_C, g=g)


def penalties(qp, terminal=50.0, path=80.0):
    return uniform(qp, terminal, path)
