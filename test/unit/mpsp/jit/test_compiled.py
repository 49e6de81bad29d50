"""Kernels: the bits of Python, and entry points without a look at types."""

from __future__ import annotations

import numpy as np

from cmpsp_ros.mpsp.jit import entry_for
from cmpsp_ros.mpsp.jit.compiled import compiled


def test_the_bits_are_those_of_python():
    def product(x):
        total = 0.0
        for each in x:
            total += each * each
        return total

    x = np.random.default_rng(3).standard_normal(1001)
    assert compiled(product)(x) == product(x)


def test_an_entry_is_the_function_itself_without_the_look_at_types():
    @compiled
    def scaled(x, factor):
        return x * factor

    entry = entry_for(scaled, np.zeros(2), 1.0)
    np.testing.assert_array_equal(entry(np.array([1.0, 2.0, 3.0]), 2.0), [2.0, 4.0, 6.0])
    assert len(scaled.overloads) == 1
