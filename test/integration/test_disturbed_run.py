"""Whole runs of a robot with every disturbance: repeatable, replayable, judged by the truth."""

import json
import math
import sys

import numpy as np
import pytest

from cmpsp_ros.bags import Bag, Names
from cmpsp_ros.bags.replay.replay import replay
from cmpsp_ros.bags.runs import read_run

PERIOD_NS = 20_000_000
DISTURBED = {
    'command_delay': '0.1',
    'actuation_delay': '0.06',
    'actuation_jitter': '0.02',
    'wheel_lag': '0.03',
    'wheel_slip': '[0.01, 0.008]',
    'wheel_slip_stddev': '0.005',
    'noise.position_stddev': '0.002',
    'noise.heading_stddev': '0.002',
    'noise.bias': '[0.02, 0.0, 0.0]',
    'noise.drift': '[0.0, 0.001, 0.0]',
    'noise.dropout': '0.2',
    # The first control instant of all, one in the middle, and the last before the final time.
    'noise.dropout_windows': '[0.0, 0.05, 3.9, 4.15, 9.79, 9.93]',
    'noise.seed': '5',
}


@pytest.fixture
def run_demo(spawn, tmp_path):
    """Run case 3 in lockstep: `run_demo(name, {key: value})`, its folder and exit code."""

    def run(name, parameters):
        folder = tmp_path / name
        given = [part for item in parameters.items() for part in ('--set', '='.join(item))]
        command = [sys.executable, '-m', 'cmpsp_ros.cli', 'demo', 'case3', '--lockstep']
        running = spawn([*command, '--output', folder, *given])
        code = running.wait()
        assert (folder / 'summary.json').exists(), running.stderr
        return folder, code

    return run


def stamp(message):
    return message.header.stamp.sec * 1_000_000_000 + message.header.stamp.nanosec


def place(message):
    position, turn = message.pose.pose.position, message.pose.pose.orientation
    return position.x, position.y, turn.z, turn.w


def contents(folder):
    """Results that must repeat: odometry and truth by time, decisions, from the first to the last.

    Before the first one, a recorder may not have found every publisher yet. The queue of commands
    holds but one, so that none is obeyed late: on a busy machine a recording may lack some. Each is
    in its decision.
    """
    with Bag(folder / 'bag') as bag:
        decisions = [
            (each.message, {v.key: v.value for v in each.values if not v.key.endswith('_ms')})
            for _, array in bag.messages('/guidance/decision')
            for each in array.status
        ]
        count = 1 + next(k for k, (_, each) in enumerate(decisions) if each['finished'] == 'true')
        begin, end = (int(decisions[k][1]['stamp']) for k in (0, count - 1))
        poses = {
            topic: {(stamp(each), place(each)) for _, each in bag.messages(topic)}
            for topic in ('/odom', '/sim/truth')
        }
        poses = {
            topic: {each for each in poses[topic] if begin <= each[0] <= end} for topic in poses
        }
        return poses, decisions[:count]


def judged(folder):
    return json.loads((folder / 'summary.json').read_text())


def test_a_disturbed_run_repeats_to_the_last_bit_and_its_replay_is_identical(run_demo):
    runs = [run_demo(name, DISTURBED)[0] for name in ('one', 'other')]
    (poses, decisions), (other_poses, other_decisions) = (contents(folder) for folder in runs)
    assert decisions == other_decisions
    for topic, there in poses.items():
        assert not there ^ other_poses[topic], topic
    heard = sorted({at for at, _ in poses['/odom']})
    assert heard[0] > 2 * PERIOD_NS
    assert not [at for at in heard if 3_900_000_000 <= at < 4_150_000_000]
    assert len(heard) < 0.9 * len({at for at, _ in poses['/sim/truth'] if at % PERIOD_NS == 0})
    assert int(decisions[0][1]['stamp']) == heard[0]
    outcome = replay(runs[0] / 'bag', Names.under(''))
    assert outcome.first is None, str(outcome)
    assert outcome.decisions >= len(decisions) > 50
    assert outcome.plans >= 40


# Of a robot that shares neither clock nor control instants with the guidance.
OWN_TIMES = {
    'odom_rate': '30.0',
    'odom_jitter': '0.002',
    'clock_offset': '-0.03',
    'actuation_period': '0.0333',
    'wheel_lag': '0.1',
    'command_delay': '0.1',
    'safety.margin': '0.05',
}


def test_a_robot_with_times_of_its_own_arrives_and_repeats_to_the_last_bit(run_demo):
    runs = [run_demo(name, OWN_TIMES)[0] for name in ('one', 'other')]
    (poses, decisions), (other_poses, other_decisions) = (contents(folder) for folder in runs)
    assert decisions == other_decisions
    for topic, there in poses.items():
        # A busy recorder may lack some of the truth, which is told at each change of a lag.
        either = there | other_poses[topic]
        assert len(either) == len({at for at, _ in either}) > 290, topic
    instants = np.diff([int(each['stamp']) for _, each in decisions]) / 1e6
    assert instants.min() < 180.0
    assert instants.max() > 220.0
    # Odometry of the final time ends the run, not the clock that is ahead of it.
    assert decisions[-1][1]['halted'] == 'false'
    assert judged(runs[0])['miss_m'] < 0.05
    assert judged(runs[0])['clearance_m'] > 0.05
    outcome = replay(runs[0] / 'bag', Names.under(''))
    assert outcome.first is None, str(outcome)


def test_a_run_is_judged_by_the_truth(run_demo):
    folder, code = run_demo('biased', {'noise.bias': '[0.05, 0.0, 0.0]'})
    summary = judged(folder)
    assert code == 1
    assert not summary['reached']
    assert summary['miss_m'] == pytest.approx(0.05, abs=1e-6)
    driven = read_run(folder / 'bag').driven
    # The initial pose is the true one, and not the one that odometry has.
    assert driven.poses[0].tolist() == [0.0, -9.25, 0.0]


def test_a_robot_that_slides_and_spins_its_wheels_arrives_too(run_demo):
    folder, code = run_demo('physics', {'plant': 'mujoco'})
    summary = judged(folder)
    assert code == 0
    assert summary['miss_m'] < 0.05
    assert summary['clearance_m'] > 0.0
    outcome = replay(folder / 'bag', Names.under(''))
    assert outcome.first is None, str(outcome)
    driven = read_run(folder / 'bag').driven
    # It does not reach in an instant what is commanded.
    assert driven.poses[:, 0].min() >= 0.0
    assert math.dist(driven.poses[20, :2], driven.poses[0, :2]) < 0.05
