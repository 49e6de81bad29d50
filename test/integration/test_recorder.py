"""The recorder as a process, against real publishers."""

from __future__ import annotations

import json
import os
import re
import resource
import signal
import struct
import sys
import time
from functools import partial
from pathlib import Path

import pytest
import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import Twist
from nav_msgs.msg import Odometry
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rosbags.interfaces import QosDurability, QosReliability
from rosbags.rosbag2 import Reader
from rosgraph_msgs.msg import Clock
from ruamel.yaml import YAML
from std_msgs.msg import String
from std_srvs.srv import Trigger
from visualization_msgs.msg import Marker, MarkerArray

from cmpsp_ros.bags.reader import Bag
from cmpsp_ros.nodes.common.topics import HEALTH
from cmpsp_ros.nodes.recording.written import from_values

pytestmark = pytest.mark.integration

RECORDER = [sys.executable, '-m', 'cmpsp_ros.nodes.recording.recorder', '--ros-args']
COMMAND = [sys.executable, '-m', 'cmpsp_ros.cli']
COUNT = 2000
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
BEST_EFFORT = QoSProfile(depth=10, reliability=ReliabilityPolicy.BEST_EFFORT)
GAINS = [0.1 + 0.2, 1 / 3, 5e-324]


def publish_and_stop(recorder_pid):
    """Publish `COUNT` messages at 1 kHz and end the recorder right after the last."""
    rclpy.init()
    node = rclpy.create_node('talker', namespace='robot')
    node.declare_parameter('gains', GAINS)
    node.declare_parameter('names', ['a', 'b'])
    node.declare_parameter('bytes', [b'\x01', b'\xff'])
    commands = node.create_publisher(Twist, '/cmd_vel', QoSProfile(depth=COUNT))
    odometry = node.create_publisher(Odometry, '/odom', BEST_EFFORT)
    markers = node.create_publisher(MarkerArray, '/markers', LATCHED)
    # Latched before anybody listens.
    markers.publish(MarkerArray(markers=[Marker(id=7)]))
    end = time.monotonic() + 20.0
    while not all(each.get_subscription_count() for each in (commands, odometry, markers)):
        assert time.monotonic() < end, 'nobody listens'
        rclpy.spin_once(node, timeout_sec=0.02)
    begun = time.monotonic()
    for k in range(COUNT):
        twist = Twist()
        twist.linear.x = float(k)
        commands.publish(twist)
        if k % 20 == 0:
            message = Odometry()
            message.pose.pose.position.x = float(k)
            odometry.publish(message)
            rclpy.spin_once(node, timeout_sec=0.0)
        time.sleep(max(0.0, begun + (k + 1) * 1e-3 - time.monotonic()))
    os.kill(recorder_pid, signal.SIGTERM)
    # What a vanished publisher had not handed over would not be the recorder's loss.
    commands.wait_for_all_acked(Duration(seconds=5.0))
    rclpy.shutdown()


@pytest.fixture
def bag(tmp_path):
    return tmp_path / 'bag'


@pytest.fixture
def record(spawn, bag, wait_until):
    """Start the recorder, and wait until it records."""

    def start(*parameters):
        settings = [text for each in (f'output:={bag}', *parameters) for text in ('-p', each)]
        process = spawn([*RECORDER, *settings])
        wait_until(lambda: 'recording to' in process.stderr)
        return process

    return start


def heard(publisher):
    return lambda: publisher.get_subscription_count() > 0


def flushing(ros):
    """What flushes, and returns the number of messages in the bag by topic."""
    client, said = ros.node.create_client(Trigger, '/recorder/flush'), []
    ros.node.create_subscription(HEALTH.type, HEALTH.name, said.append, HEALTH.qos)
    ros.spin_until(client.service_is_ready)
    ros.spin_until(lambda: ros.node.count_publishers(HEALTH.name))

    def counted():
        statuses = [each for array in said for each in array.status]
        return [each for each in statuses if each.name == '/recorder: recorder']

    def counts():
        said.clear()
        future = client.call_async(Trigger.Request())
        ros.spin_until(future.done)
        assert future.result().success
        (*_, status) = ros.spin_until(counted)
        written = from_values({each.key: each.value for each in status.values})
        return {topic: each.count for topic, each in written.items()}

    return counts


@pytest.mark.smoke
def test_nothing_is_lost(record, spawn, bag):
    recorder = record()
    publisher = spawn([sys.executable, Path(__file__), str(recorder.pid)])
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

        assert set(recorded.parameters) == {'/recorder', '/robot/talker'}
        talker = recorded.parameters['/robot/talker']
        assert struct.pack('3d', *talker['gains']) == struct.pack('3d', *GAINS)
        assert (talker['names'], talker['bytes']) == (['a', 'b'], [1, 255])
        assert recorded.parameters['/recorder']['output'] == str(bag)


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
def test_signal_twice(record, bag, number):
    recorder = record()
    recorder.signal(number)
    recorder.signal(number)
    assert recorder.wait() == 0
    assert 'Traceback' not in recorder.stderr
    assert 'messages of' in recorder.stderr
    Bag(bag).close()


@pytest.mark.parametrize('delay', [0.0, 0.05, 0.1, 0.2])
def test_signal_in_early_life(spawn, wait_until, bag, delay):
    begun = time.monotonic()
    recorder = spawn([*RECORDER, '-p', f'output:={bag}'])
    wait_until(lambda: time.monotonic() - begun >= delay)
    recorder.signal(signal.SIGTERM)
    # Before our code runs, the operating system ends the process.
    assert recorder.wait() in {0, -signal.SIGTERM}
    assert 'Traceback' not in recorder.stderr
    if bag.exists():
        Bag(bag).close()


def test_signal_while_messages_keep_coming(record, ros, bag):
    recorder = record()
    publisher = ros.node.create_publisher(Twist, 'cmd_vel', 10)
    ros.node.create_timer(0.01, lambda: publisher.publish(Twist()))
    ros.spin_until(heard(publisher))
    recorder.signal(signal.SIGINT)
    ros.spin_until(lambda: recorder.process.poll() is not None)
    assert recorder.wait() == 0
    Bag(bag).close()


@pytest.mark.parametrize('parameters', [[], ['-p', 'output:=""']])
def test_output_missing(spawn, parameters):
    recorder = spawn([*RECORDER, *parameters])
    assert recorder.wait() == 1
    assert 'parameter output: expected the folder of the new bag' in recorder.stderr
    assert 'Traceback' not in recorder.stderr


def test_output_exists(spawn, bag):
    bag.mkdir()
    recorder = spawn([*RECORDER, '-p', f'output:={bag}'])
    assert recorder.wait() == 1
    (line,) = (each for each in recorder.stderr.splitlines() if 'FATAL' in each)
    assert f'parameter output: {bag}: exists already' in line
    assert 'Traceback' not in recorder.stderr
    assert list(bag.iterdir()) == []


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


def test_it_says_on_diagnostics_what_it_records(record, ros, bag):
    said = {}

    def hear(message):
        said.update({each.name: each for each in message.status})

    def knows_the_tester():
        status = said.get('/recorder: recorder')
        values = {each.key: each.value for each in status.values} if status else {}
        return '/tester' in values.get('parameters_of', '') and values

    ros.node.create_subscription(DiagnosticArray, '/diagnostics', hear, 10)
    ros.node.create_publisher(String, '/said', 10)
    record('topics:=[/said]')
    values = ros.spin_until(knows_the_tester)
    assert values['output'] == str(bag)
    assert int(values['topics']) > 0
    assert said['/recorder: recorder'].level == DiagnosticStatus.OK


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


def test_parameters_are_those_of_the_beginning(record, ros, bag):
    ros.node.declare_parameter('gain', 1.5)
    recorder = record()
    publisher = ros.node.create_publisher(String, 'said', 10)
    clients = []

    def answered():
        # The recorder's client comes, and goes when it has its answer.
        clients.append(ros.node.count_clients('/tester/get_parameters'))
        return 1 in clients and clients[-1] == 0

    ros.spin_until(answered)
    ros.spin_until(heard(publisher))
    ros.spin_until(heard(ros.node._parameter_event_publisher))
    ros.node.declare_parameter('late', 2.5)
    ros.node.set_parameters([Parameter('gain', value=9.0), Parameter('late', value=9.0)])
    recorder.signal(signal.SIGINT)
    ros.spin_until(lambda: recorder.process.poll() is not None)
    with Bag(bag) as recorded:
        tester = recorded.parameters['/tester']
        assert (tester['gain'], tester['late']) == (1.5, 2.5)
        changed = [
            (each.name, each.value.double_value)
            for _, event in recorded.messages('/parameter_events')
            for each in event.changed_parameters
        ]
        assert ('gain', 9.0) in changed


def test_a_node_that_is_started_anew_has_its_new_parameters_kept(record, ros, bag):
    recorder = record()
    for gain in (1.5, 1.5, 2.5):
        node = Node('other', context=ros.node.context)
        ros.executor.add_node(node)
        node.declare_parameter('gain', gain)
        count = partial(ros.node.count_clients, '/other/get_parameters')
        # The recorder's client comes, and goes when it has its answer.
        ros.spin_until(count)
        ros.spin_until(lambda count=count: count() == 0)
        since = ros.node.get_clock().now().nanoseconds
        ros.executor.remove_node(node)
        node.destroy_node()
        present = ros.node.get_node_names
        ros.spin_until(lambda present=present: 'other' not in present())
        # The recorder has to see that it is gone.
        end = time.monotonic() + 0.5
        ros.spin_until(lambda end=end: time.monotonic() > end)
    recorder.signal(signal.SIGINT)
    assert recorder.wait() == 0, recorder.stderr
    with Bag(bag) as recorded:
        assert recorded.parameters['/other']['gain'] == 1.5
        ((begun, values),) = recorded.restarts['/other']
        assert values['gain'] == 2.5
        assert since - 5_000_000_000 < begun < since


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


def test_full_disk_ends_the_recording(record, ros, bag):
    recorder = record()
    publisher = ros.node.create_publisher(String, '/said', 100)
    ros.spin_until(heard(publisher))
    resource.prlimit(recorder.pid, resource.RLIMIT_FSIZE, (300_000, 300_000))
    text = String(data='x' * 1000)
    ros.spin_until(lambda: publisher.publish(text) or recorder.process.poll() is not None)
    assert recorder.wait() == 1
    assert 'Traceback' not in recorder.stderr
    assert 'cannot write to the bag' in recorder.stderr
    with Bag(bag) as recorded:
        assert recorded.topics['/said'].count == len(list(recorded.messages('/said')))


def test_memory_and_custom_data(record, bag):
    recorder = record()
    status = Path(f'/proc/{recorder.pid}/status').read_text()
    resident = int(status.split('VmRSS:')[1].split()[0])
    recorder.signal(signal.SIGINT)
    assert recorder.wait() == 0
    assert resident < 110_000, 'kB'
    with Reader(bag) as reader:
        custom = reader.storage.metadata.custom
    assert json.loads(custom['cmpsp_ros.parameters'])['/recorder']['discovery_period'] == 0.1


@pytest.mark.parametrize(
    ('parameter', 'reason'),
    [
        ('storage:=rosbag1', "parameter storage: expected mcap or sqlite3, got 'rosbag1'"),
        ('compression:=lz4', "parameter compression: expected none or zstd, got 'lz4'"),
    ],
)
def test_wrong_form(spawn, bag, parameter, reason):
    recorder = spawn([*RECORDER, '-p', f'output:={bag}', '-p', parameter])
    assert recorder.wait() == 1
    assert reason in recorder.stderr
    assert not bag.exists()


if __name__ == '__main__':
    publish_and_stop(int(sys.argv[1]))
