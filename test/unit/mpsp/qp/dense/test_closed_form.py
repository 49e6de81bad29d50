"""The closed form (35) against a QP solver, and the classic MPSP formula as its special case."""

from dataclasses import replace

import numpy as np
import pytest
from problems import LinearQuadratic, VanDerPol
from programs import in_rows, staged

from cmpsp_ros.mpsp import (
    Options,
    QPStatus,
    Status,
    Subproblem,
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
    free = np.full(problem.size.state, np.inf)
    return Subproblem(lin, problem.control_lower - U, problem.control_upper - U, free)


def solve_dense(qp):
    return in_rows(qp, solve_closed_form(staged(qp)))


@pytest.mark.parametrize('seed', range(5))
@pytest.mark.parametrize('output', [0, 1, 3])
def test_it_is_what_a_qp_solver_finds(seed, output):
    subproblem = program(seed, output=output)
    assert has_closed_form(subproblem)
    found, reference = solve_closed_form(subproblem), solve_qp(subproblem, 'daqp')
    assert found.status is QPStatus.SOLVED
    np.testing.assert_allclose(found.dU, reference.dU, atol=1e-8)
    np.testing.assert_allclose(found.terminal, reference.terminal, atol=1e-6)
    for part in (found.path, found.trust, found.bounds):
        assert not part.any()


def test_any_inequality_rules_it_out():
    subproblem = program(2)
    assert has_closed_form(subproblem)
    for name in ('lower', 'upper'):
        bounded = getattr(subproblem, name).copy()
        bounded[3, 1] = 0.0
        assert not has_closed_form(replace(subproblem, **{name: bounded}))
    radius = np.array([np.inf, 1.0, np.inf])
    assert not has_closed_form(replace(subproblem, trust_radius=radius))
    assert not has_closed_form(program(2, path=1))
    never = program(2, path=1)
    g = np.full_like(never.linearisation.g, -np.inf)
    assert has_closed_form(replace(never, linearisation=replace(never.linearisation, g=g)))


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

    def around(X, U):
        return Subproblem(problem.linearise(X, U, 'exact'), -free, free, np.full(2, np.inf))

    subproblem = around(X, U)
    S, dY = subproblem.condensed.S_N, subproblem.condensed.output_error
    R_inverse = np.diag(1.0 / weights[:, 0])
    middle = np.linalg.inv(S @ R_inverse @ S.T)
    classic = -R_inverse @ S.T @ middle @ (dY - S @ U[:, 0]) - U[:, 0]
    np.testing.assert_allclose(solve_closed_form(subproblem).dU[:, 0], classic, atol=1e-7)

    # Around no control at all, the formula in its best-known form.
    subproblem = around(plain.predict(0.0 * U), 0.0 * U)
    S, dY = subproblem.condensed.S_N, subproblem.condensed.output_error
    classic = -R_inverse @ S.T @ np.linalg.inv(S @ R_inverse @ S.T) @ dY
    np.testing.assert_allclose(solve_closed_form(subproblem).dU[:, 0], classic, atol=1e-7)

    found = solve(problem, U, Options(np.full(2, 10.0), np.empty(0), hessian='exact'), 50)
    assert found.status is Status.CONVERGED
    np.testing.assert_allclose(found.iterate.X[-1], [0.3, -0.2], atol=1e-8)


def indefinite(along):
    """Negative curvature along the terminal row's gradient, or across it."""
    qp = program(4, output=1).condensed
    q = len(qp.c)
    H = np.eye(q)
    H[0, 0] = -1.0
    S_N = np.zeros((1, q))
    S_N[0, 0 if along else 1] = 1.0
    return replace(qp, H=H, S_N=S_N)


def test_curvature_is_wanted_along_the_terminal_constraint_alone():
    qp = indefinite(along=True)
    found = solve_dense(qp)
    assert found.status is QPStatus.SOLVED
    assert found.dU[0] == pytest.approx(-qp.output_error[0])
    np.testing.assert_allclose(found.dU[1:], -qp.c[1:])
    assert solve_dense(indefinite(along=False)).status is QPStatus.FAILED


def test_terminal_rows_may_depend_on_each_other():
    qp = program(5, output=2).condensed
    S_N, twice = np.vstack([qp.S_N, qp.S_N[:1]]), np.append(qp.output_error, qp.output_error[0])
    found, plain = (solve_dense(replace(qp, S_N=S_N, output_error=twice)), solve_dense(qp))
    assert found.status is QPStatus.SOLVED
    np.testing.assert_allclose(found.dU, plain.dU, atol=1e-8)
    assert found.terminal[0] == pytest.approx(found.terminal[2])
    twice[2] += 1.0
    unmet = solve_dense(replace(qp, S_N=S_N, output_error=twice))
    assert unmet.status is QPStatus.INFEASIBLE
    assert not unmet.dU.any()


def test_a_row_that_nothing_moves_is_met_or_infeasible():
    qp = program(6, output=1).condensed
    without = replace(qp, S_N=np.zeros_like(qp.S_N))
    assert solve_dense(without).status is QPStatus.INFEASIBLE
    met = replace(without, output_error=np.zeros(1))
    assert solve_dense(met).status is QPStatus.SOLVED


@pytest.mark.parametrize('part', ['H', 'c', 'S_N', 'output_error'])
def test_not_a_number_is_no_solution(part):
    qp = program(7).condensed
    spoilt = getattr(qp, part).copy()
    spoilt.flat[0] = np.nan
    assert solve_dense(replace(qp, **{part: spoilt})).status is QPStatus.FAILED
