"""Garbage is collected when there is time; real-time scheduling is had where the system permits."""

import gc
import os
import subprocess
import sys
import threading
import time
import weakref

import pytest

from cmpsp_ros.nodes.guidance.timing import GarbageCollection, Scheduling, check_cpu
from cmpsp_ros.parameters import TABLE, ParameterError


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


# Whoever runs the tests: without the right to a real-time priority in the child.
POWERLESS = """
import os, resource
from cmpsp_ros.nodes.guidance.timing import Scheduling
from cmpsp_ros.parameters import TABLE

resource.setrlimit(resource.RLIMIT_RTPRIO, (0, 0))
if os.getuid() == 0:
    os.setresuid(65534, 65534, 65534)
before = os.sched_getscheduler(0), os.sched_getaffinity(0)
scheduling = Scheduling(TABLE.resolve({'realtime.priority': 42}))
(said,) = scheduling.apply()
assert (os.sched_getscheduler(0), os.sched_getaffinity(0)) == before
scheduling.restore()
print(said)
"""


def values(**given):
    return TABLE.resolve({f'realtime.{key}': value for key, value in given.items()})


def state(thread=0):
    return os.sched_getscheduler(thread) & ~os.SCHED_RESET_ON_FORK, os.sched_getaffinity(thread)


def test_a_thread_is_scheduled_as_configured_until_it_is_let_go():
    core, before = min(os.sched_getaffinity(0)), state()
    for given, wanted in (({}, before), ({'cpu': core}, (before[0], {core}))):
        check_cpu(values(**given))
        scheduling = Scheduling(values(**given))
        for _ in range(2):
            assert scheduling.apply() == []
            assert state() == wanted
            scheduling.restore()
            assert state() == before
    scheduling = Scheduling(values(priority=3))
    if scheduling.apply():
        assert state() == before
    else:
        assert state()[0] == os.SCHED_FIFO
        assert os.sched_getparam(0).sched_priority == 3
    scheduling.restore()
    assert state() == before


def test_other_threads_go_on_as_before():
    pid, ready, asked = [], threading.Event(), threading.Event()

    def other():
        pid.append(threading.get_native_id())
        ready.set()
        asked.wait(100.0)

    thread = threading.Thread(target=other)
    thread.start()
    ready.wait(100.0)
    before = state(pid[0])
    scheduling = Scheduling(values(cpu=min(os.sched_getaffinity(0)), priority=1))
    scheduling.apply()
    seen = state(pid[0])
    scheduling.restore()
    asked.set()
    thread.join()
    assert seen == before


def test_without_the_right_to_it_the_user_is_told_what_would_give_it():
    done = subprocess.run(
        [sys.executable, '-c', POWERLESS], capture_output=True, text=True, check=True
    )
    assert done.stdout.startswith('realtime.priority = 42 was refused (Operation not permitted;')
    for words in ('the limit is 0', '"USER - rtprio 42"', '/etc/security/limits.conf', 'CAP_SYS'):
        assert words in done.stdout


def test_a_core_that_is_not_there_is_refused_and_one_that_has_gone_done_without():
    with pytest.raises(ParameterError, match=r'realtime\.cpu: found 4095, wanted -1 for any, or'):
        check_cpu(values(cpu=4095))
    before = state()
    (said,) = Scheduling(values(cpu=4095)).apply()
    assert said == 'realtime.cpu = 4095 was refused (Invalid argument).'
    assert state() == before


@pytest.mark.parametrize('given', [{'priority': -1}, {'priority': 100}, {'cpu': -2}])
def test_numbers_out_of_range_are_refused(given):
    with pytest.raises(ParameterError, match=f'realtime.{next(iter(given))}'):
        values(**given)
