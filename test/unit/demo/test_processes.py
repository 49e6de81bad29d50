"""The domain of a run, and the start of its processes."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys

import pytest

from cmpsp_ros.demo import DemoError, processes


@pytest.fixture
def environment(monkeypatch):
    """The two variables, put back at the end, and a process number that chooses domain 7."""
    monkeypatch.setenv('ROS_DOMAIN_ID', '0')
    monkeypatch.setenv('ROS_AUTOMATIC_DISCOVERY_RANGE', 'SUBNET')
    monkeypatch.setattr(os, 'getpid', lambda: 206)
    return monkeypatch


def test_the_choice_is_left_to_the_children_and_stays_on_this_machine(environment):
    environment.setattr(processes, '_is_free', lambda domain: True)
    assert processes.use_free_domain() == 7
    assert os.environ['ROS_DOMAIN_ID'] == '7'
    assert os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] == 'LOCALHOST'


def test_domains_in_use_are_passed_over_round_the_end(environment):
    tried = []
    environment.setattr(processes, '_is_free', lambda domain: tried.append(domain) or domain == 3)
    assert processes.use_free_domain() == 3
    assert tried == [*range(7, 101), 1, 2, 3]


def test_no_domain_left(environment):
    environment.setattr(processes, '_is_free', lambda domain: False)
    with pytest.raises(DemoError, match='ROS domains 1 to 100 are all in use'):
        processes.use_free_domain()
    assert os.environ['ROS_DOMAIN_ID'] == '0'


def test_a_domain_is_in_use_when_its_first_participant_s_port_is():
    with socket.socket(type=socket.SOCK_DGRAM) as taken:
        for domain in range(60, 0, -1):
            try:
                taken.bind(('127.0.0.1', 7400 + 250 * domain + 10))
            except OSError:
                continue
            break
        assert not processes._is_free(domain)


# What is registered for a fork stays for the life of a process.
INTERRUPTED = """
import os, pathlib, signal, sys
from cmpsp_ros.demo.processes import Child
number = signal.Signals(int(sys.argv[1]))
def interrupt(number, frame):
    raise KeyboardInterrupt
signal.signal(number, interrupt)
os.register_at_fork(after_in_parent=lambda: signal.raise_signal(number))
try:
    Child.start('recorder', [], pathlib.Path(sys.argv[2]))
except KeyboardInterrupt:
    print('interrupted', signal.getsignal(number) is interrupt)
"""


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
def test_an_interruption_while_a_node_is_started_is_not_forgotten(tmp_path, number):
    command = [sys.executable, '-c', INTERRUPTED, str(int(number)), str(tmp_path)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=True)
    assert (done.stdout, done.stderr) == ('interrupted True\n', '')
