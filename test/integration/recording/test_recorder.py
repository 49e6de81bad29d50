"""The recorder as a process, against real publishers, and how a recording ends."""

import json
import re
import signal
import sys
import threading
import time
from pathlib import Path

import pytest
from geometry_msgs.msg import Twist
from rcl_interfaces.srv import SetParameters
from rclpy.duration import Duration
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile
from rclpy.serialization import deserialize_message
from recorder_process import RECORDER, flushing, heard
from rosbags.interfaces import QosDurability, QosReliability
from rosbags.rosbag2 import Reader
from rosgraph_msgs.msg import Clock
from ruamel.yaml import YAML
from std_msgs.msg import String, UInt32
from talker import BEST_EFFORT, COUNT

from cmpsp_ros.bags import Bag
from cmpsp_ros.nodes import MODULES
from cmpsp_ros.nodes.recording.received import RawSubscriptions

COMMAND = [sys.executable, '-m', 'cmpsp_ros.cli']
LOST = re.compile(r'/said: (\d+) messages, between ([\d.]+) and ([\d.]+) s of the recording')
TALKER = Path(__file__).parent / 'talker.py'


@pytest.mark.smoke
def test_nothing_is_lost(record, spawn, bag):
    recorder = record()
    publisher = spawn([sys.executable, TALKER, str(recorder.pid)])
    assert publisher.wait() == 0, publisher.stderr
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
    publisher.wait_for_all_acked(Duration(seconds=60.0))
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
    wanted.wait_for_all_acked(Duration(seconds=60.0))
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
    clock.wait_for_all_acked(Duration(seconds=60.0))
    said.publish(String(data='after'))
    said.wait_for_all_acked(Duration(seconds=60.0))
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
    clock.wait_for_all_acked(Duration(seconds=60.0))
    said.publish(String(data='after'))
    counts = flushing(ros)
    # It is not kept for ever until time goes on: a recorder that is killed has it.
    ros.spin_until(lambda: '/said' in counts())


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


@pytest.mark.parametrize(
    ('output', 'parameters', 'reason'),
    [
        (None, [], 'parameter output: expected the folder of the new bag'),
        ('', [], 'parameter output: expected the folder of the new bag'),
        ('.', [], r'parameter output: \S+: exists already'),
        ('bag', ['storage:=rosbag1'], "parameter storage: expected mcap or sqlite3, got 'rosbag1'"),
        ('bag', ['compression:=lz4'], "parameter compression: expected none or zstd, got 'lz4'"),
    ],
)
def test_refused(spawn, tmp_path, output, parameters, reason):
    place = f'output:={tmp_path / output}' if output else 'output:=""'
    settings = [*([] if output is None else [place]), *parameters]
    recorder = spawn([*RECORDER, *(text for each in settings for text in ('-p', each))])
    assert recorder.wait() == 1
    assert re.search(reason, recorder.stderr)
    assert 'Traceback' not in recorder.stderr
    assert not [*tmp_path.glob('bag'), *tmp_path.glob('*.mcap'), *tmp_path.glob('*.yaml')]


def test_memory_and_custom_data(record, bag):
    recorder = record()
    status = Path(f'/proc/{recorder.pid}/status').read_text()
    resident = int(status.split('VmRSS:')[1].split()[0])
    recorder.signal(signal.SIGINT)
    assert recorder.wait() == 0
    assert resident < 110_000, 'kB'
    with Reader(bag) as reader:
        custom = reader.storage.metadata.custom
    assert json.loads(custom['cmpsp_ros.software'])['rclpy'] != 'unknown'


def test_what_comes_first_is_taken_first_whichever_topic_is_looked_at_first(ros):
    many, topics = 10_000, ('/cause', '/effect')
    subscriptions = RawSubscriptions(ros.node)
    publishers = []
    for topic in topics:
        publishers.append(ros.node.create_publisher(UInt32, topic, QoSProfile(depth=many)))
        subscriptions.add(topic, UInt32, QoSProfile(depth=many))
    ros.spin_until(lambda: all(each.get_subscription_count() for each in publishers))

    def publish():
        for k in range(many):
            for each in publishers:
                each.publish(UInt32(data=k))

    publishing = threading.Thread(target=publish)
    publishing.start()
    rounds = []
    while publishing.is_alive():
        rounds.append(subscriptions.take())
    publishing.join()
    rounds += [subscriptions.take(), subscriptions.take(all_=True)]
    taken = [
        (deserialize_message(each.raw, UInt32).data, each.topic)
        for batch in rounds
        for each in batch
    ]
    assert sum(bool(batch) for batch in rounds) > 10
    assert taken == [(k, topic) for k in range(many) for topic in topics]
    assert list(subscriptions.lost()) == []
    subscriptions.close()


KEY = 'noise.position_stddev'


@pytest.fixture
def start_sim(spawn):
    """Start a simulator, with a value of the parameter."""
    command = [sys.executable, '-m', MODULES['sim_node'], '--ros-args', '-p']
    return lambda value: spawn([*command, f'{KEY}:={value}'])


@pytest.fixture
def change(ros):
    """Change the parameter of the simulator."""

    def change(value):
        wanted = [Parameter(KEY, value=value).to_parameter_msg()]
        request = SetParameters.Request(parameters=wanted)
        assert ros.call(SetParameters, '/sim/set_parameters', request).results[0].successful

    return change


def changes(bag):
    return [
        each.value.double_value
        for _, event in bag.messages('/parameter_events')
        for each in event.changed_parameters
        if event.node == '/sim'
    ]


def test_they_are_those_before_the_first_recorded_change(record, ros, bag, start_sim, change):
    start_sim(0.125)
    change(0.25)
    # What topics are chosen does not matter.
    recorder = record('topics:=[/odom]')
    counts = flushing(ros)
    ros.spin_until(lambda: counts().get('/sim/parameters') == 1)
    change(0.5)
    ros.spin_until(lambda: counts().get('/sim/parameters') == 2)
    recorder.signal(signal.SIGINT)
    assert recorder.wait() == 0
    with Bag(bag) as recorded:
        assert recorded.parameters['/sim'][KEY] == 0.25
        assert changes(recorded) == [0.5]
        assert recorded.restarts == {}


def test_a_node_that_is_started_anew_has_its_new_parameters_kept(record, ros, bag, start_sim):
    recorder = record()
    counts, begun = flushing(ros), []
    for number, value in enumerate((0.125, 0.25), 1):
        begun.append(ros.node.get_clock().now().nanoseconds)
        simulator = start_sim(value)
        ros.spin_until(lambda number=number: counts().get('/sim/parameters') == number)
        simulator.signal(signal.SIGINT)
        assert simulator.wait() == 0
    recorder.signal(signal.SIGINT)
    assert recorder.wait() == 0, recorder.stderr
    with Bag(bag) as recorded:
        assert recorded.parameters['/sim'][KEY] == 0.125
        ((since, values),) = recorded.restarts['/sim']
        assert values[KEY] == 0.25
        assert begun[0] < begun[1] < since
