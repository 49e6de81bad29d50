"""The recorder as a process, against real publishers."""

from __future__ import annotations

import re
import signal
import sys
import time
from pathlib import Path

import pytest
from geometry_msgs.msg import Twist
from rclpy.duration import Duration
from recorder_process import flushing, heard
from rosbags.interfaces import QosDurability, QosReliability
from rosgraph_msgs.msg import Clock
from ruamel.yaml import YAML
from std_msgs.msg import String
from talker import BEST_EFFORT, COUNT

from cmpsp_ros.bags import Bag

pytestmark = pytest.mark.integration
COMMAND = [sys.executable, '-m', 'cmpsp_ros.cli']
LOST = re.compile(r'/said: (\d+) messages, between ([\d.]+) and ([\d.]+) s of the recording')
TALKER = Path(__file__).parent / 'talker.py'


@pytest.mark.smoke
def test_nothing_is_lost(record, spawn, bag):
    recorder = record()
    publisher = spawn([sys.executable, TALKER, str(recorder.pid)])
    assert publisher.wait(40.0) == 0, publisher.stderr
    assert recorder.wait() == 0
    assert 'Traceback' not in recorder.stderr
    information = YAML(typ='safe').load((bag / 'metadata.yaml').read_text())
    assert information['rosbag2_bagfile_information']['version'] == 9
    with Bag(bag) as recorded:
        commands = [each.linear.x for _, each in recorded.messages('/cmd_vel')]
        assert commands == [float(k) for k in range(COUNT)]
        odometry = [each.pose.pose.position.x for _, each in recorded.messages('/odom')]
        assert odometry == [float(k) for k in range(0, COUNT, 20)]
        ((_, markers),) = recorded.messages('/markers')
        assert [each.id for each in markers.markers] == [7]
        stamps = [stamp for stamp, _ in recorded.raw('/cmd_vel')]
        assert stamps == sorted(stamps)
        assert abs(stamps[-1] - time.time_ns()) < 60e9

        offered = {name: each.qos_profiles[0] for name, each in recorded.topics.items()}
        assert {name: (each.reliability, each.durability) for name, each in offered.items()} == {
            '/cmd_vel': (QosReliability.RELIABLE, QosDurability.VOLATILE),
            '/odom': (QosReliability.BEST_EFFORT, QosDurability.VOLATILE),
            '/markers': (QosReliability.RELIABLE, QosDurability.TRANSIENT_LOCAL),
            '/rosout': (QosReliability.RELIABLE, QosDurability.TRANSIENT_LOCAL),
            '/parameter_events': (QosReliability.RELIABLE, QosDurability.VOLATILE),
            '/diagnostics': (QosReliability.RELIABLE, QosDurability.VOLATILE),
        }
        assert (offered['/rosout'].lifespan.sec, offered['/odom'].lifespan.sec) == (10, 9223372036)


def test_messages_that_came_too_fast_are_counted(record, ros, bag, wait_until):
    publisher = ros.node.create_publisher(String, '/said', 1)
    recorder = record('topics:=[/said]')
    ros.spin_until(heard(publisher))
    recorder.signal(signal.SIGSTOP)
    said = 5000
    for _ in range(said):
        publisher.publish(String(data=1000 * '.'))
    recorder.signal(signal.SIGCONT)
    publisher.wait_for_all_acked(Duration(seconds=10.0))
    wait_until(lambda: 'messages of /said come too fast' in recorder.stderr)
    recorder.signal(signal.SIGINT)
    assert recorder.wait() == 0
    (found,) = LOST.findall(recorder.stderr)
    count, begin, end = map(float, found)
    assert 0.0 <= begin < end
    with Bag(bag) as recorded:
        assert recorded.topics['/said'].count + count == said


def test_flush_answers_with_what_is_in_the_bag(record, ros, bag):
    publisher = ros.node.create_publisher(String, '/said', 10)
    recorder = record('topics:=[/said]')
    ros.spin_until(heard(publisher))
    counts = flushing(ros)
    assert counts() == {}
    for _ in range(7):
        publisher.publish(String(data='this'))
    ros.spin_until(lambda: counts() == {'/said': 7})
    recorder.signal(signal.SIGINT)
    assert recorder.wait() == 0
    with Bag(bag) as recorded:
        assert len(list(recorded.messages('/said'))) == 7


@pytest.mark.parametrize(
    'parameters', [['topics:=[/wanted, /never]'], ['exclude_topics:=[/other, /rosout]']]
)
def test_choice_of_topics(record, ros, bag, parameters):
    wanted = ros.node.create_publisher(Twist, '/wanted', 1)
    ros.node.create_publisher(Twist, '/other', 10)
    ros.node.create_publisher(Twist, '/_hidden/topic', 10)
    recorder = record(*parameters)
    ros.spin_until(heard(wanted))
    wanted.publish(Twist())
    wanted.wait_for_all_acked(Duration(seconds=5.0))
    recorder.signal(signal.SIGINT)
    assert recorder.wait() == 0
    assert ('/never was to be recorded' in recorder.stderr) == ('never' in parameters[0])
    with Bag(bag) as recorded:
        assert recorded.topics['/wanted'].count == 1
        assert not {'/other', '/_hidden/topic', '/rosout'} & set(recorded.topics)


def test_late_publisher_that_does_not_fit(record, ros, bag, wait_until):
    reliable = ros.node.create_publisher(Twist, '/cmd_vel', 10)
    recorder = record()
    ros.spin_until(heard(reliable))
    ros.node.create_publisher(Twist, '/cmd_vel', BEST_EFFORT)
    # The name of its node may come later than the publisher.
    said = re.compile(r'/cmd_vel of \S+ is not recorded: incompatible')
    wait_until(lambda: said.search(recorder.stderr))


def test_simulated_time(record, ros, bag):
    recorder = record('use_sim_time:=true')
    clock = ros.node.create_publisher(Clock, '/clock', 1)
    said = ros.node.create_publisher(String, '/said', 2)
    ros.spin_until(lambda: clock.get_subscription_count() >= 2 and heard(said)())
    said.publish(String(data='before the clock'))
    tick = Clock()
    tick.clock.sec = 5
    clock.publish(tick)
    clock.wait_for_all_acked(Duration(seconds=5.0))
    said.publish(String(data='after'))
    said.wait_for_all_acked(Duration(seconds=5.0))
    recorder.signal(signal.SIGINT)
    assert recorder.wait() == 0
    with Bag(bag) as recorded:
        assert [stamp for stamp, _ in recorded.raw('/said')] == [5 * 10**9] * 2


@pytest.mark.parametrize('now', [0, 5])
def test_simulated_time_that_stands_still(record, ros, now):
    record('use_sim_time:=true')
    clock = ros.node.create_publisher(Clock, '/clock', 1)
    said = ros.node.create_publisher(String, '/said', 2)
    ros.spin_until(lambda: clock.get_subscription_count() >= 2 and heard(said)())
    tick = Clock()
    tick.clock.sec = now
    clock.publish(tick)
    clock.wait_for_all_acked(Duration(seconds=5.0))
    said.publish(String(data='after'))
    counts = flushing(ros)
    # It is not kept for ever until time goes on: a recorder that is killed has it.
    ros.spin_until(lambda: '/said' in counts())
