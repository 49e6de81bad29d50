"""Real-time scheduling: had where the system permits it, done without where it does not."""

from __future__ import annotations

import os
import subprocess
import sys
import threading

import pytest

from cmpsp_ros.nodes.guidance.timing import Scheduling, check_cpu
from cmpsp_ros.parameters import TABLE, ParameterError

# Whoever runs the tests: without the right to a real-time priority in the child.
POWERLESS = """
import ctypes, os, resource, sys
from cmpsp_ros.nodes.guidance.timing import Scheduling
from cmpsp_ros.parameters.catalogue import TABLE

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


@pytest.fixture
def core():
    """A core that this process may run on."""
    return min(os.sched_getaffinity(0))


def values(**given):
    return TABLE.resolve({f'realtime.{key}': value for key, value in given.items()})


def test_by_default_nothing_is_touched():
    before = os.sched_getscheduler(0), os.sched_getaffinity(0)
    check_cpu(values())
    scheduling = Scheduling(values())
    assert scheduling.apply() == []
    assert (os.sched_getscheduler(0), os.sched_getaffinity(0)) == before
    scheduling.restore()


def test_a_thread_stays_on_its_core_until_it_is_let_go(core):
    before = os.sched_getaffinity(0)
    scheduling = Scheduling(values(cpu=core))
    for _ in range(2):
        assert scheduling.apply() == []
        assert os.sched_getaffinity(0) == {core}
        scheduling.restore()
        assert os.sched_getaffinity(0) == before


def test_other_threads_go_on_as_before(core):
    pid, seen, ready, asked = [], [], threading.Event(), threading.Event()

    def other():
        pid.append(threading.get_native_id())
        ready.set()
        asked.wait(10.0)

    thread = threading.Thread(target=other)
    thread.start()
    ready.wait(10.0)
    before = os.sched_getaffinity(pid[0])
    scheduling = Scheduling(values(cpu=core, priority=1))
    scheduling.apply()
    seen.append((os.sched_getaffinity(pid[0]), os.sched_getscheduler(pid[0])))
    scheduling.restore()
    asked.set()
    thread.join()
    assert seen == [(before, os.SCHED_OTHER)]


def test_a_priority_is_had_or_its_refusal_told():
    before = os.sched_getscheduler(0) & ~os.SCHED_RESET_ON_FORK
    scheduling = Scheduling(values(priority=3))
    refused = scheduling.apply()
    had = os.sched_getscheduler(0) & ~os.SCHED_RESET_ON_FORK
    if refused:
        assert had == before
    else:
        assert had == os.SCHED_FIFO
        assert os.sched_getparam(0).sched_priority == 3
    scheduling.restore()
    assert os.sched_getscheduler(0) & ~os.SCHED_RESET_ON_FORK == before


def test_without_the_right_to_it_the_user_is_told_what_would_give_it():
    done = subprocess.run(
        [sys.executable, '-c', POWERLESS], capture_output=True, text=True, check=True
    )
    assert done.stdout.startswith('realtime.priority = 42 was refused (Operation not permitted;')
    for words in ('the limit is 0', '"USER - rtprio 42"', '/etc/security/limits.conf', 'CAP_SYS'):
        assert words in done.stdout


def test_a_core_that_is_not_there_is_refused(core):
    check_cpu(values(cpu=core))
    with pytest.raises(ParameterError, match=r'realtime\.cpu: found 4095, wanted -1 for any, or'):
        check_cpu(values(cpu=4095))


def test_a_core_that_has_gone_since_is_done_without():
    before = os.sched_getaffinity(0)
    (said,) = Scheduling(values(cpu=4095)).apply()
    assert said == 'realtime.cpu = 4095 was refused (Invalid argument).'
    assert os.sched_getaffinity(0) == before


@pytest.mark.parametrize('given', [{'priority': -1}, {'priority': 100}, {'cpu': -2}])
def test_numbers_out_of_range_are_refused(given):
    with pytest.raises(ParameterError, match=f'realtime.{next(iter(given))}'):
        values(**given)
