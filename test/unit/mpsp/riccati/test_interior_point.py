"""The interior point against dense solvers, and what it says of programs without a solution."""

import numpy as np
import pytest
from scipy.optimize import linprog
from stage_programs import (
    Sizes,
    chain,
    dense,
    find,
    hard,
    random_program,
    relaxed,
    sizes_of,
)

from cmpsp_ros.mpsp.jit.watch import compilations
from cmpsp_ros.mpsp.problem import Linearisation
from cmpsp_ros.mpsp.qp import Penalties, QPStatus, solve_qp
from cmpsp_ros.mpsp.riccati.interior_point import solve
from cmpsp_ros.mpsp.riccati.interior_room import CONFLICT, STEPS, interior_room
from cmpsp_ros.mpsp.riccati.outcome import INFEASIBLE, ITERATION_LIMIT, NO_CURVATURE, SOLVED
from cmpsp_ros.mpsp.riccati.residual import kkt_residual
from cmpsp_ros.mpsp.riccati.solver import CAPACITY, TOLERANCE
from cmpsp_ros.mpsp.riccati.stage_qp import propagate
from cmpsp_ros.mpsp.subproblem import Subproblem

# Clarabel's Python package says so when a program is infeasible.
pytestmark = pytest.mark.filterwarnings('ignore:Clarabel.rs terminated')


def solved(qp, penalty, room=None):
    """Outcome and room; what is called solved is checked with memory of the test's own."""
    room = room or interior_room(*sizes_of(qp))
    outcome = solve(qp, penalty, room)
    if outcome == SOLVED:
        dX = np.zeros((len(qp.L_X), qp.state))
        propagate(qp, room.dU, dX)
        scratch = np.zeros((4, qp.state))
        assert kkt_residual(qp, penalty, room.dU, dX, room.multipliers, scratch) <= TOLERANCE
    if outcome == INFEASIBLE:
        assert_contradiction(qp, penalty, room.conflict[: room.counts[CONFLICT]])
    return outcome, room


def assert_contradiction(qp, penalty, numbers):
    """The named rows are hard, and a linear program finds no point that meets them alone."""
    written, m = dense(qp), len(qp.output_error)
    assert len(set(numbers.tolist())) == len(numbers) > 0
    path = (numbers >= m) & ((numbers - m) % _width(qp) < qp.g.shape[1])
    assert (penalty.terminal[numbers[numbers < m]] == np.inf).all()
    stages, which = np.divmod(numbers[path] - m, _width(qp))
    assert (penalty.path[stages, which] == np.inf).all()
    equal, other = numbers[numbers < m], numbers[numbers >= m]
    q = len(written.c)
    answer = linprog(
        np.zeros(q),
        written.rows[other],
        written.limits[other],
        written.rows[equal],
        written.limits[equal],
        bounds=(None, None),
    )
    assert answer.status == 2, answer.message


def _width(qp):
    return qp.g.shape[1] + 2 * qp.control + 2 * qp.state


def by_other(qp, penalty, name):
    """The solution by a back end that condenses; None where it says that there is none."""
    names = Linearisation.__dataclass_fields__
    lin = Linearisation(**{name: getattr(qp, name) for name in names})
    program = Subproblem(lin, qp.lower, qp.upper, qp.trust_radius)
    is_hard = penalty.terminal.min(initial=np.inf) == penalty.path.min(initial=np.inf) == np.inf
    weights = None if is_hard else Penalties(penalty.terminal, penalty.path)
    answer = solve_qp(program, name, weights)
    assert answer.status is not QPStatus.FAILED
    return answer.dU if answer.status is QPStatus.SOLVED else None


def cost(qp, penalty, dU):
    """Cost and price of what is violated."""
    written, m = dense(qp), len(qp.output_error)
    excess = written.rows @ dU.ravel() - written.limits
    path = np.maximum(excess[m:].reshape(len(qp.g), -1)[:, : qp.g.shape[1]], 0.0)
    price = penalty.terminal @ np.abs(excess[:m]) + np.vdot(penalty.path[path > 0], path[path > 0])
    return 0.5 * dU.ravel() @ written.H @ dU.ravel() + written.c @ dU.ravel() + price


def any_program(seed):
    rng = np.random.default_rng(seed)
    sizes = Sizes(
        N=int(rng.integers(1, 25)),
        n=int(rng.integers(1, 6)),
        r=int(rng.integers(1, 4)),
        m=int(rng.integers(0, 3)),
        l=int(rng.integers(0, 5)),
    )
    bound, trust = rng.choice([0.2, 1.0, 5.0]), rng.choice([1.0, 5.0, np.inf])
    qp = random_program(rng, sizes, bound, trust)
    qp.g[rng.random(qp.g.shape) < 0.2] = -np.inf
    qp.g[:] += rng.choice([0.0, 0.3, 1.0])
    assert np.abs(qp.L_UX).min() > 0.0
    return qp


@pytest.mark.parametrize('name', ['daqp', 'clarabel'])
def test_hard_programs_end_as_with_other_solvers(name):
    outcomes = []
    for seed in range(60):
        qp = any_program(seed)
        outcome, room = solved(qp, hard(qp))
        reference = by_other(qp, hard(qp), name)
        assert outcome == (INFEASIBLE if reference is None else SOLVED), seed
        if outcome == SOLVED:
            least = cost(qp, relaxed(qp, 0.0, 0.0), reference)
            ours = cost(qp, relaxed(qp, 0.0, 0.0), room.dU)
            assert ours == pytest.approx(least, rel=1e-5, abs=1e-5)
        outcomes.append(outcome)
    assert min(outcomes.count(SOLVED), outcomes.count(INFEASIBLE)) > 10


@pytest.mark.parametrize('name', ['daqp', 'clarabel'])
@pytest.mark.parametrize('weight', [0.5, 20.0, 1e4])
def test_relaxed_programs_have_other_solvers_cost(name, weight):
    gave = 0
    for seed in range(100, 130):
        qp = any_program(seed)
        penalty = relaxed(qp, weight, 0.7 * weight)
        outcome, room = solved(qp, penalty)
        reference = by_other(qp, penalty, name)
        if reference is None:
            # Bounds and trust region are hard in any case.
            assert outcome == INFEASIBLE
            continue
        assert outcome == SOLVED
        least = cost(qp, penalty, reference)
        assert cost(qp, penalty, room.dU) == pytest.approx(least, rel=1e-6, abs=1e-6)
        gave += np.count_nonzero(room.multipliers.path == 0.7 * weight)
    assert gave > 20


def test_hard_and_relaxed_rows_in_one_program():
    for seed in range(200, 240):
        qp = any_program(seed)
        penalty = relaxed(qp, 30.0, 20.0)
        penalty.terminal[:1], penalty.path[:, 1:2] = np.inf, np.inf
        outcome, room = solved(qp, penalty)
        wanted, other = find(qp, penalty)
        assert outcome == wanted
        if outcome == SOLVED:
            np.testing.assert_allclose(room.dU, other.dU, atol=1e-7)


def test_rows_that_say_the_same_share_their_multiplier():
    for seed in range(300, 330):
        qp = random_program(np.random.default_rng(seed), Sizes(m=2, l=4), bound=1.0)
        for rows in (qp.g, qp.g_X, qp.g_U):
            rows[:, 1] = rows[:, 0]
            rows[:, 2] = 3.0 * rows[:, 0]
        for rows in (qp.output_error, qp.h_X, qp.h_U):
            rows[1] = rows[0]
        outcome, room = solved(qp, relaxed(qp, 1e3, 1e3))
        assert outcome == SOLVED
        reference = by_other(qp, relaxed(qp, 1e3, 1e3), 'clarabel')
        np.testing.assert_allclose(room.dU, reference, atol=2e-5)
        if find(qp)[0] == SOLVED:
            assert solved(qp, hard(qp))[0] == SOLVED


def test_two_inequalities_may_be_an_equality():
    for seed in range(400, 420):
        qp = random_program(np.random.default_rng(seed), Sizes(N=6, m=0, l=3))
        # The first two leave nothing between them, at two stages.
        for stage in (2, 5):
            qp.g_X[stage, 1], qp.g_U[stage, 1] = -qp.g_X[stage, 0], -qp.g_U[stage, 0]
            qp.g[stage, 1] = -qp.g[stage, 0]
        outcome, room = solved(qp, hard(qp))
        assert outcome == SOLVED
        np.testing.assert_allclose(room.dU, by_other(qp, hard(qp), 'daqp'), atol=1e-5)


def test_controls_that_are_fixed():
    for seed in range(500, 520):
        rng = np.random.default_rng(seed)
        qp = random_program(rng, Sizes(N=8, l=2), bound=1.0)
        fixed = rng.random(qp.lower.shape) < 0.4
        qp.lower[fixed] = qp.upper[fixed] = rng.uniform(-1.0, 1.0, size=np.count_nonzero(fixed))
        outcome, room = solved(qp, relaxed(qp))
        assert outcome == SOLVED
        np.testing.assert_allclose(room.dU[fixed], qp.lower[fixed], atol=1e-9)
        reference = by_other(qp, relaxed(qp), 'clarabel')
        np.testing.assert_allclose(room.dU, reference, atol=2e-5)


def test_nothing_left_to_choose():
    qp = random_program(np.random.default_rng(1), bound=0.0)
    qp.lower[:] = qp.upper[:] = 0.1
    outcome, room = solved(qp, relaxed(qp))
    assert outcome == SOLVED
    np.testing.assert_allclose(room.dU, 0.1)
    assert solved(qp, hard(qp))[0] == INFEASIBLE


def test_states_that_may_not_move():
    qp = random_program(np.random.default_rng(2), Sizes(N=6, n=2, r=3, m=0, l=0))
    qp.trust_radius[1] = 0.0
    outcome, room = solved(qp, hard(qp))
    assert outcome == SOLVED
    np.testing.assert_allclose(room.dU, by_other(qp, hard(qp), 'daqp'), atol=1e-6)


def contradictions():
    """One program for each pair of kinds of rows that can contradict each other."""

    def program(bound=np.inf, **arrays):
        qp = random_program(np.random.default_rng(3), Sizes(N=12, m=2, l=2), bound)
        qp.g[:], qp.output_error[:] = -np.inf, 0.0
        return qp._replace(**arrays)

    qp = program()
    qp.g[7], qp.g_X[7, 1], qp.g_U[7] = 0.1, -qp.g_X[7, 0], 0.0
    yield 'two path rows', qp
    qp = program(0.1)
    qp.g[7, 0] = 1e3
    yield 'path row and bounds', qp
    qp = program(0.1)
    qp.output_error[0] = 1e3
    yield 'output and bounds', qp
    qp = program(trust_radius=np.array([0.5, np.inf, np.inf]))
    qp.h_X[0], qp.h_U[0], qp.output_error[0] = [1.0, 0.0, 0.0], 0.0, 1.0
    yield 'output and trust region', qp
    qp = program()
    qp.h_X[1], qp.h_U[1], qp.output_error[:] = qp.h_X[0], qp.h_U[0], [1.0, -1.0]
    yield 'two outputs', qp
    qp = program()
    qp.g[7, 0], qp.g_X[7, 0], qp.g_U[7, 0] = 0.1, 0.0, 0.0
    yield 'a row that nothing moves', qp
    qp = program()
    qp.lower[4, 1], qp.upper[4, 1] = 1.0, -1.0
    yield 'crossed bounds', qp


NAMED = [pytest.param(*each, id=each[0]) for each in contradictions()]


@pytest.mark.parametrize(('name', 'qp'), NAMED)
def test_contradictions_are_named(name, qp):
    outcome, room = solved(qp, hard(qp))
    assert outcome == INFEASIBLE
    if name in ('two path rows', 'two outputs', 'crossed bounds', 'a row that nothing moves'):
        assert room.counts[CONFLICT] == (1 if name == 'a row that nothing moves' else 2)
    outcome, room = solved(qp, relaxed(qp))
    # Bounds stay hard.
    assert outcome == (INFEASIBLE if name == 'crossed bounds' else SOLVED)


def test_more_active_rows_than_the_active_set_has_room_for():
    qp = random_program(np.random.default_rng(4), Sizes(N=230), bound=0.01)
    penalty = relaxed(qp)
    assert find(qp, penalty, limit=10**6)[0] == ITERATION_LIMIT
    outcome, room = solved(qp, penalty)
    assert outcome == SOLVED
    assert np.count_nonzero(room.multipliers.bounds) > CAPACITY
    least = cost(qp, penalty, by_other(qp, penalty, 'clarabel'))
    assert cost(qp, penalty, room.dU) == pytest.approx(least, rel=1e-7)


@pytest.mark.parametrize('N', [1, 2, 10, 50, 200])
def test_the_number_of_steps_hardly_depends_on_the_horizon(N):
    qp = random_program(np.random.default_rng(5), Sizes(N=N), bound=0.5)
    outcome, room = solved(qp, relaxed(qp))
    assert outcome == SOLVED
    assert room.counts[STEPS] < 25
    wanted, other = find(qp, relaxed(qp), limit=10**5)
    assert wanted == SOLVED
    np.testing.assert_allclose(room.dU, other.dU, atol=1e-8)


def test_a_program_without_inequalities_is_no_work():
    for target in (None, 2.0):
        qp = chain(3, target)
        outcome, room = solved(qp, hard(qp))
        assert outcome == SOLVED
        np.testing.assert_allclose(room.dU[:, 0], [(target or 0.0) / 3.0] * 3 + [0.0], atol=1e-12)
        assert room.counts[STEPS] <= 7


def test_a_penalty_of_nothing_gives_a_row_up():
    qp = random_program(np.random.default_rng(6), bound=1.0)
    outcome, room = solved(qp, relaxed(qp, 0.0, 0.0))
    assert outcome == SOLVED
    assert not room.multipliers.path.any()
    assert not room.multipliers.terminal.any()
    free = qp._replace(g=np.full_like(qp.g, -np.inf))
    np.testing.assert_allclose(room.dU, solved(free, relaxed(qp, 0.0, 0.0))[1].dU, atol=1e-8)


@pytest.mark.parametrize('weight', [1e-4, 1e-8])
def test_controls_that_cost_next_to_nothing(weight):
    for seed in range(600, 610):
        qp = random_program(np.random.default_rng(seed), Sizes(N=20), bound=1.0)
        qp.L_UU[:], qp.L_UX[:], qp.L_U[:] = weight * np.eye(2), 0.0, 0.0
        assert solved(qp, relaxed(qp))[0] == SOLVED


def test_no_curvature_is_said():
    qp = random_program(np.random.default_rng(7))
    qp.L_UU[2] -= 100.0 * np.eye(2)
    assert solved(qp, hard(qp))[0] == NO_CURVATURE


def test_data_that_are_no_number_are_never_solved_and_leave_no_trace():
    def program():
        return random_program(np.random.default_rng(0), bound=1.0, trust=2.0)

    room = interior_room(*sizes_of(program()))
    penalty = relaxed(program())
    assert solved(program(), penalty, room)[0] == SOLVED
    fresh = room.dU.copy()
    for name in ('A', 'L_X', 'L_U', 'L_XX', 'L_UX', 'L_UU', 'output_error', 'h_X', 'g', 'g_X'):
        for value in (np.nan, np.inf):
            qp = program()
            getattr(qp, name).flat[-1] = value
            assert solve(qp, penalty, room) != SOLVED, name
    for name in ('lower', 'upper', 'trust_radius'):
        qp = program()
        getattr(qp, name).flat[-1] = np.nan
        assert solve(qp, penalty, room) != SOLVED, name
    assert solved(program(), penalty, room)[0] == SOLVED
    np.testing.assert_array_equal(room.dU, fresh)


def test_one_compilation_serves_all_programs():
    solved(chain(2), hard(chain(2)))
    with compilations() as compiled:
        for _, qp in contradictions():
            solve(qp, hard(qp), interior_room(*sizes_of(qp)))
        qp = any_program(0)
        solve(qp, relaxed(qp), interior_room(*sizes_of(qp)))
    assert compiled == []
