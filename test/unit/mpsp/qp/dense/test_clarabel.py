"""Clarabel on the sparse program against dense solvers, and the proofs of infeasibility."""

import numpy as np
import pytest
from scipy.optimize import linprog
from stage_programs import CONTROLS, STATES, chain, cost, dense, random_program, relaxed, staged

from cmpsp_ros.mpsp.qp import QPStatus, Row, kkt_residual, solve_qp
from cmpsp_ros.mpsp.qp.dense import sparse_qp
from cmpsp_ros.mpsp.qp.dense.clarabel_backend import TOLERANCE, contradicting_rows, solve


def solved(qp, penalties=None):
    """The answer; what it claims is checked."""
    program = staged(qp)
    answer = solve(program, penalties)
    if answer.status is QPStatus.SOLVED:
        assert kkt_residual(program, answer, penalties) <= TOLERANCE
        assert answer.conflict == ()
    else:
        assert not answer.dU.any()
    if answer.status is QPStatus.INFEASIBLE:
        assert_contradiction(qp, penalties, answer.conflict)
    return answer


def assert_contradiction(qp, penalties, named):
    """The named rows are hard, and a linear program finds no point that meets them alone."""
    written, m = dense(qp), len(qp.output_error)
    assert len(set(named)) == len(named) > 0
    width, path = qp.g.shape[1] + 2 * CONTROLS + 2 * STATES, qp.g.shape[1]
    equal, other = [], []
    for kind, stage, index in named:
        first = m + stage * width
        if kind == 'terminal':
            assert penalties is None or penalties.terminal[index] == np.inf
            equal.append(index)
        elif kind == 'path':
            assert penalties is None or penalties.path[stage, index] == np.inf
            other.append(first + index)
        else:
            first += path + 2 * index + (2 * CONTROLS if kind == 'trust' else 0)
            other += [row for row in (first, first + 1) if np.isfinite(written.limits[row])]
    # The least largest violation is that of a program that always has a solution.
    rows, limits = written.rows, written.limits
    left = np.vstack([rows[other], rows[equal], -rows[equal]])
    answer = linprog(
        np.eye(left.shape[1] + 1)[-1],
        np.column_stack([left, np.full(len(left), -1.0)]),
        np.concatenate([limits[other], limits[equal], -limits[equal]]),
        bounds=[(None, None)] * left.shape[1] + [(0.0, None)],
    )
    assert answer.status == 0, answer.message
    assert answer.fun > 1e-9


def any_program(seed):
    rng = np.random.default_rng(seed)
    sizes = int(rng.integers(1, 25)), int(rng.integers(0, 3)), int(rng.integers(0, 5))
    bound, trust = rng.choice([0.2, 1.0, 5.0]), rng.choice([1.0, 5.0, np.inf])
    qp = random_program(rng, *sizes, bound, trust)
    qp.g[rng.random(qp.g.shape) < 0.2] = -np.inf
    qp.g[:] += rng.choice([0.0, 0.3, 1.0])
    return qp


@pytest.mark.parametrize('weight', [None, 0.5, 20.0, 1e4])
def test_programs_end_as_with_daqp(weight):
    statuses = []
    for seed in range(60):
        qp = any_program(seed)
        penalties = None if weight is None else relaxed(qp, weight, 0.7 * weight)
        answer, reference = solved(qp, penalties), solve_qp(staged(qp), 'daqp', penalties)
        assert answer.status is reference.status, seed
        statuses.append(answer.status)
        if answer.status is QPStatus.SOLVED:
            ours, least = cost(qp, answer.dU, penalties), cost(qp, reference.dU, penalties)
            assert ours == pytest.approx(least, rel=1e-8, abs=1e-8), seed
            for part in ('terminal', 'path', 'trust', 'bounds'):
                found, wanted = getattr(answer, part), getattr(reference, part)
                scale = 1.0 + np.abs(wanted).max(initial=0.0)
                np.testing.assert_allclose(found / scale, wanted / scale, atol=1e-4)
    if weight is None:
        assert min(map(statuses.count, (QPStatus.SOLVED, QPStatus.INFEASIBLE))) > 10


def test_two_inequalities_may_be_an_equality():
    for seed in range(400, 410):
        qp = random_program(np.random.default_rng(seed), 6, m=0, l=3)
        for stage in (2, 5):
            qp.g_X[stage, 1], qp.g_U[stage, 1] = -qp.g_X[stage, 0], -qp.g_U[stage, 0]
            qp.g[stage, 1] = -qp.g[stage, 0]
        answer = solved(qp)
        assert answer.status is QPStatus.SOLVED
        reference = solve_qp(staged(qp), 'daqp')
        np.testing.assert_allclose(answer.dU, reference.dU, atol=1e-5)


def test_states_that_may_not_move():
    qp = random_program(np.random.default_rng(2), 6, m=0, l=0)
    qp.trust_radius[1] = 0.0
    answer = solved(qp)
    assert answer.status is QPStatus.SOLVED
    np.testing.assert_allclose(answer.dU, solve_qp(staged(qp), 'daqp').dU, atol=1e-6)


def contradictions():
    """One program for each pair of kinds of rows that can contradict each other."""

    def program(bound=np.inf, **arrays):
        qp = random_program(np.random.default_rng(3), 12, bound=bound)
        qp.g[:], qp.output_error[:] = -np.inf, 0.0
        return qp._replace(**arrays)

    qp = program()
    qp.g[7], qp.g_X[7, 1], qp.g_U[7] = 0.1, -qp.g_X[7, 0], 0.0
    yield 'two path rows', qp, [('path', 7, 0), ('path', 7, 1)]
    qp = program(0.1)
    qp.g[7, 0] = 1e3
    yield 'path row and bounds', qp, None
    qp = program(0.1)
    qp.output_error[0] = 1e3
    yield 'output and bounds', qp, None
    qp = program(trust_radius=np.array([0.5, np.inf, np.inf]))
    qp.h_X[0], qp.h_U[0], qp.output_error[0] = [1.0, 0.0, 0.0], 0.0, 1.0
    yield 'output and trust region', qp, [('terminal', 12, 0), ('trust', 12, 0)]
    qp = program()
    qp.h_X[1], qp.h_U[1], qp.output_error[:] = qp.h_X[0], qp.h_U[0], [1.0, -1.0]
    yield 'two outputs', qp, [('terminal', 12, 0), ('terminal', 12, 1)]
    qp = program()
    qp.g[7, 0], qp.g_X[7, 0], qp.g_U[7, 0] = 0.1, 0.0, 0.0
    yield 'a row that nothing moves', qp, [('path', 7, 0)]
    qp = program()
    qp.lower[4, 1], qp.upper[4, 1] = 1.0, -1.0
    yield 'crossed bounds', qp, [('bound', 4, 1)]


NAMED = [pytest.param(*each, id=each[0]) for each in contradictions()]


@pytest.mark.parametrize(('name', 'qp', 'rows'), NAMED)
def test_contradictions_are_named_and_may_be_relaxed(name, qp, rows):
    # Bounds stay hard.
    relaxed_status = QPStatus.INFEASIBLE if name == 'crossed bounds' else QPStatus.SOLVED
    answer = solved(qp)
    assert answer.status is QPStatus.INFEASIBLE
    if rows is not None:
        assert [tuple(row) for row in answer.conflict] == rows
    assert solved(qp, relaxed(qp)).status is relaxed_status
    for other in ('riccati_active_set', 'hildreth'):
        found = solve_qp(staged(qp), other)
        assert found.status is QPStatus.INFEASIBLE, other
        assert not found.dU.any(), other
        assert solve_qp(staged(qp), other, relaxed(qp)).status is relaxed_status, other


def test_a_ray_proves_only_what_the_rows_contradict():
    """``dU_0 + dU_1 + 1 <= 0`` and its opposite, shifted by a gap between them or by an overlap."""
    for overlap in (1e-3, -1e-3):
        qp = chain(2, l=2)
        qp.g[:], qp.g[2] = -np.inf, (1.0, -1.0 + overlap)
        qp.g_X[2, :, 0] = 1.0, -1.0
        program = sparse_qp(staged(qp), None)
        ray = np.zeros(len(program.rows.lower))
        ray[:2] = 7.0
        wanted = (Row('path', 2, 0), Row('path', 2, 1)) if overlap > 0.0 else ()
        assert contradicting_rows(staged(qp), program, ray) == wanted
        # One row alone, a ray that does not cancel, a wrong sign, or rows that may give.
        for spoilt in ([7.0, 0.0], [7.0, 6.9], [-7.0, -7.0], [0.0, 0.0], [np.nan, 7.0]):
            ray[:2] = spoilt
            assert contradicting_rows(staged(qp), program, ray) == ()
        ray[:2] = 7.0
        assert contradicting_rows(staged(qp), sparse_qp(staged(qp), relaxed(qp)), ray) == ()


@pytest.mark.parametrize('N', [1, 2, 10, 50, 200])
def test_the_number_of_iterations_hardly_depends_on_the_horizon(N):
    qp = random_program(np.random.default_rng(5), N, bound=0.5)
    answer = solved(qp, relaxed(qp))
    assert answer.status is QPStatus.SOLVED
    assert answer.iterations < 30


def test_a_row_with_a_penalty_of_0_is_left_out():
    qp = random_program(np.random.default_rng(6), bound=1.0)
    answer = solved(qp, relaxed(qp, 0.0, 0.0))
    assert answer.status is QPStatus.SOLVED
    assert not answer.path.any()
    assert not answer.terminal.any()
    free = qp._replace(g=np.full_like(qp.g, -np.inf))
    np.testing.assert_allclose(answer.dU, solved(free, relaxed(qp, 0.0, 0.0)).dU, atol=1e-8)


@pytest.mark.parametrize('weight', [1e-4, 1e-8])
def test_controls_that_cost_next_to_nothing(weight):
    for seed in range(600, 605):
        qp = random_program(np.random.default_rng(seed), 20, bound=1.0)
        qp.L_UU[:], qp.L_UX[:], qp.L_U[:] = weight * np.eye(2), 0.0, 0.0
        assert solved(qp, relaxed(qp)).status is QPStatus.SOLVED


def test_a_hessian_without_curvature_fails():
    qp = random_program(np.random.default_rng(7))
    qp.L_UU[2] -= 100.0 * np.eye(2)
    assert solved(qp).status is QPStatus.FAILED
    qp = chain(3)
    qp.L_UU[1] = 0.0
    assert solved(qp).status is QPStatus.FAILED


def test_data_that_are_not_finite_fail():
    def program():
        return random_program(np.random.default_rng(0), bound=1.0, trust=2.0)

    penalties = relaxed(program())
    for name in ('A', 'L_X', 'L_U', 'L_XX', 'L_UX', 'L_UU', 'output_error', 'h_X', 'g', 'g_X'):
        for value in (np.nan, np.inf):
            qp = program()
            getattr(qp, name).flat[-1] = value
            assert solve(staged(qp), penalties).status is QPStatus.FAILED, name
    for name in ('lower', 'upper', 'trust_radius'):
        qp = program()
        getattr(qp, name).flat[-1] = np.nan
        assert solve(staged(qp), penalties).status is QPStatus.FAILED, name
    qp = program()
    qp.lower[0, 0] = qp.upper[0, 0] = np.inf
    assert solve(staged(qp), penalties).status is not QPStatus.SOLVED
    assert solve(staged(program()), relaxed(program(), np.nan)).status is QPStatus.FAILED
