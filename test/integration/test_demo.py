"""`cmpsp demo` by its command line: whole runs, and everything that can cut one short."""

from __future__ import annotations

import csv
import json
import math
import os
import re
import signal
import struct
import sys
import time
from pathlib import Path

import pytest

from cmpsp_ros.bags.encounters import encounters
from cmpsp_ros.bags.reader import Bag
from cmpsp_ros.bags.run import read_run
from cmpsp_ros.parameters.catalogue import TABLE
from cmpsp_ros.parameters.settings import guidance_settings

pytestmark = pytest.mark.integration

LIMIT = 60.0
KEYS = [
    'preset',
    'reached',
    'miss_m',
    'clearance_m',
    'max_wheel_speed_rad_s',
    'step_ms',
    'deadline_misses',
    'rungs',
    'control_steps',
]
TOPICS = {
    '/clock',
    '/odom',
    '/cmd_vel',
    '/diagnostics',
    '/sim/truth',
    '/sim/wheel_speeds',
    '/guidance/decision',
    '/guidance/predicted_path',
    '/guidance/wheel_speeds',
    '/guidance/markers',
}
CONTENT = {
    'bag',
    'parameters.yaml',
    'summary.json',
    'trajectory.png',
    'wheel_speeds.png',
    'recorder.log',
    'sim_node.log',
    'guidance_node.log',
}
LIMITS = {'case1': float('inf'), 'case2': float('inf'), 'case3': 51.0, 'case3_45': 45.0}


@pytest.fixture
def start_demo(spawn):
    """Start a demo on a domain of its own: `start_demo('case3', '--lockstep', ...)`."""
    return lambda *args, **env: spawn([sys.executable, '-m', 'cmpsp_ros.cli', 'demo', *args], **env)


def children(pid):
    """Module and process id of the nodes that a process has started."""
    found = {}
    for folder in Path('/proc').iterdir():
        if folder.name.isdigit() and status(int(folder.name))[1] == pid:
            command = (folder / 'cmdline').read_bytes().decode().split('\0')
            modules = [each for each in command if each.startswith('cmpsp_ros.nodes.')]
            if modules:
                found[modules[0].removeprefix('cmpsp_ros.nodes.')] = int(folder.name)
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


def commands(folder):
    """Serialised commands, and their speeds."""
    with Bag(folder / 'bag') as bag:
        raw = [each for _, each in bag.raw('/cmd_vel')]
        twists = [(each.linear.x, each.angular.z) for _, each in bag.messages('/cmd_vel')]
    return raw, twists


def size_of_png(path):
    head = path.read_bytes()[:24]
    assert head[:8] == b'\x89PNG\r\n\x1a\n'
    return struct.unpack('>II', head[16:24])


def decided(folder):
    """Whether the demo's run is well under way."""
    log = folder / 'guidance_node.log'
    return log.exists() and 'nominal' in log.read_text()


def check_folder(folder, preset):
    """What every run that came to its end leaves behind; returns its summary."""
    assert {each.name for each in folder.iterdir()} == CONTENT
    summary = json.loads((folder / 'summary.json').read_text())
    assert list(summary) == KEYS
    assert set(summary['step_ms']) == {'p50', 'p99', 'max'}
    assert set(summary['rungs']) == {'nominal', 'elastic', 'shifted', 'stop'}
    assert summary['preset'] == preset
    assert summary['control_steps'] == sum(summary['rungs'].values()) == 50
    assert summary['rungs']['shifted'] == summary['rungs']['stop'] == 0
    assert summary['clearance_m'] >= 0.0
    assert 0.0 < summary['max_wheel_speed_rad_s'] <= LIMITS[preset]
    assert 0.0 < summary['step_ms']['p50'] <= summary['step_ms']['p99'] <= summary['step_ms']['max']
    for picture in ('trajectory.png', 'wheel_speeds.png'):
        assert all(400 <= pixels <= 2000 for pixels in size_of_png(folder / picture))
        assert 10_000 < (folder / picture).stat().st_size < 1_000_000
    for log in folder.glob('*.log'):
        assert 'Traceback' not in log.read_text()
    return summary


def check_bag(folder):
    with Bag(folder / 'bag') as bag:
        assert set(bag.parameters) == {'/guidance', '/sim', '/recorder'}
        assert bag.parameters['/guidance']['weights.road_center'] == 15.0
        assert bag.parameters['/sim']['initial_pose'] == [0.0, -9.25, 0.0]
        topics = set(bag.topics)
    run = read_run(folder / 'bag')
    _, twists = commands(folder)
    assert all(speed > 0.5 for speed, _ in twists[:50])
    assert set(twists[50:]) == {(0.0, 0.0)}
    assert [each.finished for each in run.decisions[:51]] == [False] * 50 + [True]
    assert len(run.plans) == 50
    return topics


@pytest.mark.parametrize('preset', ['case1', 'case2', 'case3', 'case3_45'])
def test_preset_in_lockstep(start_demo, tmp_path, preset):
    folder = tmp_path / 'run'
    running = start_demo(preset, '--lockstep', '--output', folder)
    code = running.wait(LIMIT)
    summary = check_folder(folder, preset)
    assert check_bag(folder) >= TOPICS
    assert 'Traceback' not in running.stderr
    assert summary['reached'] == (code == 0)
    assert f'{preset}: 50 steps' in running.stdout
    if preset == 'case3_45' and code:
        assert code == 1
        assert 'the goal was missed by' in running.stderr
        return
    assert code == 0, running.stderr
    assert summary['miss_m'] < 1e-6
    assert summary['miss_m'] == pytest.approx(at_final_time(folder), abs=1e-9)


def test_a_robot_that_people_own_in_lockstep(start_demo, tmp_path):
    folder = tmp_path / 'run'
    running = start_demo('case3_wide', '--robot', 'jackal', '--lockstep', '--output', folder)
    assert running.wait(LIMIT) == 0, running.stderr
    summary = json.loads((folder / 'summary.json').read_text())
    assert summary['preset'] == 'case3_wide with jackal'
    assert summary['max_wheel_speed_rad_s'] <= 20.408
    assert summary['clearance_m'] >= 0.0
    assert summary['miss_m'] < 1e-6


def at_final_time(folder):
    """Distance of the last truth at the final time from the goal [m]."""
    with Bag(folder / 'bag') as bag:
        for _, message in bag.messages('/sim/truth'):
            if message.header.stamp.sec == 10 and message.header.stamp.nanosec == 0:
                place = message.pose.pose.position
                return ((place.x - 10.0) ** 2 + place.y**2) ** 0.5
    return None


def test_a_road_that_crosses_itself_in_lockstep(start_demo, tmp_path):
    folder = tmp_path / 'run'
    running = start_demo('corridor', '--lockstep', '--output', folder)
    assert running.wait(LIMIT) == 0, running.stderr
    summary = json.loads((folder / 'summary.json').read_text())
    assert summary['rungs'] == {'nominal': 100, 'elastic': 0, 'shifted': 0, 'stop': 0}
    assert summary['clearance_m'] >= 0.0
    assert summary['miss_m'] < 1e-6


def test_obstacles_that_move_in_lockstep(start_demo, spawn, tmp_path):
    runs = []
    for name in ('one', 'two'):
        folder = tmp_path / name
        running = start_demo('moving', '--lockstep', '--output', folder)
        assert running.wait(LIMIT) == 0, running.stderr
        summary = json.loads((folder / 'summary.json').read_text())
        assert summary['rungs'] == {'nominal': 50, 'elastic': 0, 'shifted': 0, 'stop': 0}
        assert summary['clearance_m'] >= 0.0
        assert summary['miss_m'] < 1e-3
        runs.append(read_run(folder / 'bag'))
    one, two = runs
    assert {each.id for each in one.tracks} == {0, 1}
    assert [each.points.tolist() for each in one.plans] == [e.points.tolist() for e in two.plans]
    for command in ('replay', 'audit'):
        judged = spawn([sys.executable, '-m', 'cmpsp_ros.cli', command, tmp_path / 'one' / 'bag'])
        assert judged.wait(LIMIT) == 0, judged.stdout + judged.stderr
        said = ' '.join(judged.stdout.split())
        assert ('identical: ' if command == 'replay' else 'clear of what moves') in said


# In real time: a busy machine may keep odometry from a robot for so long that it stops.
@pytest.mark.flaky(reruns=2)
def test_four_robots_whose_ways_cross(start_demo, spawn, tmp_path):
    folder, robots = tmp_path / 'run', ['/r1', '/r2', '/r3', '/r4']
    running = start_demo('fleet', '--output', folder)
    assert running.wait(2 * LIMIT) == 0, running.stderr
    assert 'fleet: 4 robots' in running.stdout
    summary = json.loads((folder / 'summary.json').read_text())
    assert list(summary['robots']) == robots
    for each in summary['robots'].values():
        assert each['reached']
        assert each['apart_m'] > 0.0
    assert size_of_png(folder / 'trajectory.png') == (960, 960)
    with Bag(folder / 'bag') as bag:
        nodes = {f'{each}/{node}' for each in robots for node in ('guidance', 'sim')}
        assert set(bag.parameters) == {*nodes, '/recorder'}
        assert bag.parameters['/r3/guidance']['goal.position'] == [0.0, 5.0]
        known = [message.values for _, message in bag.messages('/r1/guidance/decision')]
    said = [each.value for values in known for each in values if each.key == 'moving_obstacles']
    assert all(name in said[-1] for name in robots[1:])
    assert '/r1@' not in said[-1]
    for each in robots:
        for command in (['replay', '--namespace', each], ['audit', '--odom', f'{each}/odom']):
            judged = spawn([sys.executable, '-m', 'cmpsp_ros.cli', *command, folder / 'bag'])
            assert judged.wait(LIMIT) == 0, judged.stdout + judged.stderr
            if command[0] == 'replay':
                assert 'identical: ' in judged.stdout


def test_several_robots_share_no_clock_and_no_place(start_demo, tmp_path):
    folder = tmp_path / 'run'
    refused = start_demo('fleet', '--lockstep', '--output', folder)
    assert refused.wait(LIMIT) == 1
    assert '/r2: lockstep: found true, wanted false' in ' '.join(refused.stderr.split())
    near = start_demo('fleet', '--set', 'initial_pose=[0.0, 0.0, 0.0]', '--output', folder)
    assert near.wait(LIMIT) == 1
    said = ' '.join(near.stderr.split())
    assert '/r1: initial_pose: found 0 m from /r2, wanted 0.3 m or more' in said
    assert not folder.exists()


# A recorder that a busy machine starves at the start does not hear the first decisions.
@pytest.mark.flaky(reruns=2)
def test_goals_one_after_another_in_lockstep(start_demo, tmp_path):
    folder = tmp_path / 'run'
    running = start_demo('goals', '--lockstep', '--output', folder)
    assert running.wait(LIMIT) == 0, running.stderr
    summary = json.loads((folder / 'summary.json').read_text())
    assert [each['name'] for each in summary['goals']] == ['a', 'b', 'c', 'd', 'e', 'goal']
    assert all(each['miss_m'] < 1e-6 for each in summary['goals'])
    assert summary['goals'][1]['heading_miss_rad'] < 1e-6
    assert summary['rungs'] == {'nominal': 300, 'elastic': 0, 'shifted': 0, 'stop': 0}
    assert summary['clearance_m'] >= 0.0
    with Bag(folder / 'bag') as bag:
        *_, (_, shown) = bag.messages('/guidance/markers')
    pale = [each.color.a < 0.5 for each in shown.markers if each.ns == 'goal']
    assert pale == [True] * 5 + [False]


# A recorder that a busy machine starves at the start does not hear the first decisions.
@pytest.mark.flaky(reruns=2)
def test_a_course_past_what_moves_in_lockstep(start_demo, spawn, tmp_path):
    folder = tmp_path / 'run'
    running = start_demo('course', '--lockstep', '--output', folder)
    assert running.wait(LIMIT) == 0, running.stderr
    summary = json.loads((folder / 'summary.json').read_text())
    assert [each['name'] for each in summary['goals']] == ['a', 'b', 'c', 'd', 'e', 'goal']
    assert all(each['miss_m'] < 0.01 for each in summary['goals'])
    assert summary['rungs'] == {'nominal': 300, 'elastic': 0, 'shifted': 0, 'stop': 0}
    run, settings = read_run(folder / 'bag'), recorded_settings(folder)
    assert {each.id for each in run.tracks} == {0, 1, 2}
    begin, end = run.decisions[0].stamp, run.decisions[0].stamp + 60 * 10**9
    driven = run.driven.between(begin, end)
    assert settings.safety.margin > 0.0
    assert min(distances(driven, run.tracks).values()) >= settings.safety.margin
    for command in ('replay', 'audit'):
        judged = spawn([sys.executable, '-m', 'cmpsp_ros.cli', command, folder / 'bag'])
        assert judged.wait(LIMIT) == 0, judged.stdout + judged.stderr
    check_views(spawn, folder)
    # Without what moves the robot drives another way: it would have met each of them.
    alone = start_demo(
        'course', '--lockstep', '--output', tmp_path / 'alone',
        '--set', 'moving_obstacles.capacity=0',
    )  # fmt: skip
    assert alone.wait(LIMIT) == 1
    blind = read_run(tmp_path / 'alone' / 'bag').driven.between(begin, end)
    nearest = distances(blind, run.tracks)
    assert len(nearest) == 3
    assert all(each < 0.0 for each in nearest.values()), nearest


def check_views(spawn, folder):
    """What report and tables show of goals and of what moves."""
    for command, name in (('report', 'report.html'), ('export', 'tables')):
        arguments = [command, folder / 'bag', '--output', folder / name]
        shown = spawn([sys.executable, '-m', 'cmpsp_ros.cli', *arguments])
        assert shown.wait(LIMIT) == 0, shown.stderr
    page = (folder / 'report.html').read_text(encoding='utf-8')
    (told,) = re.findall(r'(?s)<script[^>]* id="data">(.*?)</script>', page)
    (bag,) = json.loads(told)['bags']
    labels = ['a at 9 s', 'b at 17 s', 'c at 26 s', 'd at 36 s', 'e at 52 s', 'goal at 60 s']
    assert [each[3] for each in bag['goals']] == labels
    assert [each[0] for each in bag['goals']] == [0.0, 9.0, 17.0, 26.0, 36.0, 52.0]
    assert [each['radius'][0] for each in bag['moving']] == [0.25, 0.25, 0.3]
    with (folder / 'tables' / 'decisions.csv').open(newline='') as file:
        goals = [row['goal'] for row in csv.DictReader(file)]
    assert list(dict.fromkeys(goals)) == ['a', 'b', 'c', 'd', 'e', 'goal']
    with (folder / 'tables' / 'moving.csv').open(newline='') as file:
        assert {row['id'] for row in csv.DictReader(file)} == {'0', '1', '2'}


def recorded_settings(folder):
    with Bag(folder / 'bag') as bag:
        return guidance_settings(TABLE.resolve(bag.parameters['/guidance']))


def distances(driven, tracks):
    """Least distance of a path from each obstacle, by name, as it was told of [m]."""
    nearest = {}
    for each in encounters(driven, tracks, 0.0, 1.0):
        known = nearest.get(each.name, math.inf)
        nearest[each.name] = min(known, float(each.clearance.min()))
    return nearest


def test_a_road_from_a_topic_in_lockstep(start_demo, spawn, tmp_path):
    folder = tmp_path / 'run'
    running = start_demo('road_topic', '--lockstep', '--output', folder)
    assert running.wait(LIMIT) == 0, running.stderr
    summary = json.loads((folder / 'summary.json').read_text())
    assert summary['rungs'] == {'nominal': 100, 'elastic': 0, 'shifted': 0, 'stop': 0}
    assert summary['clearance_m'] >= 0.0
    assert summary['miss_m'] < 1e-6
    said = (folder / 'guidance_node.log').read_text()
    assert said.index('waiting for a road') < said.index('a road of 31 points') < said.index('plan')
    with Bag(folder / 'bag') as bag:
        assert bag.topics['/road'].count == 1
    for command in ('replay', 'audit'):
        judged = spawn([sys.executable, '-m', 'cmpsp_ros.cli', command, folder / 'bag'])
        assert judged.wait(LIMIT) == 0, judged.stdout + judged.stderr


def test_a_road_without_end_in_lockstep(start_demo, tmp_path):
    folder = tmp_path / 'run'
    running = start_demo('endless', '--lockstep', '--output', folder)
    assert running.wait(LIMIT) == 0, running.stderr
    summary = json.loads((folder / 'summary.json').read_text())
    assert summary['speed_m_s'] == pytest.approx(1.2, rel=0.01)
    assert summary['miss_m'] is None
    # A recorder that is starved at the start may hear the first decisions too late.
    assert summary['rungs'].pop('nominal') >= 290
    assert summary['rungs'] == {'elastic': 0, 'shifted': 0, 'stop': 0}
    assert summary['clearance_m'] >= 0.0


def test_two_runs_in_lockstep_command_the_same_and_force_replaces_a_run(start_demo, tmp_path):
    folder, runs = tmp_path / 'deep' / 'run', []
    for flags in ([], ['--force']):
        running = start_demo('case3', '--lockstep', '--output', folder, *flags)
        assert running.wait(LIMIT) == 0, running.stderr
        runs.append((commands(folder)[0], read_run(folder / 'bag')))
        if not flags:
            inode = (folder / 'bag').stat().st_ino, (folder / 'summary.json').stat().st_mtime_ns
            (folder / 'notes.txt').write_text('mine')
            refused = start_demo('case3', '--lockstep', '--output', folder)
            assert refused.wait(LIMIT) == 1
            assert f'{folder}: found an existing folder' in ' '.join(refused.stderr.split())
            assert '--force' in refused.stderr
            unchanged = (folder / 'bag').stat().st_ino, (folder / 'summary.json').stat().st_mtime_ns
            assert unchanged == inode
    (first, one), (second, two) = runs
    assert first[:51] == second[:51]
    assert [each.points.tolist() for each in one.plans] == [e.points.tolist() for e in two.plans]
    assert (folder / 'notes.txt').read_text() == 'mine'
    (folder / 'notes.txt').unlink()
    check_folder(folder, 'case3')


def test_case_3_in_real_time(start_demo, tmp_path):
    folder = tmp_path / 'run'
    running = start_demo('case3', '--output', folder)
    assert running.wait(LIMIT) == 0, running.stderr
    summary = check_folder(folder, 'case3')
    assert check_bag(folder) >= TOPICS - {'/clock'}
    assert summary['reached']
    assert summary['miss_m'] < 0.01
    assert summary['deadline_misses'] == 0


@pytest.mark.parametrize(
    ('arguments', 'said'),
    [
        (['case3', '--set', 'weights.road_centre=3.0'], ['weights.road_centre', 'road_center?']),
        (['case3', '--set', 'initial_pose=[8.0,-6.0,0.0]'], ['initial_pose', 'obstacle a', '0.7']),
        (['case3', '--set', 'goal.position=[5.0,0.0]'], ['goal.position', '5 m from', '9 to 11']),
        (['case3', '--set', 'final_time'], ['final_time', 'key=value']),
        (['case4'], ['case4', 'did you mean', 'case3']),
    ],
)
def test_what_cannot_be_run_is_said_before_anything_starts(start_demo, tmp_path, arguments, said):
    folder = tmp_path / 'run'
    running = start_demo(*arguments, '--lockstep', '--output', folder)
    assert running.wait(LIMIT) == 1
    text = ' '.join(running.stderr.split())
    for words in ['found', 'wanted', *said]:
        assert words in text
    assert 'Traceback' not in text
    assert running.stdout == ''
    assert not folder.exists()


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
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
    begun = time.monotonic()
    assert running.wait(LIMIT) == 1
    assert time.monotonic() - begun < LIMIT
    assert f'{name} ended with exit code -9' in running.stderr
    assert 'Traceback' not in running.stderr
    assert are_gone(nodes.values())
