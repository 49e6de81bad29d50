"""The active-set method on programs whose answers are known."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from stage_programs import (
    LIMIT,
    Sizes,
    assert_optimal,
    chain,
    dense,
    find,
    hard,
    hint_of,
    random_program,
    relaxed,
    room_for,
    sizes_of,
)

from cmpsp_ros.mpsp.riccati.active_set import find_active_set
from cmpsp_ros.mpsp.riccati.outcome import INFEASIBLE, ITERATION_LIMIT, SOLVED
from cmpsp_ros.mpsp.riccati.rows import BOUND, PATH, count_rows, number_of
from cmpsp_ros.mpsp.riccati.whitening import factorise
from cmpsp_ros.mpsp.riccati.working_set import (
    ACTIVE,
    CONFLICT,
    IMPLIED,
    ITERATIONS,
    PROVED,
    SATURATED,
    active_set,
)

# What they call takes long to compile: by one worker.
pytestmark = pytest.mark.xdist_group('riccati')

unhurried = settings(deadline=None, max_examples=80)


def controls(qp, penalty=None, hint=None):
    outcome, room = find(qp, penalty, hint)
    assert outcome == SOLVED
    assert_optimal(qp, penalty or hard(qp), room)
    return room.dU[:, 0]


def conflict(room):
    return set(room.active.conflict[: room.active.counts[CONFLICT]].tolist())


def assert_certifies(qp, rows):
    """Multipliers of the named rows, none negative on an inequality, prove there is no point."""
    written, rows = dense(qp), sorted(rows)
    _, singular, right = np.linalg.svd(written.rows[rows].T)
    every = np.concatenate([singular, np.zeros(len(right) - len(singular))])
    assert every[-1] <= 1e-9 * every[0], 'the rows are independent'
    proof = right[-1]
    proof *= -np.sign(proof @ written.limits[rows])
    assert proof @ written.limits[rows] < -1e-9
    inequalities = np.array(rows) >= len(qp.output_error)
    assert (proof[inequalities] >= -1e-9).all()


def walled(qp, stage, least):
    """One more thing asked: ``u >= least`` at a stage, by path row 0."""
    qp.g[:, 0] = -np.inf
    qp.g[stage, 0], qp.g_U[stage, 0] = least, -1.0
    return qp


def test_nothing_asked_is_nothing_done():
    qp = chain(3)
    qp.L_U[:] = -2.0
    outcome, room = find(qp)
    assert outcome == SOLVED
    np.testing.assert_allclose(room.dU, 2.0)
    assert room.active.counts[ITERATIONS] == 0


def test_terminal_row():
    qp = chain(2, 3.0)
    np.testing.assert_allclose(controls(qp), [1.5, 1.5, 0.0], atol=1e-14)
    _, room = find(qp)
    np.testing.assert_allclose(room.multipliers.terminal, [-1.5], atol=1e-14)


def test_bounds():
    qp = chain(3, 3.0)
    qp.upper[0], qp.lower[2] = 0.5, 1.75
    np.testing.assert_allclose(controls(qp), [0.5, 0.75, 1.75, 0.0], atol=1e-14)
    _, room = find(qp)
    np.testing.assert_allclose(room.multipliers.bounds[:, 0], [0.25, 0.0, -1.0, 0.0], atol=1e-14)


def test_bounds_without_room_between_them():
    qp = chain(3, 3.0)
    qp.lower[1] = qp.upper[1] = 2.0
    np.testing.assert_allclose(controls(qp), [0.5, 2.0, 0.5, 0.0], atol=1e-14)
    qp.lower[:] = qp.upper[:] = [[2.0], [0.0], [1.0], [0.5]]
    np.testing.assert_allclose(controls(qp), [2.0, 0.0, 1.0, 0.5], atol=1e-14)


def test_trust_region():
    qp = chain(4)
    qp.L_U[:] = -1.0
    qp.trust_radius[:] = 1.5
    np.testing.assert_allclose(controls(qp), [0.375, 0.375, 0.375, 0.375, 1.0], atol=1e-14)
    _, room = find(qp)
    np.testing.assert_allclose(room.multipliers.trust[:, 0], [0, 0, 0, 0, 0.625], atol=1e-14)


def test_path_row():
    qp = walled(chain(2, 3.0, path=1), 0, 2.0)
    np.testing.assert_allclose(controls(qp), [2.0, 1.0, 0.0], atol=1e-14)
    _, room = find(qp)
    np.testing.assert_allclose(room.multipliers.path[:, 0], [1.0, 0.0, 0.0], atol=1e-14)


def test_relaxed_rows_give_way_at_their_penalty():
    qp = chain(2, 3.0)
    np.testing.assert_allclose(controls(qp, relaxed(qp, terminal=1.0)), [1.0, 1.0, 0.0], atol=1e-14)
    _, room = find(qp, relaxed(qp, terminal=1.0))
    assert room.active.counts[SATURATED] == 1
    assert room.active.counts[ACTIVE] == 0
    # Just above its multiplier the row is met, and the penalty of no effect.
    np.testing.assert_allclose(controls(qp, relaxed(qp, terminal=1.6)), [1.5, 1.5, 0.0])
    walled(qp := chain(2, path=1), 0, 2.0)
    np.testing.assert_allclose(controls(qp, relaxed(qp, path=0.5)), [0.5, 0.0, 0.0], atol=1e-14)
    np.testing.assert_allclose(controls(qp, relaxed(qp, path=2.5)), [2.0, 0.0, 0.0], atol=1e-14)
    np.testing.assert_allclose(controls(qp, relaxed(qp, path=0.0)), [0.0, 0.0, 0.0], atol=1e-14)


@pytest.mark.parametrize('side', [1.0, -1.0])
@pytest.mark.parametrize(
    ('least', 'wanted', 'multiplier'),
    [(0.5, 1.0, -1.0), (1.5, 1.0, -1.0), (2.5, 0.5, -0.5), (3.25, -0.25, 0.25), (5.0, -1.0, 1.0)],
)
def test_a_saturated_output_is_released_and_may_end_at_its_other_penalty(
    side, least, wanted, multiplier
):
    """Alone the output saturates; a row that comes later pushes it back to 3, or beyond."""
    qp = walled(chain(2, 3.0 * side, path=1), 0, least)
    qp.g_U[0] *= side
    first = max(least, 1.0)
    penalty = relaxed(qp, terminal=1.0, path=np.inf)
    np.testing.assert_allclose(
        controls(qp, penalty), [side * first, side * wanted, 0.0], atol=1e-14
    )
    _, room = find(qp, penalty)
    np.testing.assert_allclose(room.multipliers.terminal, [side * multiplier], atol=1e-14)
    assert room.active.counts[SATURATED] == int(abs(multiplier) == 1.0)


def test_a_saturated_inequality_is_released():
    """``u_0 >= 2`` is too dear until the output asks for as much in any case."""
    qp = walled(chain(2, 6.0, path=1), 0, 2.0)
    hint = hint_of(qp, [-1 - number_of(qp, PATH, 0, 0)])
    np.testing.assert_allclose(
        controls(qp, relaxed(qp, np.inf, 0.5), hint), [3.0, 3.0, 0.0], atol=1e-14
    )


@pytest.mark.parametrize('seed', [0, 2, 3, 4, 5])
def test_repeated_rows_change_nothing(seed):
    once = random_program(np.random.default_rng(seed), Sizes(m=1), bound=1.0)
    once.g[:] += 0.2
    repeated = {
        name: np.concatenate([getattr(once, name)] * 3, axis=1) for name in ('g', 'g_X', 'g_U')
    }
    thrice = once._replace(**repeated)
    one, three = find(once), find(thrice)
    assert one[0] == three[0] == SOLVED
    np.testing.assert_allclose(three[1].dU, one[1].dU, atol=1e-10)
    together = three[1].multipliers.path.reshape(6, 3, 2).sum(axis=1)
    np.testing.assert_allclose(together, one[1].multipliers.path, atol=1e-8)
    assert one[1].multipliers.path.any()
    # Penalties of the same violation add up.
    one = find(once, relaxed(once, 3.0, 0.3))
    three = find(thrice, relaxed(thrice, 3.0, 0.1))
    assert one[0] == three[0] == SOLVED
    assert one[1].active.counts[SATURATED] > 0
    np.testing.assert_allclose(three[1].dU, one[1].dU, atol=1e-10)


def doubled(target, other):
    """The same terminal output twice, with two targets."""
    both = {'h_X': np.ones((2, 1)), 'h_U': np.zeros((2, 1))}
    return chain(2, target, path=1)._replace(output_error=-np.array([target, other]), **both)


def test_rows_that_others_imply():
    qp = walled(doubled(3.0, 3.0), 0, -9.0)
    np.testing.assert_allclose(controls(qp), [1.5, 1.5, 0.0], atol=1e-14)
    _, room = find(qp)
    assert room.active.counts[IMPLIED] == 1
    outcome, room = find(walled(doubled(3.0, 3.1), 0, -9.0))
    assert outcome == INFEASIBLE
    assert conflict(room) == {0, 1}


@pytest.mark.parametrize(('weight', 'second'), [(2.0, -3.0), (1.0, -2.0), (0.25, -0.5)])
def test_outputs_that_repeat_each_other_share_their_penalties(weight, second):
    qp = walled(doubled(3.0, 3.0), 0, 6.0)
    penalty = relaxed(qp, weight, np.inf)
    np.testing.assert_allclose(controls(qp, penalty), [6.0, second, 0.0], atol=1e-13)


def test_a_row_that_is_implied_no_longer():
    """The upper bound is implied, but for rounding, until the lower one leaves."""
    qp = chain(2, path=1)
    qp.lower[0], qp.upper[0] = 1.0 + 1e-9, 1.0
    qp.g[:, 0], qp.g_X[2] = [-np.inf, -np.inf, 6.0], -1.0
    upper = number_of(qp, BOUND, 0, 0)
    outcome, room = find(qp, hint=hint_of(qp, [upper + 1, upper]))
    assert outcome == SOLVED
    np.testing.assert_allclose(room.dU[:, 0], [1.0, 5.0, 0.0], atol=1e-8)
    assert room.multipliers.bounds[0, 0] > 0.0


def test_no_point_for_the_rows_that_are_named():
    qp = chain(3, 3.0)
    qp.upper[:2] = 0.5
    assert find(qp)[0] == SOLVED
    qp.upper[2] = 1.75
    outcome, room = find(qp)
    assert outcome == INFEASIBLE
    assert conflict(room) == {0, *(number_of(qp, BOUND, k, 0) for k in range(3))}
    assert_certifies(qp, conflict(room))
    outcome, relaxation = find(qp, relaxed(qp))
    assert outcome == SOLVED
    np.testing.assert_allclose(relaxation.dU[:, 0], [0.5, 0.5, 1.75, 0.0], atol=1e-14)


@pytest.mark.parametrize(('apart', 'proved'), [(0.1, 1), (1e-5, 0)])
def test_rows_almost_alike_contradict_each_other_as_far_as_they_are_alike(apart, proved):
    qp = walled(doubled(3.0, 3.0 + apart), 0, -9.0)
    qp.h_U[1] = 1e-10
    outcome, room = find(qp)
    assert outcome == INFEASIBLE
    assert room.active.counts[PROVED] == proved


def test_a_control_that_is_asked_to_be_on_both_sides():
    qp = chain(2)
    qp.lower[1], qp.upper[1] = 1.0, 0.5
    outcome, room = find(qp)
    assert outcome == INFEASIBLE
    assert conflict(room) == {number_of(qp, BOUND, 1, 0), number_of(qp, BOUND, 1, 0) + 1}


def test_a_row_without_effect():
    """Where the first state is known a row of it is met or it is not."""
    qp = chain(2, 1.0, path=1)
    qp.g[:, 0], qp.g_X[:] = -np.inf, 1.0
    qp.g[0] = -0.5
    np.testing.assert_allclose(controls(qp), [0.5, 0.5, 0.0], atol=1e-14)
    qp.g[0] = 0.5
    outcome, room = find(qp)
    assert outcome == INFEASIBLE
    assert conflict(room) == {number_of(qp, PATH, 0, 0)}
    np.testing.assert_allclose(controls(qp, relaxed(qp)), [0.5, 0.5, 0.0], atol=1e-14)


@pytest.mark.parametrize('seed', range(30))
def test_random_programs(seed):
    rng = np.random.default_rng(seed)
    qp = random_program(rng, bound=1.0, trust=2.0)
    qp.g[:] += rng.uniform(0.0, 1.0)
    outcome, room = find(qp)
    if outcome == SOLVED:
        assert_optimal(qp, hard(qp), room)
        assert room.active.counts[ACTIVE] > 2
    else:
        assert outcome == INFEASIBLE
        assert_certifies(qp, conflict(room))
    for weight in (0.3, 5.0, 100.0):
        penalty = relaxed(qp, weight, 2.0 * weight)
        outcome, room = find(qp, penalty)
        assert outcome == SOLVED
        assert_optimal(qp, penalty, room)


def given_program(weight):
    qp = random_program(np.random.default_rng(4), bound=0.8)
    qp.g[:] += 0.4
    # Rows that do not apply are not for a hint to bring in.
    qp.g[0], qp.g[3, 1] = -np.inf, -np.inf
    return qp, relaxed(qp, weight, weight)


@pytest.mark.parametrize('weight', [0.7, np.inf])
@unhurried
@given(rows=st.lists(st.integers(-90, 90), max_size=80))
def test_no_hint_changes_the_answer(weight, rows):
    qp, penalty = given_program(weight)
    _, alone = find(qp, penalty)
    outcome, room = find(qp, penalty, hint_of(qp, rows))
    assert outcome == SOLVED
    np.testing.assert_allclose(room.dU, alone.dU, atol=1e-10)
    for one, other in zip(room.multipliers, alone.multipliers, strict=True):
        np.testing.assert_allclose(one, other, atol=1e-8)
    assert room.active.counts[SATURATED] == alone.active.counts[SATURATED]


@pytest.mark.parametrize('weight', [0.7, np.inf])
def test_rows_of_no_program_are_not_looked_at(weight):
    qp, penalty = given_program(weight)
    _, alone = find(qp, penalty)
    far = [2**62, -(2**62), count_rows(qp), -1 - count_rows(qp)]
    outcome, room = find(qp, penalty, hint_of(qp, far))
    assert outcome == SOLVED
    np.testing.assert_array_equal(room.dU, alone.dU)


@pytest.mark.parametrize('rows', [range(90), range(-90, 0), range(0, 90, 7)])
def test_no_hint_finds_a_point_where_there_is_none(rows):
    qp = chain(20, 3.0)
    qp.upper[:] = 0.1
    assert count_rows(qp) == 85
    outcome, room = find(qp, hint=hint_of(qp, list(rows)[:85]))
    assert outcome == INFEASIBLE
    assert_certifies(qp, conflict(room))


def test_the_hint_left_is_the_shortest_way_to_the_same_answer():
    for weight in (0.7, np.inf):
        qp, penalty = given_program(weight)
        hint = hint_of(qp)
        _, alone = find(qp, penalty, hint)
        active, saturated = alone.active.counts[ACTIVE], alone.active.counts[SATURATED]
        assert active > 3
        assert hint.length[0] >= active
        _, again = find(qp, penalty, hint)
        np.testing.assert_allclose(again.dU, alone.dU, atol=1e-11)
        assert again.active.counts[ITERATIONS] <= active + saturated
        assert again.active.counts[ITERATIONS] < alone.active.counts[ITERATIONS] or not saturated


def test_the_limit_of_iterations():
    qp, _ = given_program(np.inf)
    _, room = find(qp)
    needed = room.active.counts[ITERATIONS]
    assert needed > 5
    for limit in (0, 1, needed - 1):
        outcome, room = find(qp, limit=limit)
        assert outcome == ITERATION_LIMIT
        assert room.active.counts[ITERATIONS] == limit
    assert find(qp, limit=needed)[0] == SOLVED


def test_more_active_rows_than_there_is_room_for():
    qp, penalty = given_program(np.inf)
    room = room_for(qp)
    for capacity, outcome in ((2, ITERATION_LIMIT), (12, SOLVED)):
        small = active_set(*sizes_of(qp), capacity)
        assert find(qp, penalty, room=room._replace(active=small))[0] == outcome


def test_programs_in_flight_side_by_side():
    pairs = []
    for seed in (1, 2):
        qp = random_program(np.random.default_rng(seed), bound=0.8)
        penalty = relaxed(qp)
        pairs.append((qp, penalty, room_for(qp), find(qp, penalty)[1]))
    for qp, _, room, _ in pairs:
        assert factorise(qp, room.white)
    for _ in range(2):
        for qp, penalty, room, alone in pairs:
            at = room.white, room.active, hint_of(qp), room.dU, room.dX, room.multipliers
            assert find_active_set(qp, penalty, *at, LIMIT) == SOLVED
            np.testing.assert_array_equal(room.dU, alone.dU)
    for _, _, room, alone in pairs:
        np.testing.assert_array_equal(room.multipliers.path, alone.multipliers.path)


def test_nothing_is_left_in_a_room_for_the_next_program():
    rng = np.random.default_rng(3)
    room = room_for(random_program(rng))
    for seed in range(8):
        qp = random_program(np.random.default_rng(seed), bound=0.7)
        penalty = (hard, relaxed)[seed % 2](qp)
        outcome, _ = find(qp, penalty, room=room)
        fresh, alone = find(qp, penalty)
        assert outcome == fresh
        if outcome == SOLVED:
            np.testing.assert_array_equal(room.dU, alone.dU)
            for one, other in zip(room.multipliers, alone.multipliers, strict=True):
                np.testing.assert_array_equal(one, other)
