"""Rounding, made large on purpose, and taken out again."""

import numpy as np
import pytest
from stage_programs import random_program, relaxed, run

from cmpsp_ros.mpsp.qp.active_set.state import iterative_refinement
from cmpsp_ros.mpsp.qp.riccati import Outcome
from cmpsp_ros.mpsp.qp.riccati.sweeps import recover_step

# What they call takes long to compile: by one worker.
pytestmark = pytest.mark.xdist_group('riccati')


def solution():
    qp = random_program(np.random.default_rng(4), bound=0.8)
    found = run(qp, relaxed(qp, np.inf, np.inf))
    assert found.outcome == Outcome.SOLVED
    assert found.active > 1
    # The memory is just as long as the horizon.
    return found, found.space.program, found.space.active


def test_active_rows_are_met_again_and_their_multipliers_follow():
    found, p, at = solution()
    v, multipliers, count = at.v.copy(), at.multipliers.copy(), found.active
    away = 1e-4 * np.random.default_rng(0).normal(size=count)
    # Multipliers that are wrong, and the point where they lead.
    R, Q = np.triu(at.basis.R[:count, :count]), at.basis.Q[:count]
    at.multipliers[:count] += away
    at.v[:] -= away @ (R.T @ Q)
    recover_step(p, at.v)
    assert np.abs(p.stages['dU'] - found.dU).max() > 1e-6
    iterative_refinement(p, at)
    np.testing.assert_allclose(at.v, v, atol=1e-12)
    np.testing.assert_allclose(at.multipliers[:count], multipliers[:count], atol=1e-12)
    np.testing.assert_allclose(p.stages['dU'], found.dU, atol=1e-12)
    # Rows that are met are left alone.
    before = at.v.copy()
    iterative_refinement(p, at)
    np.testing.assert_array_equal(at.v, before)
