"""Everything that can cut a run of `cmpsp demo` short."""

from __future__ import annotations

import os
import signal
from pathlib import Path

import pytest
from demo_folder import LIMIT, commands

from cmpsp_ros.bags.runs.run import read_run
from cmpsp_ros.nodes import MODULES

pytestmark = pytest.mark.integration


def children(pid):
    """Name and process id of the nodes that a process has started."""
    found = {}
    for folder in Path('/proc').iterdir():
        if folder.name.isdigit() and status(int(folder.name))[1] == pid:
            command = (folder / 'cmdline').read_bytes().decode().split('\0')
            names = [name for name, module in MODULES.items() if module in command]
            if names:
                found[names[0]] = int(folder.name)
    return found


def status(pid):
    """State and parent of a process; 'X' when there is none."""
    try:
        state, parent = Path(f'/proc/{pid}/stat').read_text().rsplit(')', 1)[1].split()[:2]
    except (OSError, ValueError):
        return 'X', 0
    return state, int(parent)


def are_gone(pids):
    # One that was adopted may wait for ever to be buried.
    return all(status(pid)[0] in 'XZ' for pid in pids)


def decided(folder):
    """Whether the demo's run is well under way."""
    log = folder / 'guidance_node.log'
    return log.exists() and 'nominal' in log.read_text()


@pytest.mark.parametrize(
    'number', [pytest.param(signal.SIGINT, marks=pytest.mark.smoke), signal.SIGTERM]
)
def test_an_interrupted_run_leaves_a_readable_bag_and_a_robot_that_stands(
    start_demo, tmp_path, wait_until, number
):
    folder = tmp_path / 'run'
    running = start_demo('case3', '--output', folder)
    wait_until(lambda: decided(folder), LIMIT)
    nodes = children(running.pid)
    assert set(nodes) == {'recorder', 'sim_node', 'guidance_node'}
    running.signal(number)
    assert running.wait(LIMIT) == 130
    assert are_gone(nodes.values())
    assert 'Traceback' not in running.stderr
    assert 'interrupted' in running.stderr
    _, twists = commands(folder)
    assert twists[0][0] > 0.5
    assert twists[-1] == (0.0, 0.0)
    run = read_run(folder / 'bag')
    assert run.decisions[-1].reason == 'The guidance node is shutting down.'
    assert run.driven.twists[-1].tolist() == [0.0, 0.0]
    assert not (folder / 'summary.json').exists()


def test_an_interruption_while_nodes_start_leaves_none_running(start_demo, tmp_path, wait_until):
    folder = tmp_path / 'run'
    running = start_demo('case3', '--output', folder)
    nodes = wait_until(lambda: children(running.pid), LIMIT)
    running.signal(signal.SIGINT)
    nodes.update(children(running.pid))
    assert running.wait(LIMIT) == 130
    assert 'Traceback' not in running.stderr
    # One that was not yet known to the demo goes when it sees that the demo has gone.
    wait_until(lambda: are_gone(nodes.values()), LIMIT)


def test_a_second_interruption_does_not_leave_a_node_behind(start_demo, tmp_path, wait_until):
    folder = tmp_path / 'run'
    running = start_demo('case3', '--output', folder)
    wait_until(lambda: decided(folder), LIMIT)
    nodes = children(running.pid)
    running.signal(signal.SIGINT)
    wait_until(lambda: status(nodes['guidance_node'])[0] in 'XZ', LIMIT)
    running.signal(signal.SIGINT)
    assert running.wait(LIMIT) == 130
    wait_until(lambda: are_gone(nodes.values()), LIMIT)
    _, twists = commands(folder)
    assert twists[-1] == (0.0, 0.0)
    assert 'Traceback' not in running.stderr


def test_a_killed_demo_leaves_no_node_running(start_demo, tmp_path, wait_until):
    folder = tmp_path / 'run'
    running = start_demo('case3', '--output', folder)
    wait_until(lambda: decided(folder), LIMIT)
    nodes = children(running.pid)
    assert len(nodes) == 3
    running.signal(signal.SIGKILL)
    assert running.wait() == -signal.SIGKILL
    wait_until(lambda: are_gone(nodes.values()), LIMIT)
    _, twists = commands(folder)
    assert twists[-1] == (0.0, 0.0)


@pytest.mark.parametrize('name', ['guidance_node', 'sim_node', 'recorder'])
def test_a_node_that_dies_ends_the_run_and_is_named(start_demo, tmp_path, wait_until, name):
    folder = tmp_path / 'run'
    running = start_demo('case3', '--output', folder)
    wait_until(lambda: decided(folder), LIMIT)
    nodes = children(running.pid)
    os.kill(nodes[name], signal.SIGKILL)
    assert running.wait(LIMIT) == 1
    assert f'{name} ended with exit code -9' in running.stderr
    assert 'Traceback' not in running.stderr
    assert are_gone(nodes.values())
