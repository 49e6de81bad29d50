"""Run after run: do two processes take more and more, and is all clear beside a busy loop?

`SOAK_RUNS=360 CROWD_RUNS=50 make test-all PYTEST_ARGS='-s test/integration/guidance/test_soak.py'`
makes an hour of simulated time, and fifty runs in real time; `-s` shows the figures of each run.
"""

import math
import os
import sys
from pathlib import Path

import numpy as np
import pytest
import yaml
from nav_msgs.msg import Odometry
from std_srvs.srv import Trigger

from cmpsp_ros.bags.audit import CheckOutcome, audit

SOAK_RUNS = int(os.environ.get('SOAK_RUNS', '9'))
CROWD_RUNS = int(os.environ.get('CROWD_RUNS', '3'))

WARM = 5
"""Runs until caches and the pools of the middleware have filled."""

SIMULATED = {'lockstep': True, 'publish_clock': True, 'lockstep_timeout': 60.0}


def held(node):
    """Resident memory [MB] and number of open files of a process."""
    process = Path(f'/proc/{node.pid}')
    pages = int((process / 'statm').read_text().split()[1])
    return pages * os.sysconf('SC_PAGE_SIZE') / 2**20, sum(1 for _ in (process / 'fd').iterdir())


def begin_again(client, heard):
    """Put the robot back and set time 0 anew, while simulated time stands still."""
    assert client.change_state('deactivate')
    heard.clear()
    client.until(lambda: len(heard) > 3 and heard[-1].header == heard[-3].header)
    assert client.ros.call(Trigger, '/sim/reset').success
    assert client.change_state('activate')


@pytest.mark.timeout(300 + 10 * SOAK_RUNS)
def test_memory_and_descriptors_stay_as_they_are_from_run_to_run(start_node, client):
    guided = {'use_sim_time': True}
    nodes, heard, warm = [start_node('sim_node', SIMULATED), start_node(parameters=guided)], [], []
    client.node.create_subscription(Odometry, '/odom', heard.append, 10)

    def has_finished(run):
        latest = client.decisions[-1] if client.decisions else {}
        return (latest.get('run'), latest.get('finished')) == (str(run), 'true')

    for run in range(1, SOAK_RUNS + 1):
        client.until(lambda run=run: has_finished(run), 250.0)
        assert client.decisions[-1]['missed'] == 'false'
        found = [held(each) for each in nodes]
        print(f'run {run}: {found}')
        warm = found if run <= WARM else warm
        if run < SOAK_RUNS:
            begin_again(client, heard)
    for (memory, files), (memory_before, files_before) in zip(found, warm, strict=True):
        assert memory <= 1.05 * memory_before
        assert files <= files_before
    for each in nodes:
        each.end()
        assert each.wait() == 0


DISCS, ON_THE_ROAD = 64, 10
# Leaves no time of the first core to anybody who does not fight for it.
BUSY = """
import os
os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
while True:
    pass
"""


def crowd(seed):
    """Case 3 with discs that drift on its road, and others that circle beside it."""
    random = np.random.default_rng(seed)
    moving = {'capacity': DISCS, 'names': [f'disc_{k:02d}' for k in range(DISCS)]}
    bearings = np.radians(np.linspace(-75.0, -8.0, ON_THE_ROAD))
    for k, name in enumerate(moving['names']):
        if k < ON_THE_ROAD:
            away, bearing = random.uniform(9.2, 10.8), bearings[k]
            velocity = random.uniform(-0.1, 0.1, 2).tolist()
        else:
            away, bearing = random.uniform(11.5, 14.0), random.uniform(-math.pi, 0.5)
            velocity = [-0.3 * math.sin(bearing), 0.3 * math.cos(bearing)]
        center = [float(away * math.cos(bearing)), float(away * math.sin(bearing))]
        moving[name] = {'center': center, 'velocity': velocity, 'radius': 0.12}
    return {
        'moving_obstacles': moving,
        'robot': {'max_wheel_speed': 51.0},
        # In real time a disc is seen where it was a little earlier.
        'safety': {'margin': 0.05},
        # The computer misses deadlines at times, beside a busy loop.
        'max_command_delay': 0.2,
        'initial_pose': [0.0, -9.25, 0.0],
    }


@pytest.mark.timeout(300 + 60 * CROWD_RUNS)
def test_on_a_busy_computer_no_moving_disc_is_touched(spawn, tmp_path):
    spawn([sys.executable, '-c', BUSY])
    for seed in range(1, CROWD_RUNS + 1):
        course, output = tmp_path / f'crowd_{seed}.yaml', tmp_path / str(seed)
        course.write_text(yaml.safe_dump({'/**': {'ros__parameters': crowd(seed)}}))
        made = spawn([sys.executable, '-m', 'cmpsp_ros.cli', 'demo', course, '--output', output])
        assert made.wait() in {0, 1}
        assert (output / 'summary.json').exists(), made.stderr
        found = {each.check: each for each in audit(output / 'bag')}
        print(f'seed {seed}:', *(found[each] for each in ('road', 'moving', 'goal')), sep='\n  ')
        for each in ('road', 'moving'):
            assert found[each].outcome is CheckOutcome.PASSED, found[each]
