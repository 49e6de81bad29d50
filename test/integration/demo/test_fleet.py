"""Several robots at once by `cmpsp demo`."""

import json

import pytest
from demo_folder import size_of_png

from cmpsp_ros.bags import Bag

pytestmark = pytest.mark.integration


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
