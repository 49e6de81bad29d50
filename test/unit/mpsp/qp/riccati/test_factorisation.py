"""The factorisation against the condensed Hessian, with and without controls at a bound."""

import numpy as np
import pytest
from stage_programs import dense, random_program, staged

from cmpsp_ros.mpsp.qp.active_set.records import fill, space
from cmpsp_ros.mpsp.qp.active_set.state import row_in_v
from cmpsp_ros.mpsp.qp.riccati.factorisation import factorise
from cmpsp_ros.mpsp.qp.riccati.program import load_row, row_value_at_origin
from cmpsp_ros.mpsp.qp.riccati.sweeps import (
    keep_origin,
    propagate_covariance,
    recover_step,
    row_norm,
)

HORIZONS = 1, 5, 40


def records(qp, fixed=None):
    """The program with some controls held: 1 at the upper bound, -1 at the lower one."""
    mine = space(staged(qp).size)
    fill(mine, staged(qp))
    if fixed is not None:
        mine.program.stages['fixed'] = fixed
        mine.program.head['fixed'] = np.count_nonzero(fixed)
    return mine.program


def step(p, v):
    recover_step(p, np.ascontiguousarray(v))
    return p.stages['dU'].ravel().copy()


def maps(p):
    """``dU = origin + T v``."""
    q = p.stages['dU'].size
    origin = step(p, np.zeros(q))
    return origin, np.column_stack([step(p, unit) - origin for unit in np.eye(q)])


@pytest.mark.parametrize('held', [0.0, 0.4, 1.0])
@pytest.mark.parametrize('N', HORIZONS)
def test_hessian_optimum_and_rows(N, held):
    rng = np.random.default_rng(N)
    qp = random_program(rng, N, bound=0.5, trust=1.0)
    fixed = rng.choice([-1.0, 1.0], (N + 1, 2)) * (rng.random((N + 1, 2)) < held)
    p, written, free = records(qp, fixed), dense(qp), fixed.ravel() == 0.0
    assert pytest.approx(staged(qp).condensed.H) == written.H
    assert factorise(p)
    keep_origin(p, np.empty(2 * N + 2))
    origin, T = maps(p)
    # In the free controls the Hessian is the identity, and what is held stays where it is.
    np.testing.assert_allclose((T.T @ written.H @ T)[free][:, free], np.eye(free.sum()), atol=1e-9)
    assert not T[~free].any()
    assert not T[:, ~free].any()
    np.testing.assert_array_equal(origin[~free], 0.5 * fixed.ravel()[~free])
    optimum = origin + T @ p.stages['optimum'].ravel()
    gradient = written.H @ optimum + written.c
    np.testing.assert_allclose(gradient[free], 0.0, atol=1e-9)
    np.testing.assert_allclose(
        step(p, p.stages['optimum'].ravel()), optimum, atol=1e-9 * (1.0 + np.abs(optimum).max())
    )
    np.testing.assert_allclose(p.stages['dX'], written.states @ optimum, atol=1e-9)
    propagate_covariance(p)
    wanted, found = written.rows @ T, np.empty(2 * N + 2)
    for row in range(0, len(wanted), 1 + len(wanted) // 100):
        length = row_in_v(p, row, found)
        np.testing.assert_allclose(found[:length], wanted[row, :length], atol=1e-9)
        np.testing.assert_allclose(wanted[row, length:], 0.0, atol=1e-9)
        norm = row_norm(p, load_row(p, row))
        assert norm == pytest.approx(np.linalg.norm(wanted[row]), rel=1e-8, abs=1e-9)
        at_origin = written.rows[row] @ origin if held else 0.0
        assert row_value_at_origin(p, row) == pytest.approx(at_origin, abs=1e-9)


@pytest.mark.parametrize('seed', range(20))
def test_a_factorisation_is_had_where_cholesky_has_one(seed):
    rng = np.random.default_rng(seed)
    qp = random_program(rng)
    qp.L_UU[rng.integers(6)] += rng.uniform(-2.0, 0.0) * np.eye(2)
    qp.L_XX[rng.integers(1, 6)] += rng.uniform(-3.0, 0.0) * np.eye(3)
    least = np.linalg.eigvalsh(dense(qp).H)[0]
    assert abs(least) > 1e-6
    assert factorise(records(qp)) == (least > 0.0)


def test_it_is_the_hessian_that_counts_not_each_stage():
    qp = random_program(np.random.default_rng(7))
    qp.L_UU[0], qp.L_UX[0] = -0.1 * np.eye(2), 0.0
    qp.L_XX[1] += 50.0 * np.eye(3)
    assert np.linalg.eigvalsh(dense(qp).H)[0] > 0.0
    assert factorise(records(qp))


def test_hessians_that_are_singular_or_not_finite_are_refused():
    qp = random_program(np.random.default_rng(8))
    # Both controls of the last stage do the same.
    qp.L_UX[5], qp.L_UU[5] = 0.0, np.full((2, 2), 3.0)
    assert not factorise(records(qp))
    for name in ('A', 'B', 'L_XX', 'L_UX', 'L_UU'):
        qp = random_program(np.random.default_rng(9))
        getattr(qp, name)[2] = np.nan
        assert not factorise(records(qp)), name
