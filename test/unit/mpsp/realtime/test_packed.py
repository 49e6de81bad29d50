"""A workspace in one piece: its views for Python and for compiled code are the same memory."""

import numpy as np
import pytest
from runs import improved, robot_options, robot_problem, room_for

from cmpsp_ros.mpsp.problem import Dimensions
from cmpsp_ros.mpsp.realtime import packed as module
from cmpsp_ros.mpsp.realtime.packed import pack, unpack
from cmpsp_ros.mpsp.realtime.workspace import workspace

SIZES = [
    Dimensions(6, 3, 2, 2, 4),
    Dimensions(6, 5, 2, 2, 2),
    Dimensions(5, 2, 1, 0, 0),
    Dimensions(4, 1, 3, 3, 1),
]
# Room for active rows is that of the longest horizon; horizons of any length begin in it.
WHOLE = {'Q', 'R', 'rows', 'multipliers', 'most', 'conflict', 'inside', 'dependence', 'terminal'}


@pytest.fixture
def in_python(monkeypatch):
    """`unpack` as it is written, run by Python, which can look at the views that it makes."""
    for name in ('_solver', '_trajectory', '_penalty', '_vector', '_matrix', '_stack'):
        monkeypatch.setattr(module, name, getattr(module, name).py_func)
    return unpack.py_func


def made(size):
    rng = np.random.default_rng(0)
    room = workspace(size, rng.random(size.output), rng.random(size.path), rng.random(size.state))
    for _, array in leaves(room):
        array.ravel()[:] = rng.integers(-9, 10, size=array.size)
    return room


def leaves(tree, name=''):
    if isinstance(tree, np.ndarray):
        yield name, tree
    elif hasattr(tree, '_fields'):
        for each, branch in zip(tree._fields, tree, strict=True):
            yield from leaves(branch, f'{name}.{each}')


@pytest.mark.parametrize('size', SIZES, ids=str)
def test_nothing_is_lost_on_the_way(size):
    before = made(size)
    packed, after = pack(before)
    for (name, array), (_, view) in zip(leaves(before), leaves(after), strict=True):
        np.testing.assert_array_equal(view, array, err_msg=name)
        whole = packed.numbers if view.dtype == np.float64 else packed.indices
        assert np.shares_memory(view, whole) or view.size == 0
    held = [sum(a.size for _, a in leaves(after) if a.dtype == kind) for kind in (float, np.int64)]
    assert held == [packed.numbers.size, packed.indices.size]


@pytest.mark.parametrize('size', SIZES, ids=str)
def test_compiled_code_sees_the_same_memory_on_every_horizon(size, in_python):
    packed, room = pack(made(size))
    for N in range(1, size.horizon + 1):
        wanted = dict(leaves(made(Dimensions(N, size.state, size.control, size.output, size.path))))
        found = dict(leaves(in_python(packed, N)))
        assert list(found) == list(wanted)
        for name, whole in leaves(room):
            view, last = found[name], name.split('.')[-1]
            assert view.dtype == whole.dtype
            assert view.strides == whole.strides, name
            if view.size:
                assert view.ctypes.data == whole.ctypes.data, (name, N)
            if size.horizon == N or last in WHOLE or 'hint' in name:
                assert view.shape == whole.shape, (name, N)
            else:
                assert view.shape == wanted[name].shape, (name, N)


def test_what_python_writes_compiled_code_reads():
    problem = robot_problem(12)
    options = robot_options(problem)
    guess = np.full((8, 2), 45.0)
    packed, room = room_for(problem, options)
    shorter = robot_problem(7)
    found = improved(shorter, shorter.data, options, guess, 1, (packed, room))
    np.testing.assert_array_equal(found.at.X[0], problem.data.pose)
    np.testing.assert_array_equal(found.at.X[8:], 0.0)
    room.upper[:] = 40.0
    found = improved(shorter, shorter.data, options, guess, 1, (packed, room))
    assert found.at.U[:8].max() == 40.0
