"""Compiled functions that are called by their addresses."""

import numpy as np
import pytest

from cmpsp_ros.mpsp.jit import address_of, allocation_free, call
from cmpsp_ros.mpsp.jit.compiled import call_for_float, call_for_int


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


def test_each_is_called_with_its_arguments():
    values = np.array([2.0, 0.0, 0.0])
    found = [address_of(float, scaled, values, 1.0), address_of(int, count, values)]
    found.append(address_of(None, fill, values, 1.0))
    assert all_of_them(np.array(found), values) == 9.0
    assert values.tolist() == [2.0, 7.0, 0.0]


def test_what_returns_something_else_is_refused():
    with pytest.raises(TypeError, match='count: found int64 returned, wanted float64'):
        address_of(float, count, np.zeros(2))
