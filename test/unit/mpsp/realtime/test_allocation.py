"""Improving a plan allocates nothing, neither in compiled code nor to call it."""

import resource
import tracemalloc
from importlib import import_module
from pkgutil import iter_modules

import numba
import numpy as np
import pytest
from runs import robot_options, robot_problem, room_for, rules

from cmpsp_ros.mpsp import realtime, riccati
from cmpsp_ros.mpsp.jit.compiled import allocation_free
from cmpsp_ros.mpsp.realtime.iteration import improve
from cmpsp_ros.robot import differential_drive, guidance_functions

CALLS = 1000


def modules():
    yield from (differential_drive, guidance_functions)
    for package in (realtime, riccati):
        for each in iter_modules(package.__path__):
            yield import_module(f'{package.__name__}.{each.name}')


def test_a_kernel_that_would_make_an_array_is_refused():
    @allocation_free
    def wasteful(n):
        return np.zeros(n).sum()

    with pytest.raises(numba.core.errors.NumbaError):
        wasteful(3)


@pytest.mark.parametrize('module', list(modules()), ids=lambda module: module.__name__)
def test_every_kernel_is_compiled_to_make_none(module):
    for name, each in vars(module).items():
        if isinstance(each, numba.core.dispatcher.Dispatcher):
            assert each.targetoptions.get('_nrt') is False, name


def test_a_thousand_plans_need_no_memory():
    problem = robot_problem(50)
    options = robot_options(problem)
    packed, room = room_for(problem, options)
    guess, data, asked = np.full((51, 2), 45.0), problem.data, rules(problem, options, 2)

    def plan():
        room.at.U[:] = guess
        improve(data, packed, 50, 51, asked)

    tracemalloc.start()
    for _ in range(CALLS):
        plan()
    held, _ = tracemalloc.get_traced_memory()
    tracemalloc.reset_peak()
    resident = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    for _ in range(CALLS):
        plan()
    left, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    # Python's lists of free objects may grow a little; one object kept a call would be more.
    assert left - held < 8 * CALLS
    # Numbers and tuples that are handed over; the room itself is ten times as large.
    assert peak - held < packed.numbers.nbytes / 10
    grown = 1024 * (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - resident)
    assert grown < packed.numbers.nbytes * CALLS / 100
