"""Programs with many active bounds, which are held inside the factorisation."""

import numpy as np
import pytest
from stage_programs import (
    chain,
    cost,
    place,
    random_program,
    relaxed,
    run,
    sailing,
    staged,
    warm_with,
)

from cmpsp_ros.mpsp.qp import QPStatus, solve
from cmpsp_ros.mpsp.qp.active_set.records import conflict_in, is_positive_definite
from cmpsp_ros.mpsp.qp.active_set.state import CAPACITY
from cmpsp_ros.mpsp.qp.dense import clarabel_backend
from cmpsp_ros.mpsp.qp.riccati import Outcome
from cmpsp_ros.mpsp.qp.subproblem import Penalties

# What they call takes long to compile: by one worker.
pytestmark = pytest.mark.xdist_group('riccati')

STATUSES = {Outcome.SOLVED: QPStatus.SOLVED, Outcome.INFEASIBLE: QPStatus.INFEASIBLE}


def crowded(seed):
    """A long horizon with limits active on most stages, and rows of all other kinds."""
    rng = np.random.default_rng(seed)
    N, bound = int(rng.choice([100, 180, 340])), rng.choice([0.2, 1.0])
    qp = sailing(rng, N, bound, rng.choice([1.0, 3.0]), l=seed % 3, m=int(rng.integers(0, 4)))
    if seed % 2:
        qp.trust_radius[2] = rng.choice([0.5, 1.0])
    qp.output_error[:] *= rng.choice([0.3, 3.0, 40.0])
    qp.g[:] -= rng.choice([0.0, 0.5])
    return rng, qp


def penalties_of(qp, sort):
    if sort == 'hard':
        return None
    penalties = relaxed(qp, 30.0, 20.0)
    if sort == 'both':
        penalties.terminal[:1], penalties.path[:, 1:] = np.inf, np.inf
    return penalties


def assert_names_a_contradiction(qp, found):
    """The rows that are named have no solution even alone."""
    rows = conflict_in(found.space)
    least = Penalties(np.zeros(len(qp.output_error)), np.zeros(qp.g.shape))
    for row in rows:
        if row.kind == 'terminal':
            least.terminal[row.index] = np.inf
        elif row.kind == 'path':
            least.path[row.stage, row.index] = np.inf
    alone = clarabel_backend.solve(staged(qp).only(rows), least)
    assert alone.status is QPStatus.INFEASIBLE


@pytest.mark.parametrize('sort', ['hard', 'relaxed', 'both'])
@pytest.mark.parametrize('seed', range(12))
def test_programs_end_as_with_clarabel(seed, sort):
    rng, qp = crowded(seed)
    penalties = penalties_of(qp, sort)
    found, reference = run(qp, penalties), clarabel_backend.solve(staged(qp), penalties)
    assert STATUSES[found.outcome] is reference.status
    near = qp._replace(
        L_X=qp.L_X + 0.1 * np.abs(qp.L_X).max() * rng.normal(size=qp.L_X.shape),
        L_U=qp.L_U + 0.1 * rng.normal(size=qp.L_U.shape),
    )
    again, other = (
        run(qp, penalties, found.warm.copy()),
        run(qp, penalties, run(near, penalties).warm),
    )
    wrong = warm_with(qp, [place(qp, 'bound', k, 0, (-1.0) ** k) for k in range(len(qp.g))])
    for each in (found, again, other, run(qp, penalties, wrong)):
        assert each.outcome == found.outcome
        if found.outcome == Outcome.INFEASIBLE:
            assert_names_a_contradiction(qp, each)
            continue
        ours, least = cost(qp, each.dU, penalties), cost(qp, reference.dU, penalties)
        assert ours == pytest.approx(least, rel=1e-7, abs=1e-7)
        np.testing.assert_allclose(each.dU, found.dU, atol=1e-8)


@pytest.mark.parametrize('seed', range(6))
def test_a_warm_start_of_the_same_program_is_its_solution(seed):
    """One factorisation and a few sweeps: what is held costs nothing."""
    _, qp = crowded(seed)
    penalties = relaxed(qp, 30.0, 20.0)
    found = run(qp, penalties)
    again = run(qp, penalties, found.warm.copy())
    # Outputs at their penalty are found there anew.
    assert again.iterations <= found.active + found.saturated + len(qp.output_error)
    assert again.work < (20 + 4 * (found.active + found.saturated)) * len(qp.g)


@pytest.mark.parametrize('sort', ['hard', 'relaxed'])
def test_work_grows_with_the_horizon_and_not_with_its_square(sort):
    work = {}
    for N in (50, 400):
        each = []
        for seed in range(5):
            qp = sailing(np.random.default_rng(seed), N, bound=0.5, pull=2.0, l=0)
            found = run(qp, penalties_of(qp, sort))
            assert found.outcome == Outcome.SOLVED
            active = np.count_nonzero(found.multipliers.bounds)
            assert active > 0.5 * N
            assert found.iterations < 40 + active / 8
            each.append(found.work)
        work[N] = np.mean(each)
    assert work[400] < 12 * work[50]


def test_a_goal_within_and_out_of_reach():
    """The whole way at full speed is 20; what is beyond contradicts all bounds that push."""
    for target, outcome in (
        (19.9, Outcome.SOLVED),
        (20.0, Outcome.SOLVED),
        (20.1, Outcome.INFEASIBLE),
    ):
        qp = chain(200, target)
        qp.lower[:, 0], qp.upper[:, 0] = -0.1, 0.1
        # Pushes away from the goal at first: all bounds of a first guess are wrong.
        qp.L_U[:, 0] = 1.0
        for warm in (None, warm_with(qp, [place(qp, 'bound', k, 0, -1.0) for k in range(200)])):
            found = run(qp, warm=warm)
            assert found.outcome == outcome
            if outcome == Outcome.SOLVED:
                assert found.dU[:200, 0].sum() == pytest.approx(target, abs=1e-9)
            else:
                wanted = {0, *(place(qp, 'bound', k, 0) for k in range(200))}
                assert found.conflict == wanted
            assert found.work < 2500 * 201


def test_held_bounds_that_rows_push_inward_are_released():
    """All controls are held at 1; a path row half way wants the sum of the first 100 to be 20."""
    qp = chain(200, l=1)
    qp.L_U[:, 0], qp.lower[:, 0], qp.upper[:, 0] = -5.0, -1.0, 1.0
    qp.g_X[100, 0, 0], qp.g[100, 0] = 1.0, -20.0
    found = run(qp)
    assert found.outcome == Outcome.SOLVED
    np.testing.assert_allclose(found.dU[:100, 0], 0.2, atol=1e-10)
    np.testing.assert_allclose(found.dU[100:, 0], 1.0, atol=1e-12)
    assert found.multipliers.path[100, 0] == pytest.approx(4.8)
    # The same as an equation.
    qp.g_X[100, 0, 0], qp.g[100, 0] = 0.0, -np.inf
    qp = qp._replace(output_error=np.array([-20.0]), h_X=np.eye(1, 3), h_U=np.zeros((1, 2)))
    found = run(qp)
    assert found.outcome == Outcome.SOLVED
    np.testing.assert_allclose(found.dU[:200, 0], 0.1, atol=1e-10)


def test_crossed_bounds_among_many_that_are_held():
    qp = random_program(np.random.default_rng(0), 60, bound=0.05)
    qp.g[:] = -np.inf
    qp.lower[30, 1], qp.upper[30, 1] = 0.2, 0.1
    found = run(qp, relaxed(qp))
    assert found.outcome == Outcome.INFEASIBLE
    assert found.conflict <= {place(qp, 'bound', 30, 1, sign) for sign in (1.0, -1.0)}


def test_limits_that_are_equal_on_all_stages():
    qp = random_program(np.random.default_rng(1), 80, l=0, bound=0.3)
    qp.lower[::2] = qp.upper[::2] = 0.1
    for penalties in (relaxed(qp), None):
        found, reference = run(qp, penalties), clarabel_backend.solve(staged(qp), penalties)
        assert STATUSES[found.outcome] is reference.status
        if found.outcome == Outcome.SOLVED:
            np.testing.assert_allclose(found.dU[::2], 0.1, atol=1e-12)
            np.testing.assert_allclose(found.dU, reference.dU, atol=1e-6)


def test_nothing_stays_held_in_memory_that_is_borrowed_again():
    """A look at the Hessian's curvature comes between two programs, the second without bounds."""
    first = sailing(np.random.default_rng(0), 60, 0.2, 2.0, l=0)
    other = sailing(np.random.default_rng(1), 60, 0.5, 2.0, l=0)
    other.lower[:30], other.upper[:30] = -np.inf, np.inf
    assert solve(staged(first), None).status is QPStatus.SOLVED
    assert is_positive_definite(staged(first))
    solution = solve(staged(other), None)
    np.testing.assert_allclose(solution.dU, run(other).dU, atol=1e-10)


def test_bounds_that_fill_the_basis_are_let_go():
    qp = random_program(np.random.default_rng(20), 340, bound=0.5)
    found = run(qp)
    assert (found.outcome, found.fixed) == (Outcome.SOLVED, 0)
    assert 200 < found.active < CAPACITY


@pytest.mark.parametrize('seed', [1, 4, 6])
def test_bounds_among_many_violated_path_rows_are_not_held(seed):
    """The basis, which these rows make large, would be made again with each guess."""
    found = run(random_program(np.random.default_rng(seed), 60, bound=0.5, l=4, m=1))
    assert (found.outcome, found.fixed) == (Outcome.SOLVED, 0)
    assert np.count_nonzero(found.multipliers.bounds) > 15
    assert found.iterations < 2 * found.active
