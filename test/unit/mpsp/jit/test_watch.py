"""Compiling is noticed when it begins; kernels of others and loading are not."""

from __future__ import annotations

import numba
import pytest

from cmpsp_ros.mpsp.jit.watch import compilations


def kernel(module):
    def square(x):
        return x * x

    square.__module__ = module
    return numba.njit(square)


@pytest.mark.parametrize(('module', 'seen'), [('cmpsp_ros.mpsp.kernel', 1), ('elsewhere', 0)])
def test_the_package_s_kernels_are_named_and_the_first_is_announced(module, seen):
    square, begun = kernel(module), []
    with compilations(lambda: begun.append(square.signatures)) as names:
        assert square(2) == 4
        assert square(2.0) == 4.0
        assert square(3) == 9
    assert len(begun) == seen
    assert begun == [[]] * seen
    assert [name.rpartition('.')[2] for name in names] == ['square'] * 2 * seen


def test_afterwards_nothing_is_noticed():
    square = kernel('cmpsp_ros.mpsp.kernel')
    with compilations() as names:
        pass
    square(2)
    assert names == []
