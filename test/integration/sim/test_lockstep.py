"""The simulator in lockstep: time waits for the answer to every control step."""

import math
import os
import signal
import sys
import time

import numpy as np
import pytest
from geometry_msgs.msg import Twist, TwistStamped
from rclpy.time import Time
from sim_client import CONTROL_NS, MS, PERIOD_NS, Client, place, stamp, twist

from cmpsp_ros.bags import Bag
from cmpsp_ros.robots import DifferentialDrive

LOCKSTEP = {'lockstep': 'true', 'publish_clock': 'true'}


def run_lockstep(simulate, ros, steps, kind=Twist, **more):
    stamped = 'true' if kind is TwistStamped else 'false'
    running = simulate({**LOCKSTEP, 'enable_stamped_cmd_vel': stamped, **more})
    client = Client(ros, kind=kind)
    client.until(client.commands.get_subscription_count)
    client.steps_left, client.answer = steps, lambda step: twist(0.2 + 0.01 * step, 0.02)
    client.until(lambda: client.odometry)
    client.until(lambda: len(client.events) == steps)
    return running, client


@pytest.mark.parametrize('kind', [Twist, TwistStamped])
def test_lockstep_waits_for_each_answer(simulate, ros, kind):
    _, client = run_lockstep(simulate, ros, 51, kind)
    assert client.events == [step * CONTROL_NS for step in range(51)]
    client.until(lambda: stamp(client.truth[-1]) == 51 * CONTROL_NS)
    client.until(lambda: stamp(client.odometry[-1]) == 51 * CONTROL_NS)
    robot, pose = DifferentialDrive(), np.array([0.0, -9.25, 0.0])
    for step in range(51):
        speeds = robot.wheel_speeds(np.array([0.2 + 0.01 * step, 0.02]))
        pose = robot.roll_out(pose, speeds[None], np.array([0.2]))[1]
    assert np.allclose(place(client.odometry[-1]), pose, atol=1e-12)
    assert {stamp(message) for message in client.truth} == set(
        range(0, 51 * CONTROL_NS + 1, PERIOD_NS)
    )


def test_the_truth_and_the_time_go_on_while_odometry_is_lost(simulate, ros):
    simulate(
        {
            **LOCKSTEP,
            'noise.dropout_windows': '[0.0, 0.05, 0.3, 0.45]',
            'noise.bias': '[1.0, 0.0, 0.0]',
        }
    )
    client = Client(ros)
    client.connect()
    # It stands still at the first odometry that is not lost, and later too.
    for instant in (60, 260, 460, 660):
        client.until(lambda instant=instant: stamp(client.odometry[-1]) == instant * MS)
        client.send(twist(0.5))
    client.until(lambda: stamp(client.odometry[-1]) == 860 * MS)
    heard = {stamp(message) // MS for message in client.odometry}
    assert heard == {*range(60, 300, 20), *range(460, 861, 20)}
    client.until(lambda: stamp(client.truth[-1]) == 860 * MS)
    driven = {stamp(message) // MS: place(message)[0] for message in client.truth}
    assert {*range(60, 861, 20)} <= set(driven)
    client.until(lambda: {*range(60, 861, 20)} <= {each // MS for each in client.clocks})
    assert driven[860] == pytest.approx(0.4, abs=1e-12)
    assert place(client.odometry[-1])[0] == pytest.approx(1.4, abs=1e-12)


def test_time_waits_at_the_first_odometry_of_a_control_instant_on_the_clock_of_the_robot(
    simulate, ros
):
    robot = {'odom_rate': 30.0, 'odom_jitter': 0.03, 'clock_offset': -0.05}
    simulate({**LOCKSTEP, **robot, 'enable_stamped_cmd_vel': 'true'})
    client = Client(ros, kind=TwistStamped)
    client.connect()
    waited_at = []
    for step in range(8):
        client.until(
            lambda step=step: stamp(client.odometry[-1]) - first(client) >= step * CONTROL_NS
        )
        waited_at.append(stamp(client.odometry[-1]))
        client.send(twist(0.5), client.odometry[-1].header.stamp)
    heard = sorted({stamp(message) for message in client.odometry})
    for step, waited in enumerate(waited_at):
        due = first(client) + step * CONTROL_NS
        assert waited == next(each for each in heard if each >= due)
    client.until(lambda: {each + 50 * MS for each in heard} <= set(client.clocks))


def first(client):
    return stamp(client.odometry[0])


def test_lockstep_asks_again_complains_once_and_goes_on(simulate, ros):
    running = simulate({**LOCKSTEP, 'lockstep_timeout': 0.3})
    client = Client(ros)
    client.connect()
    client.until(lambda: len(client.odometry) > 5 and 'still waiting' in running.stderr)
    assert {stamp(message) for message in client.odometry} == {0}
    client.until(lambda: len(client.clocks) > 5)
    assert set(client.clocks) == {0}
    count = len(client.odometry)
    client.until(lambda: len(client.odometry) > count + 5)
    assert running.stderr.count('still waiting') == 1
    client.send(twist(0.1))
    client.until(lambda: stamp(client.odometry[-1]) == CONTROL_NS)
    assert 'lockstep goes on after' in running.stderr


def test_lockstep_waits_for_a_subscriber_that_is_behind(simulate, ros, spawn, wait_until, tmp_path):
    output = tmp_path / 'bag'
    module = 'cmpsp_ros.nodes.recording.recorder'
    recorder = spawn([sys.executable, '-m', module, '--ros-args', '-p', f'output:={output}'])
    simulate({**LOCKSTEP, 'odom_rate': 200.0})
    client = Client(ros)
    client.connect()
    # The client's own subscriptions are two of them.
    client.until(lambda: client.node.count_subscribers('/sim/truth') == 2)
    os.kill(recorder.pid, signal.SIGSTOP)
    client.steps_left, client.answer = 100, lambda _: twist(0.1)
    client.send(twist(0.1))
    client.until(lambda: len(client.events) > 10)
    seconds = time.monotonic()
    client.until(lambda: time.monotonic() - seconds > 3.0)
    assert len(client.events) < 30
    os.kill(recorder.pid, signal.SIGCONT)
    client.until(lambda: len(client.events) == 100)
    client.until(lambda: stamp(client.truth[-1]) == 101 * CONTROL_NS)
    recorder.signal(signal.SIGINT)
    assert recorder.wait() == 0
    with Bag(output) as bag:
        stamps = {
            message.header.stamp.sec * 10**9 + message.header.stamp.nanosec
            for _, message in bag.messages('/sim/truth')
        }
    assert stamps == set(range(0, 101 * CONTROL_NS + 1, 5 * MS))


def test_lockstep_takes_only_the_answer_whose_stamp_is_that_of_the_odometry(simulate, ros):
    simulate({**LOCKSTEP, 'enable_stamped_cmd_vel': 'true'})
    client = Client(ros, kind=TwistStamped)
    client.connect()
    client.send(twist(1.0), Time(nanoseconds=1).to_msg())
    count = len(client.odometry)
    client.until(lambda: len(client.odometry) > count + 3)
    assert stamp(client.odometry[-1]) == 0
    client.send(twist(0.5), Time(nanoseconds=0).to_msg())
    client.until(lambda: stamp(client.odometry[-1]) == CONTROL_NS)
    assert place(client.odometry[-1])[0] == pytest.approx(0.1, abs=1e-12)


def test_lockstep_goes_on_with_the_last_valid_twist_when_the_answer_is_no_number(simulate, ros):
    running = simulate(LOCKSTEP)
    client = Client(ros)
    client.connect()
    client.send(twist(0.5))
    client.until(lambda: stamp(client.odometry[-1]) == CONTROL_NS)
    for instant in (2, 3, 4):
        client.send(twist(math.nan))
        client.until(lambda instant=instant: stamp(client.odometry[-1]) == instant * CONTROL_NS)
    assert 'cmd_vel refused' in running.stderr
    # 0.5 m/s until the time-out of 0.5 s of simulated time.
    assert place(client.odometry[-1])[0] == pytest.approx(0.25, abs=1e-12)


def test_a_reset_in_lockstep_asks_again_from_the_initial_pose(simulate, ros):
    simulate(LOCKSTEP)
    client = Client(ros)
    client.connect()
    client.send(twist(0.5))
    client.until(lambda: stamp(client.odometry[-1]) == CONTROL_NS)
    assert client.reset()
    client.until(lambda: place(client.odometry[-1])[0] == 0.0)
    assert stamp(client.odometry[-1]) == CONTROL_NS
    client.send(twist(0.5))
    client.until(lambda: stamp(client.odometry[-1]) == 2 * CONTROL_NS)
    assert place(client.odometry[-1])[0] == pytest.approx(0.1, abs=1e-12)
