"""Runs by `cmpsp demo`: the cases of the paper, several robots, late steps, and what is refused."""

import json

import pytest
from demo_folder import TOPICS, check_bag, check_folder, commands, size_of_png

from cmpsp_ros.bags import Bag
from cmpsp_ros.bags.runs import read_run


@pytest.mark.parametrize(
    'preset', ['case1', 'case2', pytest.param('case3', marks=pytest.mark.smoke), 'case3_45']
)
def test_preset_in_lockstep(start_demo, judge, tmp_path, preset):
    folder = tmp_path / 'run'
    running = start_demo(preset, '--lockstep', '--output', folder)
    code = running.wait()
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
    judge(folder / 'bag')


def test_a_robot_that_people_own_in_lockstep(start_demo, tmp_path):
    folder = tmp_path / 'run'
    running = start_demo('case3_wide', '--robot', 'jackal', '--lockstep', '--output', folder)
    assert running.wait() == 0, running.stderr
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


def test_two_runs_in_lockstep_command_the_same_and_force_replaces_a_run(start_demo, tmp_path):
    folder, runs = tmp_path / 'deep' / 'run', []
    for flags in ([], ['--force']):
        running = start_demo('case3', '--lockstep', '--output', folder, *flags)
        assert running.wait() == 0, running.stderr
        runs.append((commands(folder)[0], read_run(folder / 'bag')))
        if not flags:
            inode = (folder / 'bag').stat().st_ino, (folder / 'summary.json').stat().st_mtime_ns
            (folder / 'notes.txt').write_text('mine')
            refused = start_demo('case3', '--lockstep', '--output', folder)
            assert refused.wait() == 2
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
    assert running.wait() == 0, running.stderr
    summary = check_folder(folder, 'case3')
    assert check_bag(folder) >= TOPICS - {'/clock'}
    assert summary['reached']
    assert summary['miss_m'] < 0.01
    assert summary['deadline_misses'] == 0


@pytest.mark.parametrize(
    ('arguments', 'said'),
    [
        pytest.param(
            ['case3', '--set', 'weights.road_centre=3.0'],
            ['weights.road_centre', 'road_center?'],
            marks=pytest.mark.smoke,
        ),
        (['case3', '--set', 'initial_pose=[8.0,-6.0,0.0]'], ['initial_pose', '0.7']),
        (['case4'], ['case4', 'did you mean', 'case3']),
    ],
)
def test_what_cannot_be_run_is_said_before_anything_starts(start_demo, tmp_path, arguments, said):
    folder = tmp_path / 'run'
    running = start_demo(*arguments, '--lockstep', '--output', folder)
    assert running.wait() == 2
    text = ' '.join(running.stderr.split())
    for words in ['found', 'wanted', *said]:
        assert words in text
    assert 'Traceback' not in text
    assert running.stdout == ''
    assert not folder.exists()


# In real time on a busy machine odometry may be late: no robot stops for that, and a late command
# may lead it somewhat past its goal.
PATIENT = ['--set', 'odom_timeout=10.0', '--set', 'goal.tolerance=0.1']


def test_four_robots_whose_ways_cross(start_demo, start_cmpsp, tmp_path):
    folder, robots = tmp_path / 'run', ['/r1', '/r2', '/r3', '/r4']
    running = start_demo('fleet', '--output', folder, *PATIENT)
    assert running.wait() == 0, running.stderr
    assert 'fleet: 4 robots' in running.stdout
    summary = json.loads((folder / 'summary.json').read_text())
    assert list(summary['robots']) == robots
    for each in summary['robots'].values():
        assert each['reached']
        assert each['apart_m'] > 0.0
    assert size_of_png(folder / 'trajectory.png') == (960, 960)
    with Bag(folder / 'bag') as bag:
        nodes = {f'{each}/{node}' for each in robots for node in ('guidance', 'sim')}
        assert set(bag.parameters) == nodes
        assert bag.parameters['/r3/guidance']['goal.position'] == [0.0, 5.0]
        known = [each.status[0].values for _, each in bag.messages('/r1/guidance/decision')]
    said = [each.value for values in known for each in values if each.key == 'moving_obstacles']
    assert all(name in said[-1] for name in robots[1:])
    assert '/r1@' not in said[-1]
    for each in robots:
        for command in (['replay', '--namespace', each], ['audit', '--odom', f'{each}/odom']):
            judged = start_cmpsp(*command, folder / 'bag')
            assert judged.wait() == 0, judged.stdout + judged.stderr
            if command[0] == 'replay':
                assert 'identical: ' in judged.stdout


def test_several_robots_share_no_clock_and_no_place(start_demo, tmp_path):
    folder = tmp_path / 'run'
    refused = start_demo('fleet', '--lockstep', '--output', folder)
    assert refused.wait() == 2
    assert '/r2: lockstep: found true, wanted false' in ' '.join(refused.stderr.split())
    near = start_demo('fleet', '--set', 'initial_pose=[0.0, 0.0, 0.0]', '--output', folder)
    assert near.wait() == 2
    said = ' '.join(near.stderr.split())
    assert '/r1: initial_pose: found 0 m from /r2, wanted 0.3 m or more' in said
    assert not folder.exists()


# Twenty milliseconds for many times that work.
SLOW = ('control_period=0.02', 'solver.work_share=1.0', 'solver.candidates=8')
SLOW += ('solver.iterations_per_step=100', 'odom_rate=100.0')


def test_late_steps_are_counted_and_the_run_is_judged(start_demo, start_cmpsp, tmp_path):
    folder = tmp_path / 'run'
    running = start_demo('case3', '--output', folder, *(f'--set={each}' for each in SLOW))
    assert running.wait() in {0, 1}, running.stderr
    summary = json.loads((folder / 'summary.json').read_text())
    run = read_run(folder / 'bag')
    withdrawn = [each for each in run.decisions if each.late]
    assert withdrawn
    assert summary['deadline_misses'] >= len(withdrawn)
    assert all(each.misses_deadline(0.02, 0.0) for each in withdrawn)
    shown = ' '.join(running.stdout.split())
    assert f'deadlines missed │ {summary["deadline_misses"]}' in shown
    with Bag(folder / 'bag') as bag:
        assert set(bag.topics) >= TOPICS - {'/clock'}
        counts = {name: each.count for name, each in bag.topics.items()}
        (*_, health) = [
            {each.key: each.value for each in status.values}
            for _, message in bag.messages('/diagnostics')
            for status in message.status
            if status.name == '/guidance: guidance'
        ]
    assert counts['/guidance/decision'] == len(run.decisions)
    # A busy machine may not have recorded them all.
    assert 0 < counts['/cmd_vel'] <= len(run.decisions) - len(withdrawn)
    assert int(health['deadline_misses']) >= summary['deadline_misses']
    replayed = start_cmpsp('replay', folder / 'bag')
    assert replayed.wait() == 0, replayed.stdout
