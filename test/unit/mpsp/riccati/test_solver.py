"""The whole solver: what it believes, and what it does about a bad hint."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from stage_programs import (
    assert_optimal,
    chain,
    for_its_sizes,
    hard,
    hint_of,
    random_program,
    relaxed,
    room_for,
    sizes_of,
)

from cmpsp_ros.mpsp.riccati.outcome import INFEASIBLE, SOLVED
from cmpsp_ros.mpsp.riccati.solver import iterations, solve
from cmpsp_ros.mpsp.riccati.whitening import factorise

# What they call takes long to compile: by one worker.
pytestmark = pytest.mark.xdist_group('riccati')

unhurried = settings(deadline=None, max_examples=40)


def solved(qp, penalty, rows=(), room=None):
    room = room or room_for(qp)
    hint = hint_of(qp, rows)
    assert factorise(qp, room.white)
    return solve(qp, penalty, hint, room), room, hint


@pytest.mark.parametrize('seed', range(10))
def test_hard_and_relaxed_programs(seed):
    qp = random_program(np.random.default_rng(seed), bound=1.0, trust=2.0)
    outcome, room, _ = solved(qp, hard(qp))
    assert outcome in (SOLVED, INFEASIBLE)
    if outcome == SOLVED:
        assert_optimal(qp, hard(qp), room)
    outcome, room, _ = solved(qp, relaxed(qp))
    assert outcome == SOLVED
    assert_optimal(qp, relaxed(qp), room)
    assert iterations(room) > 0


def test_known_and_told_sizes_give_the_same_bits():
    for seed in range(5):
        told = random_program(np.random.default_rng(seed), bound=1.0)
        known = for_its_sizes(told)
        for penalty in (hard(told), relaxed(told)):
            (one, first, left), (other, second, same) = (
                solved(told, penalty),
                solved(known, penalty),
            )
            assert one == other
            assert left.length == same.length
            np.testing.assert_array_equal(left.rows, same.rows)
            np.testing.assert_array_equal(first.dU, second.dU)
            np.testing.assert_array_equal(first.multipliers.path, second.multipliers.path)


@pytest.mark.parametrize('weight', [0.5, np.inf])
@unhurried
@given(rows=st.lists(st.integers(-90, 90), max_size=80))
def test_no_hint_changes_the_outcome(weight, rows):
    for seed in (0, 1):
        qp = random_program(np.random.default_rng(seed), bound=0.6)
        penalty = relaxed(qp, weight, weight)
        wanted, alone, _ = solved(qp, penalty)
        outcome, room, _ = solved(qp, penalty, rows)
        assert outcome == wanted
        if outcome == SOLVED:
            np.testing.assert_allclose(room.dU, alone.dU, atol=1e-10)


def test_what_is_proved_is_not_looked_for_again_without_the_hint():
    qp = chain(20, 3.0)
    qp.upper[:] = 0.1
    outcome, room, hint = solved(qp, hard(qp))
    assert outcome == INFEASIBLE
    left = hint.rows[: hint.length[0]].tolist()
    assert len(left) > 10
    again, room, hint = solved(qp, hard(qp), left)
    assert again == INFEASIBLE
    assert hint.rows[: hint.length[0]].tolist() == left
    assert iterations(room) == len(left) + 1


def test_a_saturated_row_may_have_come_to_a_stage_where_it_does_not_apply():
    qp = chain(2, path=1)
    qp.g[:, 0], qp.g_U[:] = [-np.inf, 2.0, -np.inf], -1.0
    outcome, room, hint = solved(qp, relaxed(qp, path=1.0))
    assert outcome == SOLVED
    np.testing.assert_allclose(room.dU[:, 0], [0.0, 1.0, 0.0])
    hint.rows[0] += 1 + 2 + 2
    outcome, room, _ = solved(qp, relaxed(qp, path=1.0), hint.rows[:1])
    assert outcome == SOLVED
    np.testing.assert_allclose(room.dU[:, 0], [0.0, 1.0, 0.0])
    np.testing.assert_array_equal(room.multipliers.path[:, 0], [0.0, 1.0, 0.0])


def test_data_that_are_no_number_are_never_solved():
    room = room_for(random_program(np.random.default_rng(0)))
    for name in ('L_X', 'L_U', 'output_error', 'h_X', 'g', 'g_X', 'lower', 'upper', 'trust_radius'):
        qp = random_program(np.random.default_rng(0), bound=1.0, trust=2.0)
        array = getattr(qp, name)
        array[-1] = np.nan
        for penalty in (hard(qp), relaxed(qp)):
            outcome, _, _ = solved(qp, penalty, room=room)
            assert outcome != SOLVED, name
    qp = random_program(np.random.default_rng(0))
    assert solved(qp, relaxed(qp), room=room)[0] == SOLVED


def test_a_solver_is_made_for_its_sizes():
    qp = random_program(np.random.default_rng(0))
    room = room_for(qp)
    N, n, r, *_ = sizes_of(qp)
    assert room.dU.shape == (N + 1, r)
    assert room.dX.shape == room.deviation.shape == (N + 1, n)
