"""The Newton step of the rows satisfies the equations that it is the solution of."""

import numpy as np
import pytest

from cmpsp_ros.mpsp.riccati.barrier import (
    EQUAL,
    HARD,
    OFF,
    RELAXED,
    advance,
    aim,
    empty_barrier,
    follow,
    multiplier_of,
    place_row,
)

GIVE, CAP = 1e-2, 7.0


def rows_of(kinds, rng=None, offset=0.0):
    rng = rng or np.random.default_rng(0)
    b = empty_barrier(len(kinds))
    b.kind[:] = kinds
    b.length[:] = rng.uniform(0.5, 2.0, size=len(kinds))
    b.value[:] = rng.normal(size=len(kinds))
    b.offset[:] = offset
    for row in range(len(kinds)):
        place_row(b, row, 0.3, CAP, 0.2)
    return b


@pytest.mark.parametrize('share', [0.0, 1.0])
def test_the_step_solves_the_linearised_equations(share):
    rng = np.random.default_rng(1)
    b = rows_of([HARD, RELAXED, EQUAL] * 4, rng)
    aim(b, GIVE, 0.0, 0.0)
    b.value_step[:] = rng.normal(size=12)
    follow(b)
    predicted = [part.copy() for part in (b.slack_step, b.excess_step, b.multiplier_step)]
    aim(b, GIVE, 0.1, share)
    b.value_step[:] = rng.normal(size=12)
    follow(b)
    gives = GIVE * b.length**2 * b.multiplier_step
    hard, relaxed, equal = (b.kind == kind for kind in (HARD, RELAXED, EQUAL))
    row = b.value + b.value_step
    np.testing.assert_allclose(row[equal], gives[equal])
    row = row + b.slack + b.slack_step
    np.testing.assert_allclose(row[hard], gives[hard])
    row = row - b.excess - b.excess_step
    np.testing.assert_allclose(row[relaxed], gives[relaxed], atol=1e-14)
    slack, excess, multiplier = predicted
    product = b.slack * b.multiplier + b.slack * b.multiplier_step + b.slack_step * b.multiplier
    np.testing.assert_allclose((product + share * slack * multiplier)[~equal], 0.1)
    product = b.excess * b.room - b.excess * b.multiplier_step + b.excess_step * b.room
    np.testing.assert_allclose((product - share * excess * multiplier)[relaxed], 0.1)


def test_the_step_is_measured_to_where_the_first_number_is_0():
    b = rows_of([HARD, RELAXED, OFF], np.random.default_rng(2))
    aim(b, GIVE, 0.0, 0.0)
    b.value_step[:] = [3.0, -3.0, 100.0]
    blocking, _ = follow(b)
    parts = (b.slack, b.multiplier, b.excess, b.room)
    steps = (b.slack_step, b.multiplier_step, b.excess_step, -b.multiplier_step)
    wanted = max(
        -step[row] / part[row]
        for part, step in zip(parts, steps, strict=True)
        for row in (0, 1)
        if part[row] > 0.0
    )
    assert blocking == pytest.approx(wanted)
    advance(b, 0.999 / blocking)
    assert min(*b.slack[:2], *b.multiplier[:2], b.excess[1], b.room[1]) > 0.0


def test_advance_tells_how_far_rows_are_from_being_met():
    b = rows_of([HARD, RELAXED, EQUAL, OFF])
    errors = b.value + np.array([0.3, 0.3 - b.excess[1], 0.0, 0.0])
    mean, worst = advance(b, 0.0)
    assert worst == pytest.approx(np.abs(errors / b.length)[:3].max())
    assert mean == pytest.approx(0.2)


def test_multipliers_are_cut_where_they_mean_nothing_else():
    b = rows_of([HARD, RELAXED, EQUAL, OFF])
    b.length[:] = 1.0
    b.multiplier[:] = [1e-9, CAP - 1e-9, -3.0, 5.0]
    b.room[:], b.slack[:], b.excess[:] = 1e-9, 1.0, 1.0
    assert [multiplier_of(b, row, CAP) for row in range(4)] == [0.0, CAP, -3.0, 0.0]
    b.slack[:] = b.excess[:] = 1e-9
    assert multiplier_of(b, 0, CAP) == 1e-9
    assert multiplier_of(b, 1, CAP) == CAP - 1e-9


def test_a_relaxed_terminal_row_begins_without_a_multiplier():
    b = rows_of([RELAXED], offset=CAP / 2.0)
    assert multiplier_of(b, 0, CAP / 2.0) == 0.0
    assert b.multiplier[0] == b.room[0] == CAP / 2.0
