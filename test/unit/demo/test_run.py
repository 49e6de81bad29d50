"""Getting the nodes of a run ready, with nodes that are not there."""

from __future__ import annotations

import subprocess
import sys

import pytest

from cmpsp_ros.demo import Child, DemoError, load_scenario
from cmpsp_ros.demo.runner import _get_ready
from cmpsp_ros.nodes import LifecycleClient

CASE3 = load_scenario('case3', [], lockstep=True)
WORDS = 'compiling, once; `cmpsp warmup` does it beforehand'


class Stubborn(LifecycleClient):
    """Ask for the guidance node's states and hear what a test says, without ROS."""

    def __init__(self, answer):
        self._answer = answer

    def configure(self, timeout, namespace, still_compiles):
        self.waits = still_compiles()
        if self._answer is None:
            raise TimeoutError(f'no answer within {timeout:.0f} s')
        return self._answer


@pytest.fixture
def child(tmp_path):
    """A process that says something and stays, or ends: `child(code)`."""
    started = []

    def start(code=''):
        log = tmp_path / 'guidance_node.log'
        log.write_text(f'{WORDS}\n')
        command = [sys.executable, '-c', code or 'input()']
        process = subprocess.Popen(command, stdin=subprocess.PIPE, stderr=subprocess.DEVNULL)
        started.append(process)
        if code:
            process.wait(20.0)
        return Child('guidance_node', process, log)

    yield start
    for process in started:
        process.kill()
        process.communicate()


def test_a_node_that_does_not_answer_is_no_node_that_refuses(child):
    with pytest.raises(DemoError, match=r'no answer within 30 s; it said:\ncompiling, once'):
        _get_ready(Stubborn(None), [child()], [CASE3], record=True)


def test_a_node_that_compiles_is_waited_for_while_it_lives(child, capsys):
    observer, node = Stubborn(None), child()
    node.log.write_text('[INFO] [guidance]: Compiling kernels (once): 12: solve\n')
    with pytest.raises(DemoError, match='no answer'):
        _get_ready(observer, [node], [CASE3], record=True)
    assert observer.waits
    assert capsys.readouterr().err == 'guidance_node: Compiling kernels (once): 12: solve\n'
    node.log.write_text('[INFO] [guidance]: compiled 240 kernels in 61.0 s\n')
    assert not node.still_compiles()
    assert not child('raise SystemExit(3)').still_compiles()


def test_a_node_that_has_ended_is_told_as_such(child):
    with pytest.raises(DemoError, match='guidance_node ended with exit code 3'):
        _get_ready(Stubborn(None), [child('raise SystemExit(3)')], [CASE3], record=True)


def test_a_node_that_refuses_says_why(child):
    with pytest.raises(DemoError, match=r'refuses to start:\ncompiling'):
        _get_ready(Stubborn(False), [child()], [CASE3], record=True)
