"""The garbage collector runs when there is time for it, and memory does not grow for want of it."""

from __future__ import annotations

import gc
import weakref

import pytest

from cmpsp_ros.nodes.guidance.timing import GarbageCollection

STEPS = 300


class Knot:
    """Garbage that only a collector gets rid of."""

    def __init__(self):
        self.itself = self


@pytest.fixture
def garbage():
    collection = GarbageCollection()
    yield collection
    collection.end()
    assert gc.isenabled()
    assert gc.get_freeze_count() == 0


@pytest.fixture
def collected(monkeypatch):
    """Generations collected since."""
    seen = []

    def notice(phase, info):
        if phase == 'stop':
            seen.append(info['generation'])

    gc.callbacks.append(notice)
    yield seen
    gc.callbacks.remove(notice)


def test_python_collects_nothing_by_itself_until_the_end(garbage, collected):
    garbage.begin()
    collected.clear()
    knots = [Knot() for _ in range(5000)]
    assert collected == []
    assert not gc.isenabled()
    del knots
    garbage.end()
    assert gc.isenabled()


def test_cycles_do_not_pile_up(garbage):
    garbage.begin()
    alive = weakref.WeakSet()
    most = 0
    for _ in range(STEPS):
        for _ in range(10):
            alive.add(Knot())
        garbage.collect()
        most = max(most, len(alive))
    # One young collection may leave what an older generation holds, until the full one.
    assert most <= 10 * 50


def test_cycles_that_grew_old_go_with_a_full_collection(garbage):
    garbage.begin()
    old = [Knot() for _ in range(10)]
    alive = weakref.WeakSet(old)
    for _ in range(5):
        garbage.collect()
    old.clear()
    for _ in range(60):
        garbage.collect()
    assert not alive


def test_full_collections_are_now_and_then(garbage, collected):
    garbage.begin()
    collected.clear()
    for _ in range(102):
        garbage.collect()
    assert collected.count(2) == 2
    assert collected.count(1) == 100


def test_without_time_nothing_is_collected(garbage, collected):
    garbage.begin()
    garbage.collect()
    collected.clear()
    for slack in (0.0, -1.0, 1e-9):
        garbage.collect(slack)
    assert collected == []


def test_too_long_without_time_is_told(garbage, monkeypatch):
    clock = [1000.0]
    monkeypatch.setattr('time.monotonic', lambda: clock[0])
    assert not garbage.overdue
    garbage.begin()
    assert not garbage.overdue
    clock[0] += 1.5
    assert garbage.overdue
    garbage.collect()
    assert not garbage.overdue


def test_before_the_beginning_and_after_the_end_it_leaves_everything_alone(garbage, collected):
    garbage.collect()
    garbage.end()
    assert collected == []
    for _ in range(2):
        garbage.begin()
        garbage.end()
        assert gc.isenabled()
    assert not garbage.overdue
