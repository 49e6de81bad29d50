"""Improving a plan allocates nothing, neither in compiled code nor to call it."""

import resource
import tracemalloc
from importlib import import_module
from pkgutil import iter_modules

import numba
import numpy as np
import pytest
from robot_runs import driver_for, improve, robot_options, robot_problem

from cmpsp_ros.guidance.formulation import FUNCTIONS, ocp_functions
from cmpsp_ros.mpsp import sqp
from cmpsp_ros.mpsp.jit import allocation_free
from cmpsp_ros.mpsp.qp import active_set, riccati
from cmpsp_ros.robots import differential_drive
from cmpsp_ros.robots.motion import kinematics

# What they call takes long to compile: by one worker.
pytestmark = pytest.mark.xdist_group('riccati')

CALLS = 500


def test_a_kernel_that_would_make_an_array_is_refused():
    @allocation_free
    def wasteful(n):
        return np.zeros(n).sum()

    with pytest.raises(numba.core.errors.NumbaError):
        wasteful(3)


def test_every_kernel_is_compiled_to_make_none():
    modules, kernels = [differential_drive, kinematics, ocp_functions], 0
    for package in (sqp, active_set, riccati):
        modules += [
            import_module(f'{package.__name__}.{each.name}')
            for each in iter_modules(package.__path__)
        ]
    for module in modules:
        for name, each in vars(module).items():
            if isinstance(each, numba.core.dispatcher.Dispatcher):
                assert each.targetoptions.get('_nrt') is False, (module, name)
                kernels += 1
    assert kernels > 100


def test_many_plans_need_no_memory():
    problem = robot_problem(50)
    driver = driver_for(problem, robot_options(problem))
    guess, entries = np.full((51, 2), 45.0), FUNCTIONS.entries(problem.data, driver.ws)
    size = driver.ws.program.stages.nbytes

    def plan():
        improve(driver, problem.data, guess, 2, 0, entries)

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
    # Numbers and tuples that are handed over.
    assert peak - held < size / 10
    grown = 1024 * (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - resident)
    assert grown < size * CALLS / 100
