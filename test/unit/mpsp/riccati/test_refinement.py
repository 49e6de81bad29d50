"""Rounding, made large on purpose, and taken out again."""

import numpy as np
import pytest
from stage_programs import assert_optimal, find, hard, random_program, relaxed

from cmpsp_ros.mpsp.riccati.outcome import SOLVED
from cmpsp_ros.mpsp.riccati.refinement import retrace, sharpen
from cmpsp_ros.mpsp.riccati.whitening import unwhiten
from cmpsp_ros.mpsp.riccati.working_set import ACTIVE, SATURATED

# What they call takes long to compile: by one worker.
pytestmark = pytest.mark.xdist_group('riccati')


def solution(kind):
    qp = random_program(np.random.default_rng(4), bound=0.8)
    penalty = kind(qp)
    outcome, room = find(qp, penalty)
    assert outcome == SOLVED
    assert room.active.counts[ACTIVE] > 1
    return qp, penalty, room


def test_active_rows_are_met_again_and_their_multipliers_follow():
    qp, penalty, room = solution(hard)
    at, dU, dX = room.active, np.empty_like(room.dU), np.empty_like(room.dX)
    v, multipliers = at.v.copy(), at.multipliers.copy()
    count = at.counts[ACTIVE]
    away = np.random.default_rng(0).normal(size=count)
    # Multipliers that are wrong, and the point where they lead.
    at.multipliers[:count] += 1e-4 * away
    R, Q = np.triu(at.basis.R[:count, :count]), at.basis.Q[:count]
    at.v[:] -= 1e-4 * away @ (R.T @ Q)
    unwhiten(qp, room.white, at.v, dU, dX)
    assert np.abs(dU - room.dU).max() > 1e-6
    sharpen(qp, penalty, room.white, at, dU, dX)
    np.testing.assert_allclose(at.v, v, atol=1e-12)
    np.testing.assert_allclose(at.multipliers[:count], multipliers[:count], atol=1e-12)
    np.testing.assert_allclose(dU, room.dU, atol=1e-12)
    assert_optimal(qp, penalty, room._replace(dU=dU, dX=dX))


def test_rows_that_are_sharp_are_left_alone():
    qp, penalty, room = solution(hard)
    before = room.active.v.copy()
    sharpen(qp, penalty, room.white, room.active, room.dU, room.dX)
    np.testing.assert_array_equal(room.active.v, before)


@pytest.mark.parametrize('weight', [0.3, np.inf])
def test_the_point_is_where_the_multipliers_lead(weight):
    qp, penalty, room = solution(lambda qp: relaxed(qp, weight, weight))
    assert (room.active.counts[SATURATED] > 0) == np.isfinite(weight)
    v = room.active.v.copy()
    room.active.v[:] = np.nan
    retrace(qp, penalty, room.white, room.active)
    np.testing.assert_allclose(room.active.v, v, atol=1e-12)
