"""The factorisation against the same program written out densely."""

import numpy as np
import pytest
from stage_programs import Sizes, dense, empty, for_its_sizes, random_program, sizes_of

from cmpsp_ros.mpsp.riccati.rows import count_rows, white_length, white_row
from cmpsp_ros.mpsp.riccati.whitening import factorise, spread, unwhiten, whitening

SIZES = [
    Sizes(),
    Sizes(N=1),
    Sizes(N=200, m=1, l=1),
    Sizes(N=4, n=1, r=1),
    Sizes(N=7, n=6, r=1, m=0, l=0),
    Sizes(N=3, n=2, r=4),
]


def factorised(qp):
    N, n, r, *_ = sizes_of(qp)
    white = whitening(N, n, r)
    assert factorise(qp, white)
    return white


def deviations(qp, white, v):
    N, n, r, *_ = sizes_of(qp)
    dU, dX = np.full((N + 1, r), np.nan), np.full((N + 1, n), np.nan)
    unwhiten(qp, white, v, dU, dX)
    return dU.ravel(), dX


def back(qp, white):
    """The matrix of ``dU = T v``."""
    q = len(white.optimum)
    return np.column_stack([deviations(qp, white, unit)[0] for unit in np.eye(q)])


@pytest.mark.parametrize('sizes', SIZES, ids=str)
def test_the_hessian_becomes_the_identity(sizes):
    qp = random_program(np.random.default_rng(1), sizes)
    T = back(qp, factorised(qp))
    np.testing.assert_allclose(T.T @ dense(qp).H @ T, np.eye(len(T)), atol=1e-9)


@pytest.mark.parametrize('sizes', SIZES, ids=str)
def test_the_optimum_is_the_minimum_without_rows(sizes):
    qp = random_program(np.random.default_rng(2), sizes)
    white, written = factorised(qp), dense(qp)
    dU, dX = deviations(qp, white, white.optimum)
    np.testing.assert_allclose(dU, -np.linalg.solve(written.H, written.c), atol=1e-9)
    np.testing.assert_allclose(dX, written.states @ dU, atol=1e-9)


@pytest.mark.parametrize('sizes', SIZES, ids=str)
def test_cost_is_half_the_squared_distance_from_the_optimum(sizes):
    rng = np.random.default_rng(3)
    qp = random_program(rng, sizes)
    white, written = factorised(qp), dense(qp)

    def cost(v):
        dU, _ = deviations(qp, white, v)
        return 0.5 * dU @ written.H @ dU + written.c @ dU

    least = cost(white.optimum)
    for _ in range(5):
        away = rng.normal(size=len(white.optimum))
        rise = cost(white.optimum + away) - least
        assert rise == pytest.approx(0.5 * away @ away, rel=1e-9)


@pytest.mark.parametrize('sizes', SIZES, ids=str)
def test_rows_and_their_lengths(sizes):
    qp = random_program(np.random.default_rng(4), sizes)
    white, written = factorised(qp), dense(qp)
    wanted = written.rows @ back(qp, white)
    spread(qp, white)
    rows = range(0, count_rows(qp), 1 + count_rows(qp) // 200)
    for row in rows:
        found = np.full(len(white.optimum), np.nan)
        length = white_row(qp, white, row, found)
        np.testing.assert_allclose(found[:length], wanted[row, :length], atol=1e-9)
        np.testing.assert_allclose(wanted[row, length:], 0.0, atol=1e-9)
        whole = white_length(qp, white, row)
        assert whole == pytest.approx(np.linalg.norm(wanted[row]), rel=1e-8, abs=1e-9)


def test_known_and_told_sizes_give_the_same_bits():
    rng = np.random.default_rng(5)
    for N in (1, 5, 30):
        told = random_program(rng, Sizes(N=N))
        known = for_its_sizes(told)
        first, second = factorised(told), factorised(known)
        spread(told, first)
        spread(known, second)
        for one, other in zip(first, second, strict=True):
            np.testing.assert_array_equal(one, other)
        v, one, other = rng.normal(size=2 * (N + 1)), np.empty(2 * N + 2), np.empty(2 * N + 2)
        for part, same in zip(
            deviations(told, first, v), deviations(known, second, v), strict=True
        ):
            np.testing.assert_array_equal(part, same)
        for row in range(count_rows(told)):
            length = white_row(told, first, row, one)
            assert white_row(known, second, row, other) == length
            np.testing.assert_array_equal(one[:length], other[:length])
            assert white_length(told, first, row) == white_length(known, second, row)


def curved(qp, name, k, by):
    getattr(qp, name)[k] += by * np.eye(getattr(qp, name).shape[1])
    return qp


@pytest.mark.parametrize(
    ('name', 'stage', 'by'),
    [('L_UU', 5, -50.0), ('L_UU', 0, -500.0), ('L_XX', 5, -50.0), ('L_XX', 3, -50.0)],
)
def test_indefinite_hessians_are_refused(name, stage, by):
    qp = curved(random_program(np.random.default_rng(6)), name, stage, by)
    assert np.linalg.eigvalsh(dense(qp).H)[0] < 0.0
    assert not factorise(qp, whitening(5, 3, 2))


def test_a_hessian_counts_not_the_curvature_of_each_stage():
    qp = random_program(np.random.default_rng(7))
    qp.L_UU[0] = -0.1 * np.eye(2)
    qp.L_UX[0] = 0.0
    qp.L_XX[1] += 50.0 * np.eye(3)
    assert np.linalg.eigvalsh(dense(qp).H)[0] > 0.0
    assert factorise(qp, whitening(5, 3, 2))


@pytest.mark.parametrize('seed', range(40))
def test_a_factorisation_is_had_where_cholesky_has_one(seed):
    rng = np.random.default_rng(seed)
    qp = random_program(rng)
    curved(qp, 'L_UU', rng.integers(6), rng.uniform(-2.0, 0.0))
    curved(qp, 'L_XX', rng.integers(1, 6), rng.uniform(-3.0, 0.0))
    least = np.linalg.eigvalsh(dense(qp).H)[0]
    assert abs(least) > 1e-6
    assert factorise(qp, whitening(5, 3, 2)) == (least > 0.0)


def test_singular_hessians_are_refused():
    flat = empty(3, 2, 2, 0, 0)
    assert not factorise(flat, whitening(3, 2, 2))
    qp = random_program(np.random.default_rng(8))
    # Both controls of the last stage do the same.
    qp.L_UX[5] = 0.0
    qp.L_UU[5] = np.full((2, 2), 3.0)
    assert not factorise(qp, whitening(5, 3, 2))


@pytest.mark.parametrize('name', ['A', 'B', 'L_XX', 'L_UX', 'L_UU'])
def test_a_hessian_with_a_number_that_is_none_is_refused(name):
    qp = random_program(np.random.default_rng(9))
    getattr(qp, name)[2] = np.nan
    assert not factorise(qp, whitening(5, 3, 2))
