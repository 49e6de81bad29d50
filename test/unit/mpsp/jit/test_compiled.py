"""Kernels: the bits of Python, entries without dispatch, calls by address, inner products."""

from functools import reduce
from operator import add
from typing import NamedTuple

import numpy as np
import pytest
from numba.core.errors import TypingError

from cmpsp_ros.mpsp.jit import address_of, allocation_free, call, entry_for
from cmpsp_ros.mpsp.jit.compiled import call_for_float, call_for_int, inner, tuple_at, words_of
from cmpsp_ros.mpsp.jit.intrinsics import dot


def test_the_bits_are_those_of_python():
    def product(x):
        total = 0.0
        for k in range(len(x)):
            total += x[k] * x[k]
        return total

    x = np.random.default_rng(3).standard_normal(1001)
    assert allocation_free(product)(x) == product(x)


@allocation_free
def scaled(values, by):
    return by * values[0]


@allocation_free
def count(values):
    return values.shape[0]


@allocation_free
def fill(values, by):
    values[1] = by


@allocation_free
def all_of_them(addresses, values):
    call(addresses[2], (values, 7.0))
    return call_for_float(addresses[0], (values, 3.0)) + call_for_int(addresses[1], (values,))


def test_an_entry_is_the_function_itself_without_the_look_at_types():
    entry = entry_for(scaled, np.zeros(2), 1.0)
    assert entry(np.array([3.0, 2.0]), 2.0) == 6.0
    assert len(scaled.overloads) == 1


def test_each_is_called_with_its_arguments():
    values = np.array([2.0, 0.0, 0.0])
    found = [address_of(float, scaled, values, 1.0), address_of(int, count, values)]
    found.append(address_of(None, fill, values, 1.0))
    assert all_of_them(np.array(found), values) == 9.0
    assert values.tolist() == [2.0, 7.0, 0.0]


def test_what_returns_something_else_is_refused():
    with pytest.raises(TypeError, match='count: found int64 returned, wanted float64'):
        address_of(float, count, np.zeros(2))


class Pair(NamedTuple):
    row: np.ndarray
    counts: np.ndarray


class Memory(NamedTuple):
    table: np.ndarray
    pair: Pair
    every_other: np.ndarray


@inner
def mix(memory, by):
    for i in range(memory.table.shape[0]):
        for j in range(memory.table.shape[1]):
            memory.table[i, j] += by * memory.pair.row[j] * memory.pair.counts[i]
    for k in range(memory.every_other.shape[0]):
        memory.every_other[k] = 10.0 * k


@allocation_free
def mix_at(address, function, by):
    call(function, (tuple_at(address), by))


def test_a_tuple_of_arrays_is_passed_by_the_address_of_its_words():
    table, line = np.zeros((2, 3)), np.zeros(6)
    pair = Pair(np.array([1.0, 2.0, 3.0]), np.array([5, 7]))
    memory = Memory(table, pair, line[::2])
    words = np.array(words_of(memory))
    function = address_of(None, mix, memory, 1.0)
    for _ in range(2):
        mix_at(words.ctypes.data, function, 0.5)
    assert table.tolist() == [[5.0, 10.0, 15.0], [7.0, 14.0, 21.0]]
    assert line.tolist() == [0.0, 0.0, 10.0, 0.0, 20.0, 0.0]


def test_words_are_of_arrays_only():
    with pytest.raises(TypeError, match=r'found 3\.0, wanted an array'):
        words_of((np.zeros(2), 3.0))


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
    # From Python 3.12 on `sum` takes rounding out.
    products = (A * B).tolist()
    orders = products, products[::-1]
    assert dot(A, B, 120) not in [reduce(add, each) for each in orders]


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
