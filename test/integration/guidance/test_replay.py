"""Bags of real nodes: replayed to the last bit, and played to a live node that decides the same."""

import numpy as np
import pytest
from live import COMMAND
from nav_msgs.msg import Odometry
from rclpy.time import Time
from std_srvs.srv import Trigger

from cmpsp_ros.bags import Bag, DecisionRecord, Names

NAMES = Names.under('')


def decision_to_key_values(values):
    """Fields of a decision that must repeat."""
    told = ('run', 'revision', 'reason', 'level')
    return {k: v for k, v in values.items() if not k.endswith('_ms') and k not in told}


def is_forced(decision):
    """True if the law itself left the best fallback level."""
    return decision['halted'] == 'false' and decision['fallback_level'] != 'nominal'


def recorded(bag):
    with Bag(bag) as opened:
        topic = NAMES.decision
        return [DecisionRecord.of(topic, stamp, each) for stamp, each in opened.messages(topic)]


@pytest.fixture
def begin(start_node, client, record):
    """Have a node recorded that is about to be activated."""

    def start():
        recording = record()
        start_node('guidance_node', {'autostart': False})
        assert client.change_state('configure')
        client.connect()
        recording.until_all_is_heard(NAMES.path)
        return recording

    return start


def test_a_run_with_faults_is_identical_and_audited_as_it_was(
    begin, client, spawn, verdicts, tmp_path
):
    recording = begin()
    assert client.change_state('activate')
    client.drive()
    client.until_driving()
    # An obstacle appears in front of the robot.
    x, y, heading = client.pose
    ahead = [float(x + 0.75 * np.cos(heading)), float(y + 0.75 * np.sin(heading))]
    assert client.set_parameter('obstacles.a.center', ahead).successful
    client.until(lambda: any(is_forced(each) for each in client.decisions))
    assert client.set_parameter('obstacles.a.center', [8.0, -6.0]).successful
    client.until(lambda: client.decisions[-1]['revision'] == '2')
    # Odometry drops out, for three control periods beyond its time-out.
    client.park()
    halted = len(client.decisions)
    client.until(lambda: sum(each['halted'] == 'true' for each in client.decisions[halted:]) > 3)
    client.drive()
    client.until_driving()
    assert client.reset().success
    client.until(lambda: client.decisions[-1]['run'] == '2')
    count = len(client.decisions)
    client.until(lambda: len(client.decisions) > count + 5)
    assert client.change_state('deactivate')
    client.park()
    outcome = recording.replayed()
    assert outcome.decisions == outcome.commands == len(client.decisions)
    assert outcome.stops > 4
    assert outcome.plans > 6
    audit = spawn([*COMMAND, 'audit', recording.bag, '--junit', tmp_path / 'audit.xml'])
    assert audit.wait() == 1, audit.stdout + audit.stderr
    said = verdicts(tmp_path / 'audit.xml')
    # The obstacle was put where the robot was, and the run was not driven to its end.
    assert (said['obstacles'], said['goal']) == ('failure', 'error')
    for check in ('finite', 'wheel_limits', 'as_decided', 'reasons', 'stop_at_end'):
        assert said[check] == 'passed'


def test_a_live_node_decides_the_same_on_played_odometry(start_node, client, spawn, tmp_path):
    bag = tmp_path / 'run' / 'bag'
    demo = spawn([*COMMAND, 'demo', 'case3', '--lockstep', '--output', bag.parent])
    assert demo.wait() == 0, demo.stderr
    before = [decision_to_key_values(each.entries) for each in recorded(bag) if not each.halted]
    # A slow machine must not make odometry late, in the time of the recording.
    start_node('guidance_node', {'autostart': False, 'use_sim_time': True, 'odom_timeout': 100.0})
    played = []
    client.node.create_subscription(Odometry, '/played', played.append, 1000)
    told = ['--topics', '/odom', '--topics', '/clock', '--remap', '/odom:=/played']
    player = spawn([*COMMAND, 'play', bag, '--paused', *told])
    # Whoever has answered a call knows what the caller subscribes and publishes.
    assert client.change_state('configure')
    assert client.change_state('activate')
    for name in ('pause', 'resume'):
        client.ros.call(Trigger, f'/player/{name}')
    # The node's subscription is best effort: it is told the next odometry when it has decided, so
    # that it hears all however slow it is.
    while len(client.decisions) < len(before):
        client.until(lambda: played)
        message, count = played.pop(0), len(client.decisions)
        client.odometry.publish(message)
        if Time.from_msg(message.header.stamp).nanoseconds == int(before[count]['stamp']):
            client.until(lambda count=count: len(client.decisions) > count)
    player.wait()
    assert [decision_to_key_values(each) for each in client.decisions] == before
