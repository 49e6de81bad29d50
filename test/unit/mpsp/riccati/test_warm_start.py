"""Where the active-set method begins."""

import math

import numpy as np
import pytest
from stage_programs import LIMIT, chain, hard, hint_of, relaxed, room_for

from cmpsp_ros.mpsp.riccati.rows import BOUND, PATH, number_of
from cmpsp_ros.mpsp.riccati.warm_start import begin
from cmpsp_ros.mpsp.riccati.whitening import factorise, unwhiten
from cmpsp_ros.mpsp.riccati.working_set import (
    ACTIVE,
    AT_MINUS_PENALTY,
    AT_PENALTY,
    IS_ACTIVE,
    IS_OFF,
    ITERATIONS,
    SATURATED,
)

# What they call takes long to compile: by one worker.
pytestmark = pytest.mark.xdist_group('riccati')


def begun(qp, penalty, rows=(), limit=LIMIT):
    """The active set at the beginning, and the controls there."""
    room = room_for(qp)
    assert factorise(qp, room.white)
    begin(qp, penalty, room.white, room.active, hint_of(qp, rows), limit)
    unwhiten(qp, room.white, room.active.v, room.dU, room.dX)
    return room.active, room.dU[:, 0]


def two_walls():
    """``u_0 >= 1`` and ``u_0 + u_1 >= 10``, where 0 would be best; and the two rows."""
    qp = chain(2, path=2)
    qp.g[:] = -np.inf
    qp.g[0, 0], qp.g_U[0, 0] = 1.0, -1.0
    qp.g[2, 1], qp.g_X[2, 1] = 10.0, -1.0
    return qp, [number_of(qp, PATH, 0, 0), number_of(qp, PATH, 2, 1)]


def test_all_rows_of_the_hint_are_met_at_once():
    qp = chain(3, 3.0)
    qp.upper[0], qp.lower[2] = 0.5, 1.75
    rows = [number_of(qp, BOUND, 0, 0), number_of(qp, BOUND, 2, 0) + 1]
    at, controls = begun(qp, hard(qp), rows)
    np.testing.assert_allclose(controls, [0.5, 0.75, 1.75, 0.0], atol=1e-14)
    np.testing.assert_array_equal(at.rows[: at.counts[ACTIVE]], [0, *rows])
    np.testing.assert_allclose(at.multipliers[:3], [-0.75, 0.25, 1.0], atol=1e-14)
    assert at.counts[ITERATIONS] == 3


def test_rows_that_are_met_in_any_case_are_not_taken_in():
    qp = chain(3, 3.0)
    qp.upper[0] = 1.5
    at, controls = begun(qp, hard(qp), [number_of(qp, BOUND, 0, 0)])
    np.testing.assert_allclose(controls, [1.0, 1.0, 1.0, 0.0], atol=1e-14)
    assert at.counts[ACTIVE] == 1


def test_a_row_that_another_makes_needless_leaves_again():
    qp, rows = two_walls()
    at, controls = begun(qp, hard(qp), rows)
    np.testing.assert_allclose(controls, [5.0, 5.0, 0.0], atol=1e-14)
    assert at.counts[ACTIVE] == 1
    assert [at.states[row] for row in rows] == [IS_OFF, IS_ACTIVE]
    np.testing.assert_allclose(at.multipliers[0], 5.0)


@pytest.mark.parametrize('weight', [2.0, 0.75, 0.0])
def test_a_row_that_is_too_dear_rests_at_its_penalty(weight):
    qp, rows = two_walls()
    at, controls = begun(qp, relaxed(qp, path=weight), rows)
    np.testing.assert_allclose(controls, [weight, weight, 0.0], atol=1e-14)
    assert at.counts[ACTIVE] == 0
    assert at.counts[SATURATED] == 1
    assert [at.states[row] for row in rows] == [IS_OFF, AT_PENALTY]


@pytest.mark.parametrize('side', [1.0, -1.0])
def test_an_output_that_is_too_dear_rests_at_the_penalty_of_its_side(side):
    qp = chain(2, 3.0 * side)
    at, controls = begun(qp, relaxed(qp, terminal=1.0))
    np.testing.assert_allclose(controls, [side, side, 0.0], atol=1e-14)
    assert at.states[0] == (AT_MINUS_PENALTY if side > 0.0 else AT_PENALTY)


def test_an_output_that_repeats_another_is_left_to_be_met_first():
    both = {'h_X': np.ones((2, 1)), 'h_U': np.zeros((2, 1))}
    qp = chain(2, 3.0)._replace(output_error=np.array([-3.0, -3.0]), **both)
    at, _ = begun(qp, hard(qp))
    assert at.counts[ACTIVE] == 1
    assert at.distances[-1] == math.inf
    assert at.furthest[-1] == 1


def test_no_more_rows_are_taken_in_than_allowed():
    qp, rows = two_walls()
    at, _ = begun(qp, hard(qp), rows, limit=1)
    assert at.counts[ITERATIONS] == at.counts[ACTIVE] == 1
