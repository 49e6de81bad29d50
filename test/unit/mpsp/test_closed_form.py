"""The closed form (35) against a QP solver, and the classic MPSP formula as its special case."""

import time
from dataclasses import replace

import numpy as np
import pytest
from problems import LinearQuadratic, VanDerPol

from cmpsp_ros.mpsp import (
    Options,
    QPStatus,
    Status,
    condense,
    from_functions,
    has_closed_form,
    solve,
    solve_closed_form,
    solve_qp,
)


def program(seed=0, **sizes):
    rng = np.random.default_rng(seed)
    problem = LinearQuadratic(rng, **{'path': 0} | sizes)
    U = rng.normal(size=(problem.size.horizon + 1, problem.size.control))
    lin = problem.linearise(problem.predict(U), U)
    return condense(lin, problem.control_lower - U, problem.control_upper - U)


@pytest.mark.parametrize('seed', range(5))
@pytest.mark.parametrize('output', [0, 1, 3])
def test_it_is_what_a_qp_solver_finds(seed, output):
    qp = program(seed, output=output)
    assert has_closed_form(qp)
    found, reference = solve_closed_form(qp), solve_qp(qp, 'daqp')
    assert found.status is QPStatus.SOLVED
    np.testing.assert_allclose(found.dU, reference.dU, atol=1e-8)
    np.testing.assert_allclose(found.terminal, reference.terminal, atol=1e-6)
    for part in (found.path, found.trust, found.bounds):
        assert not part.any()


def test_it_satisfies_equation_35():
    qp = program(1)
    found = solve_closed_form(qp)
    np.testing.assert_allclose(qp.H @ found.dU + qp.S_N.T @ found.terminal, -qp.c, atol=1e-10)
    np.testing.assert_allclose(qp.S_N @ found.dU, -qp.output_error, atol=1e-10)


def test_any_inequality_rules_it_out():
    qp = program(2)
    q = len(qp.c)
    for bound in (qp.lower, qp.upper):
        bounded = bound.copy()
        bounded[3] = 0.0
        name = 'lower' if bound is qp.lower else 'upper'
        assert not has_closed_form(replace(qp, **{name: bounded}))
    assert not has_closed_form(replace(qp, B_C=np.zeros((1, q)), g=np.ones(1)))
    assert not has_closed_form(replace(qp, T=np.zeros((1, q)), radius=np.ones(1)))


def test_with_a_control_cost_alone_it_is_the_classic_mpsp():
    """Padhi and Kothari (2009): ``dU = -R^-1 S' (S R^-1 S')^-1 (dY - S R^-1 R U) - U``.

    They minimise ``1/2 (U + dU)' R (U + dU)`` under ``S dU = -dY``, with no other constraint.
    """
    rng = np.random.default_rng(3)
    weights = rng.uniform(0.5, 3.0, size=(16, 1))
    plain = VanDerPol(horizon=15)
    problem = from_functions(
        horizon=15,
        x0=[1.0, 0.5],
        controls=1,
        F=lambda k, x, u: [
            x[0] + 0.1 * x[1],
            x[1] + 0.1 * ((1.0 - x[0] ** 2) * x[1] - x[0] + u[0]),
        ],
        L=lambda k, x, u: 0.5 * weights[k, 0] * u[0] ** 2,
        h=lambda x, u: x,
        target=[0.3, -0.2],
    )
    U = 0.4 * rng.normal(size=(16, 1))
    X = plain.predict(U)
    free = np.full((16, 1), np.inf)
    qp = condense(problem.linearise(X, U, 'exact'), -free, free)
    S, R_inverse, dY = qp.S_N, np.diag(1.0 / weights[:, 0]), qp.output_error
    middle = np.linalg.inv(S @ R_inverse @ S.T)
    classic = -R_inverse @ S.T @ middle @ (dY - S @ U[:, 0]) - U[:, 0]
    np.testing.assert_allclose(solve_closed_form(qp).dU, classic, atol=1e-7)

    # Around no control at all, the formula in its best-known form.
    qp = condense(problem.linearise(plain.predict(0.0 * U), 0.0 * U, 'exact'), -free, free)
    S, dY = qp.S_N, qp.output_error
    classic = -R_inverse @ S.T @ np.linalg.inv(S @ R_inverse @ S.T) @ dY
    np.testing.assert_allclose(solve_closed_form(qp).dU, classic, atol=1e-7)

    found = solve(problem, U, Options(np.full(2, 10.0), np.empty(0), hessian='exact'), 50)
    assert found.status is Status.CONVERGED
    np.testing.assert_allclose(found.iterate.X[-1], [0.3, -0.2], atol=1e-8)


def indefinite(along):
    """Negative curvature along the terminal row's gradient, or across it."""
    qp = program(4, output=1)
    q = len(qp.c)
    H = np.eye(q)
    H[0, 0] = -1.0
    S_N = np.zeros((1, q))
    S_N[0, 0 if along else 1] = 1.0
    return replace(qp, H=H, S_N=S_N)


def test_curvature_is_wanted_along_the_terminal_constraint_alone():
    qp = indefinite(along=True)
    found = solve_closed_form(qp)
    assert found.status is QPStatus.SOLVED
    assert found.dU[0] == pytest.approx(-qp.output_error[0])
    np.testing.assert_allclose(found.dU[1:], -qp.c[1:])
    assert solve_closed_form(indefinite(along=False)).status is QPStatus.FAILED


def test_terminal_rows_may_depend_on_each_other():
    qp = program(5, output=2)
    S_N, twice = np.vstack([qp.S_N, qp.S_N[:1]]), np.append(qp.output_error, qp.output_error[0])
    found, plain = (
        solve_closed_form(replace(qp, S_N=S_N, output_error=twice)),
        solve_closed_form(qp),
    )
    assert found.status is QPStatus.SOLVED
    np.testing.assert_allclose(found.dU, plain.dU, atol=1e-8)
    assert found.terminal[0] == pytest.approx(found.terminal[2])
    twice[2] += 1.0
    unmet = solve_closed_form(replace(qp, S_N=S_N, output_error=twice))
    assert unmet.status is QPStatus.INFEASIBLE
    assert not unmet.dU.any()


def test_a_row_that_nothing_moves_is_met_or_infeasible():
    qp = program(6, output=1)
    without = replace(qp, S_N=np.zeros_like(qp.S_N))
    assert solve_closed_form(without).status is QPStatus.INFEASIBLE
    met = replace(without, output_error=np.zeros(1))
    assert solve_closed_form(met).status is QPStatus.SOLVED


@pytest.mark.parametrize('part', ['H', 'c', 'S_N', 'output_error'])
def test_not_a_number_is_no_solution(part):
    qp = program(7)
    spoilt = getattr(qp, part).copy()
    spoilt.flat[0] = np.nan
    assert solve_closed_form(replace(qp, **{part: spoilt})).status is QPStatus.FAILED


def test_a_step_of_the_papers_size_takes_less_than_a_millisecond():
    rng = np.random.default_rng(8)
    problem = LinearQuadratic(rng, horizon=50, state=3, control=2, output=2, path=0)
    problem.A = np.eye(3) + 0.05 * rng.normal(size=(50, 3, 3))
    U = np.zeros((51, 2))
    lin = problem.linearise(problem.predict(U), U)
    times = []
    for _ in range(50):
        begun = time.perf_counter()
        solution = solve_closed_form(condense(lin, problem.control_lower, problem.control_upper))
        times.append(time.perf_counter() - begun)
        assert solution.status is QPStatus.SOLVED
    # The best of many: what the others took, the machine took for something else.
    assert min(times) < 1e-3
