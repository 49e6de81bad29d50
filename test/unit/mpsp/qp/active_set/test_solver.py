"""The active-set method on programs whose answers are known, and on random ones."""

import numpy as np
import pytest
from stage_programs import (
    chain,
    cost,
    dense,
    place,
    random_program,
    relaxed,
    run,
    staged,
    warm_with,
)

from cmpsp_ros.mpsp.qp import QPStatus
from cmpsp_ros.mpsp.qp.active_set.state import RowState
from cmpsp_ros.mpsp.qp.dense import clarabel_backend, solve_by_daqp
from cmpsp_ros.mpsp.qp.riccati import Outcome
from cmpsp_ros.mpsp.qp.riccati.kkt import kkt_residual

# What they call takes long to compile: by one worker.
pytestmark = pytest.mark.xdist_group('riccati')

STATUSES = {Outcome.SOLVED: QPStatus.SOLVED, Outcome.INFEASIBLE: QPStatus.INFEASIBLE}


def controls(qp, penalties=None, warm=None):
    """The first control of each stage."""
    found = run(qp, penalties, warm)
    assert found.outcome == Outcome.SOLVED
    return found.dU[:, 0]


def assert_certifies(qp, rows):
    """Multipliers of the named rows, none negative on an inequality, prove there is no point."""
    written, rows = dense(qp), sorted(rows)
    _, singular, right = np.linalg.svd(written.rows[rows].T)
    every = np.concatenate([singular, np.zeros(len(right) - len(singular))])
    assert every[-1] <= 1e-9 * every[0], 'the rows are independent'
    proof = right[-1]
    proof *= -np.sign(proof @ written.limits[rows])
    assert proof @ written.limits[rows] < -1e-9
    assert (proof[np.array(rows) >= len(qp.output_error)] >= -1e-9).all()


def walled(qp, stage, least):
    """One more thing asked: ``u >= least`` at a stage, by path row 0."""
    qp.g[stage, 0], qp.g_U[stage, 0, 0] = least, -1.0
    return qp


def test_nothing_asked_is_nothing_done():
    qp = chain(3)
    qp.L_U[:] = -2.0
    found = run(qp)
    assert found.outcome == Outcome.SOLVED
    np.testing.assert_allclose(found.dU, 2.0)
    assert found.iterations == 0


def test_each_kind_of_row():
    qp = chain(2, 3.0)
    np.testing.assert_allclose(controls(qp), [1.5, 1.5, 0.0], atol=1e-14)
    np.testing.assert_allclose(run(qp).multipliers.terminal, [-1.5], atol=1e-14)
    qp = chain(3, 3.0)
    qp.upper[0, 0], qp.lower[2, 0] = 0.5, 1.75
    np.testing.assert_allclose(controls(qp), [0.5, 0.75, 1.75, 0.0], atol=1e-14)
    bounds = run(qp).multipliers.bounds[:, 0]
    np.testing.assert_allclose(bounds, [0.25, 0.0, -1.0, 0.0], atol=1e-14)
    qp = chain(4)
    qp.L_U[:, 0], qp.trust_radius[0] = -1.0, 1.5
    np.testing.assert_allclose(controls(qp), [0.375, 0.375, 0.375, 0.375, 1.0], atol=1e-14)
    np.testing.assert_allclose(run(qp).multipliers.trust[:, 0], [0, 0, 0, 0, 0.625], atol=1e-14)
    qp = walled(chain(2, 3.0, 1), 0, 2.0)
    np.testing.assert_allclose(controls(qp), [2.0, 1.0, 0.0], atol=1e-14)
    np.testing.assert_allclose(run(qp).multipliers.path[:, 0], [1.0, 0.0, 0.0], atol=1e-14)


def test_bounds_with_nothing_between_them():
    qp = chain(3, 3.0)
    qp.lower[1, 0] = qp.upper[1, 0] = 2.0
    np.testing.assert_allclose(controls(qp), [0.5, 2.0, 0.5, 0.0], atol=1e-14)
    qp.lower[:, 0] = qp.upper[:, 0] = [2.0, 0.0, 1.0, 0.5]
    np.testing.assert_allclose(controls(qp), [2.0, 0.0, 1.0, 0.5], atol=1e-14)


def test_relaxed_rows_are_violated_at_their_penalty():
    qp = chain(2, 3.0)
    found = run(qp, relaxed(qp, terminal=1.0))
    np.testing.assert_allclose(found.dU[:, 0], [1.0, 1.0, 0.0], atol=1e-14)
    assert (found.saturated, found.active) == (1, 0)
    # Just above its multiplier the row is met, and the penalty of no effect.
    np.testing.assert_allclose(controls(qp, relaxed(qp, terminal=1.6)), [1.5, 1.5, 0.0])
    qp = walled(chain(2, l=1), 0, 2.0)
    for penalty, wanted in ((0.5, 0.5), (2.5, 2.0), (0.0, 0.0)):
        found = controls(qp, relaxed(qp, path=penalty))
        np.testing.assert_allclose(found, [wanted, 0.0, 0.0], atol=1e-14)


@pytest.mark.parametrize('side', [1.0, -1.0])
@pytest.mark.parametrize(
    ('least', 'wanted', 'multiplier'),
    [(0.5, 1.0, -1.0), (1.5, 1.0, -1.0), (2.5, 0.5, -0.5), (3.25, -0.25, 0.25), (5.0, -1.0, 1.0)],
)
def test_a_saturated_output_is_released_and_may_end_at_its_other_penalty(
    side, least, wanted, multiplier
):
    """Alone the output saturates; a row that comes later pushes it back to 3, or beyond."""
    qp = walled(chain(2, 3.0 * side, 1), 0, least)
    qp.g_U[0] *= side
    found = run(qp, relaxed(qp, terminal=1.0, path=np.inf))
    first = max(least, 1.0)
    np.testing.assert_allclose(found.dU[:, 0], [side * first, side * wanted, 0.0], atol=1e-14)
    np.testing.assert_allclose(found.multipliers.terminal, [side * multiplier], atol=1e-14)
    assert found.saturated == int(abs(multiplier) == 1.0)


def test_a_saturated_inequality_is_released():
    """``u_0 >= 2`` is too dear until the output asks for as much in any case."""
    qp = walled(chain(2, 6.0, 1), 0, 2.0)
    warm = warm_with(qp, [place(qp, 'path', 0, 0)], RowState.AT_PENALTY)
    found = controls(qp, relaxed(qp, np.inf, 0.5), warm)
    np.testing.assert_allclose(found, [3.0, 3.0, 0.0], atol=1e-14)


def test_rows_that_others_imply():
    qp = walled(chain(2, [3.0, 3.0], 1, m=2), 0, -9.0)
    found = run(qp)
    np.testing.assert_allclose(found.dU[:, 0], [1.5, 1.5, 0.0], atol=1e-14)
    assert found.implied == 1
    found = run(walled(chain(2, [3.0, 3.1], 1, m=2), 0, -9.0))
    assert found.outcome == Outcome.INFEASIBLE
    assert found.conflict == {0, 1}
    qp = walled(chain(2, [3.0, 3.0], 1, m=2), 0, 6.0)
    for weight, second in ((2.0, -3.0), (1.0, -2.0), (0.25, -0.5)):
        found = controls(qp, relaxed(qp, weight, np.inf))
        np.testing.assert_allclose(found, [6.0, second, 0.0], atol=1e-13)


@pytest.mark.parametrize('weight', [1.0, 1.4, 10.0])
def test_an_output_that_repeats_a_saturated_one_is_met_once(weight):
    """The first one is at its penalty before the second is looked at, and nothing else is."""
    qp = chain(2, [3.0, 3.0], m=2)
    found = run(qp, relaxed(qp, terminal=weight))
    assert found.outcome == Outcome.SOLVED
    np.testing.assert_allclose(found.dU[:, 0], [1.5, 1.5, 0.0], atol=1e-13)
    assert found.multipliers.terminal.sum() == pytest.approx(-1.5)


@pytest.mark.parametrize(('apart', 'proved'), [(0.1, 1), (1e-5, 0)])
def test_rows_almost_alike_contradict_each_other_as_far_as_they_are_alike(apart, proved):
    qp = chain(2, [3.0, 3.0 + apart], 1, m=2)
    qp.h_U[1, 0] = 1e-10
    found = run(qp)
    assert (found.outcome, found.is_proved) == (Outcome.INFEASIBLE, proved)


def test_contradictions_name_their_rows():
    qp = chain(3, 3.0)
    qp.upper[:2, 0] = 0.5
    assert run(qp).outcome == Outcome.SOLVED
    qp.upper[2, 0] = 1.75
    found = run(qp)
    assert found.outcome == Outcome.INFEASIBLE
    assert found.conflict == {0, *(place(qp, 'bound', k, 0) for k in range(3))}
    assert_certifies(qp, found.conflict)
    np.testing.assert_allclose(controls(qp, relaxed(qp)), [0.5, 0.5, 1.75, 0.0], atol=1e-14)
    qp = chain(2)
    qp.lower[1, 0], qp.upper[1, 0] = 1.0, 0.5
    found = run(qp)
    assert found.outcome == Outcome.INFEASIBLE
    assert found.conflict == {place(qp, 'bound', 1, 0), place(qp, 'bound', 1, 0, -1.0)}
    # A row of the first state, which nothing moves, is met or it is not.
    qp = chain(2, 1.0, 1)
    qp.g_X[:, 0, 0], qp.g[0] = 1.0, -0.5
    np.testing.assert_allclose(controls(qp), [0.5, 0.5, 0.0], atol=1e-14)
    qp.g[0] = 0.5
    found = run(qp)
    assert (found.outcome, found.conflict) == (Outcome.INFEASIBLE, {place(qp, 'path', 0, 0)})
    np.testing.assert_allclose(controls(qp, relaxed(qp)), [0.5, 0.5, 0.0], atol=1e-14)


def sorts(seed):
    """A random program: hard, relaxed, or both, with any of its limits."""
    rng = np.random.default_rng(seed)
    bound, trust = rng.choice([0.3, 1.0, 5.0]), rng.choice([1.0, 5.0, np.inf])
    sizes = int(rng.choice([1, 6, 24])), int(rng.integers(0, 3)), int(rng.integers(0, 4))
    qp = random_program(rng, *sizes, bound=bound, trust=trust)
    qp.g[rng.random(qp.g.shape) < 0.2] = -np.inf
    qp.g[:] += rng.choice([0.0, 0.3, 1.0])
    weight = rng.choice([0.3, 5.0, 1e3])
    penalties = relaxed(qp, weight, 2.0 * weight) if rng.random() < 0.7 else None
    if penalties and rng.random() < 0.5:
        penalties.terminal[:1], penalties.path[:, :1] = np.inf, np.inf
    return rng, qp, penalties


@pytest.mark.parametrize('seed', range(40))
def test_random_programs_end_as_with_other_solvers(seed):
    rng, qp, penalties = sorts(seed)
    found, reference = run(qp, penalties), clarabel_backend.solve(staged(qp), penalties)
    assert STATUSES[found.outcome] is reference.status
    if seed % 4 == 0:
        assert solve_by_daqp(staged(qp), penalties).status is reference.status
    # A warm start changes the way: that of a neighbour, and rows at random.
    near = qp._replace(L_X=qp.L_X + 0.2 * rng.normal(size=qp.L_X.shape), g=qp.g - 0.05)
    last = len(dense(qp).limits)
    anything = rng.integers(-5, last + 5, size=min(last, 60))
    # Rows of no program are not looked at.
    anything[:2] = 2**62, -(2**62)
    states = rng.integers(RowState.ACTIVE, RowState.IMPLIED, size=len(anything))
    for warm in (found.warm.copy(), run(near, penalties).warm, warm_with(qp, anything, states)):
        other = run(qp, penalties, warm)
        assert other.outcome == found.outcome
        if found.outcome == Outcome.SOLVED:
            np.testing.assert_allclose(other.dU, found.dU, atol=1e-9)
            np.testing.assert_allclose(
                cost(qp, other.dU, penalties), cost(qp, reference.dU, penalties), atol=1e-7
            )
    if found.outcome == Outcome.INFEASIBLE and penalties is None:
        assert_certifies(qp, found.conflict)


def test_a_proof_goes_along_to_the_next_program():
    qp = chain(8, 3.0)
    qp.upper[:, 0], qp.L_U[:] = 0.3, 0.01
    warm = run(qp).warm
    later = chain(7, 2.8)
    later.upper[:, 0] = 0.3
    found = run(later, None, warm, begun=1)
    assert (found.outcome, found.iterations, found.is_proved) == (Outcome.INFEASIBLE, 0, 1)
    assert found.conflict == {0, *(place(later, 'bound', k, 0) for k in range(7))}
    assert_certifies(later, found.conflict)
    # It proves nothing where the output may be missed, or can be reached.
    weights = relaxed(later, terminal=5.0)
    assert run(later, weights, warm.copy(), begun=1).outcome == Outcome.SOLVED
    later.upper[3, 0] = 1.3
    found = run(later, None, warm, begun=1)
    assert found.outcome == Outcome.SOLVED
    np.testing.assert_allclose(found.dU, run(later).dU, atol=1e-12)


@pytest.mark.parametrize('apart', [3e-8, 3e-9, 3e-10])
def test_rows_almost_parallel_are_met_all(apart):
    for seed in range(30):
        rng = np.random.default_rng(seed)
        qp = random_program(rng, bound=rng.choice([0.5, 2.0, np.inf]))
        qp.g[:] += rng.choice([0.0, 0.3])
        qp.L_U[:] *= 30.0
        twice = {
            name: np.concatenate([rows, rows * (1.0 + apart * rng.normal(size=rows.shape))], axis=1)
            for name, rows in (('g', qp.g), ('g_X', qp.g_X), ('g_U', qp.g_U))
        }
        found = run(qp._replace(**twice))
        assert found.outcome in (Outcome.SOLVED, Outcome.INFEASIBLE)
        if found.outcome == Outcome.SOLVED:
            assert kkt_residual(found.space.program) < 2e-9


@pytest.mark.parametrize('warm', [False, True])
def test_a_limit_of_work(warm):
    qp = random_program(np.random.default_rng(1), 60, bound=0.5, trust=2.0)
    qp.g[:] += 0.3
    penalties = relaxed(qp, 1e3, 1e3)
    whole = run(qp, penalties)
    assert whole.outcome == Outcome.SOLVED
    for fraction in (0.01, 0.1, 0.5):
        limit = int(fraction * whole.work)
        found = run(qp, penalties, whole.warm.copy() if warm else None, work_limit=limit)
        if found.outcome == Outcome.SOLVED:
            assert warm
            continue
        assert found.outcome == Outcome.ITERATION_LIMIT
        assert found.work <= 3 * limit + 20 * 61
    assert run(qp, penalties, work_limit=2 * whole.work).outcome == Outcome.SOLVED


def test_what_has_no_curvature_or_is_not_finite_is_never_solved():
    mine = None
    qp = random_program(np.random.default_rng(0), bound=1.0)
    qp.L_UU[2] -= 100.0 * np.eye(2)
    assert run(qp).outcome == Outcome.NO_CURVATURE
    for name in (*'AB', 'L_X', 'L_U', 'L_XX', 'L_UU', 'output_error', 'h_X', 'g', 'g_X', 'lower'):
        for value in (np.nan, np.inf):
            qp = random_program(np.random.default_rng(0), bound=1.0, trust=2.0)
            getattr(qp, name)[-1] = value
            for penalties in (None, relaxed(qp)):
                found = run(qp, penalties, mine=mine)
                mine = found.space
                assert found.outcome != Outcome.SOLVED, (name, value)
                mine.warm.clear()
    # Nothing of it is left in the memory.
    qp = random_program(np.random.default_rng(0), bound=1.0, trust=2.0)
    used, fresh = run(qp, relaxed(qp), mine=mine), run(qp, relaxed(qp))
    assert used.outcome == Outcome.SOLVED
    np.testing.assert_array_equal(used.dU, fresh.dU)
    np.testing.assert_equal(vars(used.multipliers), vars(fresh.multipliers))


def test_a_saturated_row_may_have_come_to_a_stage_where_it_does_not_apply():
    qp = walled(chain(2, l=1), 1, 2.0)
    found = run(qp, relaxed(qp, path=1.0))
    np.testing.assert_allclose(found.dU[:, 0], [0.0, 1.0, 0.0])
    warm = warm_with(qp, [place(qp, 'path', 2, 0)], RowState.AT_PENALTY)
    found = run(qp, relaxed(qp, path=1.0), warm)
    assert found.outcome == Outcome.SOLVED
    np.testing.assert_array_equal(found.multipliers.path[:, 0], [0.0, 1.0, 0.0])
