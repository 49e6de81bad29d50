"""Kernels: compiled once, chosen by the class of their data, and loaded by the next process."""

from __future__ import annotations

import json
import subprocess
import sys
from typing import Any, NamedTuple

import numpy as np
import pytest

from cmpsp_ros.mpsp.jit.compiled import allocation_free, compiled, entry_for, implements, inlined

# Two classes of data, one loop for both; it says what it computed and what came from the cache.
PROGRAM = """
import json
from typing import NamedTuple

from cmpsp_ros.mpsp.jit.compiled import compiled, implements


class Line(NamedTuple):
    slope: float


class Parabola(NamedTuple):
    curvature: float


def value(data, x):
    raise NotImplementedError


@implements(value, Line)
def line_value(data, x):
    return data.slope * x


@implements(value, Parabola)
def parabola_value(data, x):
    return 0.5 * data.curvature * x * x


@compiled
def total(data, n):
    found = 0.0
    for k in range(n):
        found += value(data, float(k))
    return found


if __name__ == '__main__':
    import shapes

    found = [shapes.total(shapes.Line(2.0), 4), shapes.total(shapes.Parabola(2.0), 4)]
    stats = shapes.total.stats
    hits, misses = sum(stats.cache_hits.values()), sum(stats.cache_misses.values())
    print(json.dumps({'found': found, 'hits': hits, 'misses': misses}))
"""


@pytest.fixture
def run(tmp_path, monkeypatch):
    """Run the program, or another version of it, as a process with a cache of its own."""
    monkeypatch.setenv('NUMBA_CACHE_DIR', str(tmp_path / 'cache'))
    path = tmp_path / 'shapes.py'

    def run_program(source=PROGRAM):
        path.write_text(source)
        command = [sys.executable, str(path)]
        done = subprocess.run(command, capture_output=True, text=True, check=True)
        return json.loads(done.stdout)

    return run_program


def test_a_loop_is_compiled_for_each_class_and_loaded_by_the_next_process(run):
    assert run() == {'found': [12.0, 14.0], 'hits': 0, 'misses': 2}
    assert run() == {'found': [12.0, 14.0], 'hits': 2, 'misses': 0}


IMPLEMENTATION = """
from typing import NamedTuple

from cmpsp_ros.mpsp.jit.compiled import implements
from loop import value


class Line(NamedTuple):
    slope: float


@implements(value, Line)
def line_value(data, x):
    return data.slope * x
"""
LOOP = """
from cmpsp_ros.mpsp.jit.compiled import compiled


def value(data, x):
    raise NotImplementedError


@compiled
def twice(data, x):
    return 2.0 * value(data[0], x)
"""
MAIN = """
from line import Line
from loop import twice

print(twice((Line(3.0), 1), 1.0), sum(twice.stats.cache_hits.values()))
"""


def test_a_changed_implementation_in_another_file_is_noticed(tmp_path, monkeypatch):
    monkeypatch.setenv('NUMBA_CACHE_DIR', str(tmp_path / 'cache'))
    for name, source in (('loop', LOOP), ('line', IMPLEMENTATION), ('main', MAIN)):
        (tmp_path / f'{name}.py').write_text(source)

    def said():
        command = [sys.executable, str(tmp_path / 'main.py')]
        return subprocess.run(command, capture_output=True, text=True, check=True).stdout.split()

    assert said() == ['6.0', '0']
    assert said() == ['6.0', '1']
    (tmp_path / 'line.py').write_text(IMPLEMENTATION.replace('slope * x', 'slope + x'))
    assert said() == ['8.0', '0']


class Disc(NamedTuple):
    radius: float


class Box(NamedTuple):
    width: float
    height: float


def area(data: Any, scale: float) -> float:
    raise NotImplementedError


@implements(area, Disc)
def disc_area(data: Disc, scale: float) -> float:
    return float(scale * np.pi * data.radius**2)


@implements(area, Box)
def box_area(data: Box, scale: float) -> float:
    return scale * data.width * data.height


@compiled
def half_area(data: Any) -> float:
    return 0.5 * area(data, 1.0)


def test_the_data_chooses_the_implementation():
    assert half_area(Disc(1.0)) == np.pi / 2.0
    assert half_area(Box(2.0, 3.0)) == 3.0


def test_an_implementation_can_be_called_by_itself():
    assert box_area(Box(2.0, 3.0), 2.0) == 12.0
    assert box_area.__name__ == 'box_area'


def test_parameters_named_otherwise_are_refused():
    with pytest.raises(TypeError, match=r'\(data, by\), wanted \(data, scale\) as area'):

        @implements(area, Box)
        def _(data, by):
            return by


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


def test_a_function_can_become_a_part_of_its_callers():
    @inlined
    def add(x, y):
        for i in range(x.shape[0]):
            x[i] += y

    @allocation_free
    def add_twice(x, y):
        add(x, y)
        add(x, 2.0 * y)

    x = np.arange(3.0)
    add_twice(x, 1.0)
    np.testing.assert_array_equal(x, [3.0, 4.0, 5.0])
