"""Back ends against each other."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from programs import (
    contradicting,
    penalties,
    program,
    residual_of,
    solve_rows,
    staged,
    staged_penalties,
    uniform,
)

from cmpsp_ros.mpsp import ProblemError
from cmpsp_ros.mpsp.qp import Penalties, QPStatus, available, backend, solve_qp
from cmpsp_ros.mpsp.qp.dense.back_ends import solve_by_qpsolvers

BACKENDS = available()


def relaxed_cost(qp, dU, weights):
    miss = np.abs(qp.S_N @ dU + qp.output_error)
    violation = np.maximum(qp.B_C @ dU - qp.g, 0.0)
    quadratic = 0.5 * dU @ qp.H @ dU + qp.c @ dU
    return quadratic + weights.terminal @ miss + weights.path @ violation


@pytest.mark.parametrize('name', BACKENDS)
@pytest.mark.parametrize('seed', range(8))
def test_hard_programs_have_one_solution(name, seed):
    qp = program(seed)
    reference, solution = solve_rows(qp, 'daqp'), solve_rows(qp, name)
    assert reference.status is solution.status is QPStatus.SOLVED
    assert residual_of(qp, solution) < 1e-5
    np.testing.assert_allclose(solution.dU, reference.dU, atol=1e-5)
    np.testing.assert_allclose(solution.terminal, reference.terminal, atol=1e-3)
    np.testing.assert_allclose(solution.path, reference.path, atol=1e-3)
    np.testing.assert_allclose(solution.trust, reference.trust, atol=1e-3)
    np.testing.assert_allclose(solution.bounds, reference.bounds, atol=1e-3)


@pytest.mark.parametrize('name', BACKENDS)
@pytest.mark.parametrize('seed', range(8))
def test_relaxed_programs_have_one_solution(name, seed):
    # No room in half of the rows, so that some of them have to give.
    qp = replace(program(seed), g=np.linspace(-2.0, 1.0, 6))
    weights = penalties(qp, 2.0, 3.0)
    reference, solution = solve_rows(qp, 'daqp', weights), solve_rows(qp, name, weights)
    assert reference.status is solution.status is QPStatus.SOLVED
    assert solution.dU.shape == solution.bounds.shape == (4,)
    np.testing.assert_allclose(solution.dU, reference.dU, atol=1e-5)
    np.testing.assert_allclose(solution.path, reference.path, atol=1e-3)
    np.testing.assert_allclose(solution.terminal, reference.terminal, atol=1e-3)


@pytest.mark.parametrize('name', BACKENDS)
@pytest.mark.parametrize('seed', range(5))
def test_infeasible_programs_are_infeasible_and_can_be_relaxed(name, seed):
    qp = contradicting(seed)
    solution = solve_rows(qp, name)
    assert solution.status is QPStatus.INFEASIBLE
    assert not solution.dU.any()
    weights = penalties(qp)
    relaxed, reference = solve_rows(qp, name, weights), solve_rows(qp, 'clarabel', weights)
    assert relaxed.status is reference.status is QPStatus.SOLVED
    best = relaxed_cost(qp, reference.dU, weights)
    assert relaxed_cost(qp, relaxed.dU, weights) == pytest.approx(best, abs=1e-5)
    # The two rows leave a gap of 2 between them, however it is shared.
    violation = (qp.B_C @ relaxed.dU - qp.g)[:2]
    assert violation.sum() == pytest.approx(2.0, abs=1e-5)


@pytest.mark.parametrize('name', BACKENDS)
@pytest.mark.parametrize('seed', range(5))
def test_relaxation_is_exact_above_the_multipliers(name, seed):
    qp = program(seed)
    hard = solve_rows(qp, name)
    above = Penalties(1.01 * np.abs(hard.terminal) + 0.1, 1.01 * hard.path + 0.1)
    np.testing.assert_allclose(solve_rows(qp, name, above).dU, hard.dU, atol=1e-5)
    below = Penalties(0.5 * np.abs(hard.terminal), 1.01 * hard.path + 0.1)
    relaxed = solve_rows(qp, name, below)
    assert np.abs(qp.S_N @ relaxed.dU + qp.output_error).max() > 1e-3


@pytest.mark.parametrize('name', BACKENDS)
@pytest.mark.parametrize('copies', [2, 5])
def test_repeated_rows_change_nothing(name, copies):
    qp = program(2)
    reference = solve_rows(qp, 'daqp')
    assert reference.path.any()
    repeated = replace(
        qp,
        B_C=np.tile(qp.B_C, (copies, 1)),
        g=np.tile(qp.g, copies),
        path_stage=np.arange(copies * 6),
        path_index=np.zeros(copies * 6, dtype=np.int64),
        T=np.tile(qp.T, (2, 1)),
        radius=np.tile(qp.radius, 2),
    )
    solution = solve_rows(repeated, name)
    assert solution.status is QPStatus.SOLVED
    np.testing.assert_allclose(solution.dU, reference.dU, atol=1e-5)
    together = solution.path.reshape(copies, -1).sum(axis=0)
    np.testing.assert_allclose(together, reference.path, atol=1e-3)


@pytest.mark.parametrize('name', BACKENDS)
def test_rows_without_effect_are_met_or_infeasible(name):
    qp = program(1)
    B_C, g = qp.B_C.copy(), qp.g.copy()
    B_C[0] = 0.0
    met = replace(qp, B_C=B_C, g=g)
    assert solve_rows(met, name).status is QPStatus.SOLVED
    g[0] = -1.0
    unmet = replace(met, g=g)
    assert solve_rows(unmet, name).status is QPStatus.INFEASIBLE
    relaxed = solve_rows(unmet, name, penalties(qp))
    assert relaxed.status is QPStatus.SOLVED
    assert relaxed.path[0] == pytest.approx(80.0, abs=1e-3)


@pytest.mark.parametrize('name', BACKENDS)
@pytest.mark.parametrize('sizes', [(0, 0, 0), (2, 0, 0), (0, 6, 0), (0, 0, 3)])
@pytest.mark.parametrize('bound', [2.0, np.inf])
def test_any_kind_of_row_may_be_absent(name, sizes, bound):
    m, p, t = sizes
    qp = program(4, m=m, p=p, t=t, bound=bound)
    solution = solve_rows(qp, name)
    assert solution.status is QPStatus.SOLVED
    np.testing.assert_allclose(solution.dU, solve_rows(qp, 'daqp').dU, atol=1e-5)
    relaxed = solve_rows(qp, name, penalties(qp, 1e3, 1e3))
    np.testing.assert_allclose(relaxed.dU, solution.dU, atol=1e-5)


@pytest.mark.parametrize('name', BACKENDS)
def test_bounds_without_any_room(name):
    qp = program(6, m=0)
    fixed = replace(
        qp,
        lower=np.where(np.arange(4) < 2, 0.0, qp.lower),
        upper=np.where(np.arange(4) < 2, 0.0, qp.upper),
    )
    solution = solve_rows(fixed, name)
    assert solution.status is QPStatus.SOLVED
    np.testing.assert_allclose(solution.dU[:2], 0.0, atol=1e-6)
    crossed = replace(qp, lower=np.full(4, 1.0), upper=np.full(4, -1.0))
    assert solve_rows(crossed, name).status is not QPStatus.SOLVED


@pytest.mark.parametrize('name', BACKENDS)
def test_not_a_number_is_no_solution(name):
    qp = program(7)
    spoilt = replace(qp, c=np.full(4, np.nan))
    assert solve_rows(spoilt, name).status is QPStatus.FAILED


def test_unknown_back_end_names_those_that_are_there():
    wanted = r"qp: found 'newton', wanted one of riccati_active_set, clarabel, daqp"
    with pytest.raises(ProblemError, match=wanted):
        backend('newton')


@pytest.mark.parametrize('name', BACKENDS)
def test_same_program_gives_the_same_bits(name):
    for weights in (None, penalties(program(3))):
        first, second = (solve_rows(program(3), name, weights) for _ in range(2))
        np.testing.assert_array_equal(first.dU, second.dU)
        np.testing.assert_array_equal(first.path, second.path)


def test_program_is_left_as_it_was():
    qp, untouched = staged(program(3)), staged(program(3))
    penalties = staged_penalties(program(3), uniform(program(3), 50.0, 80.0))
    for name in BACKENDS:
        solve_qp(qp, name)
        solve_qp(qp, name, penalties)
    for name, array in vars(untouched.linearisation).items():
        np.testing.assert_array_equal(getattr(qp.linearisation, name), array)
    for name, array in vars(untouched.condensed).items():
        np.testing.assert_array_equal(getattr(qp.condensed, name), array)
    for name in ('lower', 'upper', 'trust_radius'):
        np.testing.assert_array_equal(getattr(qp, name), getattr(untouched, name))


@pytest.mark.parametrize('solver', ['daqp', 'clarabel'])
def test_solvers_of_qpsolvers_agree(solver):
    solve = partial(solve_by_qpsolvers, solver)
    for seed in range(3):
        qp = program(seed)
        for weights in (None, penalties(qp, 2.0, 3.0)):
            found, reference = solve_rows(qp, solve, weights), solve_rows(qp, 'daqp', weights)
            assert found.status is reference.status is QPStatus.SOLVED
            np.testing.assert_allclose(found.dU, reference.dU, atol=1e-5)
            np.testing.assert_allclose(found.path, reference.path, atol=1e-3)
        assert solve_rows(contradicting(seed), solve).status is not QPStatus.SOLVED
