"""The orthonormal basis of the active rows, against numpy's factorisations."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cmpsp_ros.mpsp.qp.active_set.basis import Basis, append, remove, solve, solve_transposed, split

unhurried = settings(deadline=None, max_examples=60)


class Rows:
    """Rows as they are, beside the basis that is kept of them."""

    def __init__(self, rows, length):
        self.at = Basis(np.zeros((rows, length)), np.zeros((rows, rows)))
        self.kept = []

    def split(self, row, length=None):
        """Parts of a row, and the square of what is outside; filled with other numbers before."""
        M, q = self.at.Q.shape
        inside, outside, again = (np.full(size, np.nan) for size in (M, q, M))
        length = q if length is None else length
        rest = split(self.at, len(self.kept), row, length, inside, outside, again)
        return inside, outside, rest

    def add(self, row, sign=1.0):
        """Add a row, or what its sign makes of it, unless it depends on the others."""
        inside, outside, rest = self.split(row)
        if rest == 0.0:
            return False
        append(self.at, len(self.kept), inside, outside, sign)
        self.kept.append(sign * row)
        return True

    def drop(self, index, other):
        """Take a row out while the split of another one is kept up to date."""
        inside, outside, rest = self.split(other)
        gained = remove(self.at, len(self.kept), index, inside, outside)
        del self.kept[index]
        return inside, outside, rest + gained

    def check(self):
        count, rows = len(self.kept), np.array(self.kept).reshape(-1, self.at.Q.shape[1])
        Q, R = self.at.Q[:count], self.at.R[:count, :count]
        np.testing.assert_allclose(Q @ Q.T, np.eye(count), atol=1e-12)
        upper = np.triu(R)
        np.testing.assert_allclose(upper.T @ Q, rows, atol=1e-11)
        wanted = np.linalg.qr(rows.T, mode='r') if count else np.empty((0, 0))
        np.testing.assert_allclose(np.abs(upper), np.abs(wanted), atol=1e-11)


def filled(rng, count=5, length=9):
    rows = Rows(count + 2, length)
    for row in rng.normal(size=(count, length)):
        assert rows.add(row)
    return rows


@pytest.mark.parametrize('length', [1, 4, 9])
def test_a_row_is_split_in_two_orthogonal_parts(length):
    rng = np.random.default_rng(2)
    rows = filled(rng)
    row = rng.normal(size=9)
    inside, outside, rest = rows.split(row, length)
    Q = rows.at.Q[:5]
    row[length:] = 0.0
    np.testing.assert_allclose(Q.T @ inside[:5] + outside, row, atol=1e-14)
    np.testing.assert_allclose(Q @ outside, 0.0, atol=1e-14)
    assert rest == pytest.approx(outside @ outside, rel=1e-12)


@pytest.mark.parametrize('noise', [0.0, 1e-15, 1e-11])
def test_a_row_that_depends_on_others_has_nothing_outside(noise):
    rng = np.random.default_rng(3)
    rows = filled(rng)
    parts = rng.normal(size=5)
    row = parts @ np.array(rows.kept) + noise * rng.normal(size=9)
    inside, outside, rest = rows.split(row)
    assert rest == 0.0
    np.testing.assert_array_equal(outside, 0.0)
    found = np.empty(7)
    solve(rows.at, 5, inside, found)
    np.testing.assert_allclose(found[:5], parts, atol=1e-9)


def test_a_row_that_is_all_but_dependent_keeps_the_basis_orthogonal():
    rng = np.random.default_rng(4)
    rows = filled(rng)
    for scale in (1e-6, 1e-8):
        assert rows.add(rows.kept[0] + scale * rng.normal(size=9))
    Q = rows.at.Q
    np.testing.assert_allclose(Q @ Q.T, np.eye(7), atol=1e-13)


@pytest.mark.parametrize('index', range(5))
def test_the_split_of_another_row_survives_a_removal(index):
    rng = np.random.default_rng(6)
    rows = filled(rng)
    other = rng.normal(size=9)
    inside, outside, rest = rows.drop(index, other)
    rows.check()
    wanted = rows.split(other)
    np.testing.assert_allclose(inside[:4], wanted[0][:4], atol=1e-13)
    np.testing.assert_allclose(outside, wanted[1], atol=1e-13)
    assert rest == pytest.approx(wanted[2], rel=1e-12)


def test_triangular_systems():
    rng = np.random.default_rng(7)
    rows = filled(rng)
    R, y, x = np.triu(rows.at.R[:5, :5]), rng.normal(size=7), np.empty(7)
    solve(rows.at, 5, y, x)
    np.testing.assert_allclose(R @ x[:5], y[:5], atol=1e-13)
    solve_transposed(rows.at, 5, y, x)
    np.testing.assert_allclose(R.T @ x[:5], y[:5], atol=1e-13)


@unhurried
@given(seed=st.integers(0, 2**32 - 1), moves=st.lists(st.integers(0, 11), max_size=40))
def test_any_sequence_of_rows_that_come_and_go(seed, moves):
    """Moves below 6 take a row out, the others add one; move 6 tries one that depends."""
    rng = np.random.default_rng(seed)
    rows = Rows(6, 6)
    for move in moves:
        count = len(rows.kept)
        if move < 6 and count:
            rows.drop(move % count, rng.normal(size=6))
        elif move == 6 and count:
            assert not rows.add(rng.normal(size=count) @ np.array(rows.kept))
        elif count < 6:
            assert rows.add(rng.normal(size=6), 1.0 if move % 2 else -1.0)
    count = len(rows.kept)
    Q, kept = rows.at.Q[:count], np.array(rows.kept).reshape(-1, 6)
    np.testing.assert_allclose(Q @ Q.T, np.eye(count), atol=1e-10)
    np.testing.assert_allclose(np.triu(rows.at.R[:count, :count]).T @ Q, kept, atol=1e-9)
