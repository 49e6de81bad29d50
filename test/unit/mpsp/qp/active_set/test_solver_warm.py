"""Warm starts of the active-set method: the same answer, sooner."""

import numpy as np
import pytest
from stage_programs import chain, random_program, relaxed, run

from cmpsp_ros.mpsp.qp.riccati import Outcome

# What they call takes long to compile: by one worker.
pytestmark = pytest.mark.xdist_group('riccati')


def given_program(weight):
    qp = random_program(np.random.default_rng(4), bound=0.8)
    qp.g[:] += 0.4
    qp.g[0], qp.g[3, 1] = -np.inf, -np.inf
    return qp, relaxed(qp, weight, weight)


@pytest.mark.parametrize('weight', [0.7, np.inf])
def test_the_warm_start_left_is_the_shortest_way_to_the_same_answer(weight):
    qp, penalties = given_program(weight)
    alone = run(qp, penalties)
    assert alone.active > 3
    assert (alone.saturated > 0) == (weight < np.inf)
    again = run(qp, penalties, alone.warm.copy())
    np.testing.assert_allclose(again.dU, alone.dU, atol=1e-11)
    assert again.iterations <= alone.active + alone.saturated


@pytest.mark.parametrize('side', [1.0, -1.0])
def test_an_output_at_either_penalty_stays_there(side):
    qp = chain(2, 3.0 * side)
    alone = run(qp, relaxed(qp, terminal=1.0))
    assert (alone.outcome, alone.saturated) == (Outcome.SOLVED, 1)
    again = run(qp, relaxed(qp, terminal=1.0), alone.warm.copy())
    assert (again.outcome, again.saturated, again.iterations) == (Outcome.SOLVED, 1, 0)
    np.testing.assert_allclose(again.dU, alone.dU, atol=1e-14)
    # Also when the horizon moves on.
    qp = chain(1, 3.0 * side)
    later = run(qp, relaxed(qp, terminal=1.0), alone.warm.copy(), begun=1)
    assert (later.outcome, later.saturated, later.iterations) == (Outcome.SOLVED, 1, 0)


def test_a_penalty_that_drives_all_controls_to_their_bounds_is_no_endless_start():
    qp = chain(30, 50.0)
    qp.lower[:], qp.upper[:] = -0.1, 0.1
    penalties = relaxed(qp, terminal=5.0)
    alone = run(qp, penalties)

    again = run(qp, penalties, alone.warm.copy())

    assert (alone.outcome, again.outcome) == (Outcome.SOLVED, Outcome.SOLVED)
    assert alone.saturated == 1
    np.testing.assert_allclose(alone.dU[:-1, 0], 0.1, atol=1e-12)
    np.testing.assert_allclose(again.dU, alone.dU, atol=1e-12)


@pytest.mark.parametrize('stages', [1, 4, 30])
def test_a_warm_start_moves_to_a_later_horizon(stages):
    whole = random_program(np.random.default_rng(2), 20, bound=0.5, trust=2.0)
    penalties = relaxed(whole, 50.0, 2.0)
    warm = run(whole, penalties).warm
    kept = 21 - stages if stages < 20 else 5
    cut = min(stages, 15)
    later = whole._replace(
        **{
            name: getattr(whole, name)[cut : cut + kept]
            for name in whole._fields
            if name[0] in 'Lglu'
        },
        A=whole.A[cut : cut + kept - 1],
        B=whole.B[cut : cut + kept - 1],
    )
    weights = relaxed(later, 50.0, 2.0)
    alone, shifted = run(later, weights), run(later, weights, warm, begun=stages)
    assert alone.outcome == shifted.outcome == Outcome.SOLVED
    np.testing.assert_allclose(shifted.dU, alone.dU, atol=1e-10)
    assert shifted.warm.head['begun'][0] == stages
    if stages == 1:
        assert shifted.iterations < alone.iterations
