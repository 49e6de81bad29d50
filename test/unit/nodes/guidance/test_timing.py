"""Garbage is collected when there is time; a core that has gone is done without."""

import gc
import os
import time
import weakref

import pytest

from cmpsp_ros.nodes.guidance.timing import GarbageCollection, Scheduling
from cmpsp_ros.parameters import TABLE


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
def collected():
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


def test_cycles_do_not_pile_up_and_old_ones_go_with_a_full_collection(garbage):
    garbage.begin()
    old = [Knot() for _ in range(10)]
    aged, alive, most = weakref.WeakSet(old), weakref.WeakSet(), 0
    for step in range(300):
        for _ in range(10):
            alive.add(Knot())
        garbage.collect()
        most = max(most, len(alive))
        if step == 5:
            old.clear()
    # One young collection may leave what an older generation holds, until the full one.
    assert most <= 10 * 50
    assert not aged


def test_full_collections_are_now_and_then_and_none_without_time(garbage, collected):
    garbage.begin()
    collected.clear()
    for _ in range(102):
        garbage.collect()
    assert (collected.count(2), collected.count(1)) == (2, 100)
    collected.clear()
    for slack in (0.0, -1.0, 1e-9):
        garbage.collect(slack)
    assert collected == []


def test_too_long_without_time_is_told(garbage):
    assert not garbage.overdue
    garbage.begin()
    assert not garbage.overdue
    time.sleep(1.0)
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


def test_a_core_that_has_gone_is_done_without():
    before = os.sched_getaffinity(0)
    (said,) = Scheduling(TABLE.resolve({'realtime.cpu': 4095})).apply()
    assert 'realtime.cpu = 4095 was refused' in said
    assert os.sched_getaffinity(0) == before
