"""Inner products, to the last bit."""

import numpy as np
import pytest
from numba.core.errors import TypingError

from cmpsp_ros.mpsp.jit.intrinsics import dot

RNG = np.random.default_rng(8)
A, B = RNG.normal(size=(2, 120))


def by_hand(a, b):
    """Eight sums side by side, added two by two, and then what is left over."""
    whole = len(a) - len(a) % 8
    sums = [0.0] * 8
    for i in range(whole):
        sums[i % 8] += a[i] * b[i]
    four = [low + high for low, high in zip(sums[:4], sums[4:], strict=True)]
    total = (four[0] + four[1]) + (four[2] + four[3])
    for i in range(whole, len(a)):
        total += a[i] * b[i]
    return total


@pytest.mark.parametrize('begin', [0, 1, 3])
def test_the_order_is_laid_down(begin):
    a, b = A[begin:], B[begin:]
    for length in range(len(a) + 1):
        assert dot(a, b, length) == by_hand(a[:length], b[:length])


def test_another_order_would_show():
    products = (A * B).tolist()
    assert dot(A, B, 120) not in (sum(products), sum(reversed(products)))


@pytest.mark.parametrize('length', [5, 8, 21])
def test_what_is_not_finite_shows(length):
    for wrong in (np.nan, np.inf):
        for at in range(length):
            a = A.copy()
            a[at] = wrong
            assert not np.isfinite(dot(a, B, length))
            a[at:] = np.nan
            assert np.isfinite(dot(a, B, at))


def test_a_row_that_has_gaps_is_refused():
    with pytest.raises(TypingError, match='wanted contiguous rows of float64'):
        dot(A[::2], B, 8)
    with pytest.raises(TypingError, match='wanted contiguous rows of float64'):
        dot(A.astype(np.float32), B, 8)
