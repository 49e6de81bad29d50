"""An independent solver: the full nonlinear program, states as variables, by CasADi and IPOPT."""

from dataclasses import dataclass, replace

import casadi
import numpy as np

from cmpsp_ros.mpsp import Options
from cmpsp_ros.mpsp.results import Status
from cmpsp_ros.mpsp.sqp.solve import solve

_QUIET = {
    'print_time': False,
    'ipopt': {
        'print_level': 0,
        'sb': 'yes',
        'tol': 1e-11,
        'constr_viol_tol': 1e-11,
        'compl_inf_tol': 1e-11,
        'dual_inf_tol': 1e-9,
        'bound_relax_factor': 0.0,
        'max_iter': 2000,
    },
}


@dataclass(frozen=True)
class ReferenceSolution:
    """Optimal controls, cost, and multipliers signed as in (63), positive at an upper bound."""

    U: np.ndarray
    cost: float
    terminal: np.ndarray
    path: np.ndarray
    bounds: np.ndarray


def reference_solution(
    guess,
    start,
    *,
    horizon,
    x0,
    x,
    u,
    F,
    L=None,
    residuals=None,
    h=None,
    target=(),
    g=None,
    lower=-np.inf,
    upper=np.inf,
    p=None,
    p_values=None,
):
    """Solve a problem that is stated as for `from_casadi`, from guessed controls and states."""
    column = lambda e: casadi.vertcat(*e) if isinstance(e, (list, tuple)) else e  # noqa: E731
    n, r, N = x.shape[0], u.shape[0], horizon
    p = type(x).sym('p', 0) if p is None else p
    P = np.zeros((N + 1, 0)) if p_values is None else np.reshape(p_values, (N + 1, -1))
    cost = 0 if L is None else L
    if residuals is not None:
        cost = cost + 0.5 * casadi.sumsqr(column(residuals))
    g = type(x)(0, 1) if g is None else column(g)
    h = type(x)(0, 1) if h is None else column(h)
    stage = casadi.Function('stage', [x, u, p], [column(F), cost, g])
    output = casadi.Function('output', [x, u], [h])
    depends = casadi.which_depends(g, u, 1, True) if g.shape[0] else []

    X, U = casadi.SX.sym('X', n, N + 1), casadi.SX.sym('U', r, N + 1)
    total, rows, upper_rows, place = 0, [X[:, 0] - np.asarray(x0, float)], [np.zeros(n)], {}
    count = n
    for k in range(N + 1):
        ahead, value, bound = stage(X[:, k], U[:, k], P[k])
        total += value
        if k < N:
            rows.append(X[:, k + 1] - ahead)
            upper_rows.append(np.zeros(n))
            count += n
        for j in range(g.shape[0]):
            if k or depends[j]:
                place[k, j] = count
                rows.append(bound[j])
                upper_rows.append(np.zeros(1))
                count += 1
    rows.append(output(X[:, N], U[:, N]) - np.asarray(target, float))
    upper_rows.append(np.zeros(h.shape[0]))
    upper_rows = np.concatenate(upper_rows)
    lower_rows = upper_rows.copy()
    lower_rows[list(place.values())] = -np.inf
    free = np.full((N + 1, n), np.inf)
    lbx = np.concatenate([-free.ravel(), np.broadcast_to(lower, (N + 1, r)).ravel()])
    ubx = np.concatenate([free.ravel(), np.broadcast_to(upper, (N + 1, r)).ravel()])
    program = {'x': casadi.vertcat(casadi.vec(X), casadi.vec(U)), 'f': total}
    solver = casadi.nlpsol('reference', 'ipopt', {**program, 'g': casadi.vertcat(*rows)}, _QUIET)
    answer = solver(
        x0=np.concatenate([start.ravel(), guess.ravel()]),
        lbx=lbx, ubx=ubx, lbg=lower_rows, ubg=upper_rows,
    )  # fmt: skip
    assert solver.stats()['success'], solver.stats()['return_status']
    z, lam = answer['x'].full().ravel(), answer['lam_g'].full().ravel()
    path = np.zeros((N + 1, g.shape[0]))
    for where, row in place.items():
        path[where] = lam[row]
    return ReferenceSolution(
        U=z[(N + 1) * n :].reshape(N + 1, r),
        cost=float(answer['f']),
        terminal=lam[count:],
        path=path,
        bounds=answer['lam_x'].full().ravel()[(N + 1) * n :].reshape(N + 1, r),
    )


def options_for(problem, penalty=100.0, **changes):
    """Options that ask for a solution to be compared digit by digit."""
    size = problem.size
    strict = Options(
        np.full(size.output, penalty),
        np.full(size.path, penalty),
        output_tolerance=1e-9,
        control_tolerance=1e-8,
        violation_tolerance=1e-8,
    )
    return replace(strict, **changes)


def assert_agrees(problem, stated, guess, options, iterations=300):
    """Solve, and compare cost, active set and multipliers with the reference's; return the run."""
    solution = solve(problem, guess, options, iterations)
    assert solution.status is Status.CONVERGED, solution.sentence
    at = solution.iterate
    best = reference_solution(guess, problem.predict(guess), **stated)
    assert abs(at.evaluation.cost - best.cost) <= 1e-6 * abs(best.cost)
    pairs = (
        (solution.terminal_multipliers, best.terminal),
        (solution.path_multipliers, best.path),
        (solution.bound_multipliers, best.bounds),
    )
    size = max([1.0, *(np.abs(wanted).max() for _, wanted in pairs if wanted.size)])
    for found, wanted in pairs:
        np.testing.assert_allclose(found, wanted, atol=1e-4 * size)
        # Which are active: where the multiplier is beyond an interior point's remainder.
        np.testing.assert_array_equal(np.abs(found) > 1e-5 * size, np.abs(wanted) > 1e-5 * size)
    return solution
