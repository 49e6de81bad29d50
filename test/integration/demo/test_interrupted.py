"""Everything that can cut a run of `cmpsp demo` short."""

import os
import re
import resource
import signal
import time
from pathlib import Path

import pytest
from demo_folder import commands

from cmpsp_ros.bags import Bag
from cmpsp_ros.bags.runs import read_run
from cmpsp_ros.nodes import MODULES


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
    """True once the demo's run is well under way."""
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
    wait_until(lambda: decided(folder))
    nodes = children(running.pid)
    assert set(nodes) == {'recorder', 'sim_node', 'guidance_node'}
    running.signal(number)
    assert running.wait() == 130
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
    nodes = wait_until(lambda: children(running.pid))
    running.signal(signal.SIGINT)
    nodes.update(children(running.pid))
    assert running.wait() == 130
    assert 'Traceback' not in running.stderr
    # One that was not yet known to the demo goes when it sees that the demo has gone.
    wait_until(lambda: are_gone(nodes.values()))


def test_a_second_interruption_does_not_leave_a_node_behind(start_demo, tmp_path, wait_until):
    folder = tmp_path / 'run'
    running = start_demo('case3', '--output', folder)
    wait_until(lambda: decided(folder))
    nodes = children(running.pid)
    running.signal(signal.SIGINT)
    wait_until(lambda: status(nodes['guidance_node'])[0] in 'XZ')
    running.signal(signal.SIGINT)
    assert running.wait() == 130
    wait_until(lambda: are_gone(nodes.values()))
    _, twists = commands(folder)
    assert twists[-1] == (0.0, 0.0)
    assert 'Traceback' not in running.stderr


def test_a_killed_demo_leaves_no_node_running(start_demo, tmp_path, wait_until):
    folder = tmp_path / 'run'
    running = start_demo('case3', '--output', folder)
    wait_until(lambda: decided(folder))
    nodes = children(running.pid)
    assert len(nodes) == 3
    running.signal(signal.SIGKILL)
    assert running.wait() == -signal.SIGKILL
    wait_until(lambda: are_gone(nodes.values()))
    _, twists = commands(folder)
    assert twists[-1] == (0.0, 0.0)


@pytest.mark.parametrize('name', ['guidance_node', 'sim_node', 'recorder'])
def test_a_node_that_dies_ends_the_run_and_is_named(start_demo, tmp_path, wait_until, name):
    folder = tmp_path / 'run'
    running = start_demo('case3', '--output', folder)
    wait_until(lambda: decided(folder))
    nodes = children(running.pid)
    os.kill(nodes[name], signal.SIGKILL)
    assert running.wait() == 1
    assert f'{name} ended with exit code -9' in running.stderr
    assert 'Traceback' not in running.stderr
    assert are_gone(nodes.values())


def test_a_full_disk_ends_the_run_and_is_named(start_demo, tmp_path):
    folder = tmp_path / 'run'
    running = start_demo('case3', '--lockstep', '--output', folder)
    resource.prlimit(running.pid, resource.RLIMIT_FSIZE, (50_000, 50_000))
    assert running.wait() == 1
    said = ' '.join(running.stderr.split())
    assert 'recorder ended with exit code 1' in said
    assert f'{folder}/bag: cannot write to the bag: [Errno 27] File too large' in said
    assert 'Traceback' not in said


def test_what_the_recorder_loses_is_said_and_the_run_is_judged(start_demo, tmp_path, wait_until):
    folder = tmp_path / 'run'
    running = start_demo('case3', '--output', folder)
    wait_until(lambda: decided(folder))
    recorder = children(running.pid)['recorder']
    os.kill(recorder, signal.SIGSTOP)
    # Of commands only the newest is kept for who is not there.
    resumed = time.monotonic() + 3.0
    wait_until(lambda: time.monotonic() > resumed)
    os.kill(recorder, signal.SIGCONT)
    assert running.wait() == 0, running.stderr
    lost = r'recorder: (\S+): (\d+) messages, between [\d.]+ and [\d.]+ s of the recording'
    found = dict(re.findall(lost, ' '.join(running.stderr.split())))
    assert int(found['/cmd_vel']) > 0
    with Bag(folder / 'bag') as bag:
        sent, decided_on = (
            bag.topics[each].count + int(found.get(each, 0))
            for each in ('/cmd_vel', '/guidance/decision')
        )
    assert sent == decided_on
    assert 'after 15 s the recorder lacks messages: /cmd_vel' in ' '.join(running.stderr.split())


@pytest.mark.parametrize(
    ('assignment', 'why'),
    [
        ('sim.scan.rate=0.0', 'listens to scan. The simulator has no scanner: sim.scan.rate is 0.'),
        ('sensors.front.topic=abc', 'Sensor front listens to abc.'),
        ('sensors.front.frame_id=lidar', "front: frame_id: found 'base_scan', wanted 'lidar'"),
    ],
)
def test_a_sensor_that_says_nothing_ends_the_run_and_is_named(
    start_demo, tmp_path, assignment, why
):
    running = start_demo('unknown', '--set', assignment, '--output', tmp_path / 'run')
    assert running.wait() == 1
    topic = 'abc' if assignment.endswith('abc') else 'scan'
    sentence = f'Waiting for the first usable message of sensor front on {topic}.'
    said = ' '.join(running.stderr.split())
    for words in ('the run has not begun yet', 'the run did not begin within 15 s'):
        assert f'{words}: {sentence}' in said
    assert said.count(why) == 2
    assert 'Traceback' not in said
