"""`cmpsp record` by its command line, and what is left when it is killed."""

import resource
import signal
import sys
import time

import pytest
from diagnostic_msgs.msg import DiagnosticArray
from nav_msgs.msg import Odometry
from rclpy.duration import Duration
from rclpy.qos import QoSProfile
from rosbags.highlevel import AnyReader
from rosbags.interfaces import QosReliability
from rosbags.rosbag2.storage_mcap import McapReader
from rosgraph_msgs.msg import Clock
from std_msgs.msg import String

from cmpsp_ros.bags import Bag

COMMAND = [sys.executable, '-m', 'cmpsp_ros.cli']
COUNT = 2000


def heard(publisher):
    return lambda: publisher.get_subscription_count() > 0


@pytest.mark.parametrize('options', [['--storage', 'mcap'], ['--storage', 'sqlite3']])
def test_killed_recorder_loses_at_most_a_second(spawn, ros, tmp_path, options):
    said = ros.node.create_publisher(String, '/said', QoSProfile(depth=COUNT))
    recorder = spawn([*COMMAND, 'record', '--output', 'bag', '--topic', '/said', *options])
    ros.spin_until(heard(said))
    sent = []

    def say():
        sent.append(time.time_ns())
        said.publish(String(data=str(len(sent))))

    ros.node.create_timer(0.01, say)
    ros.spin_until(lambda: len(sent) > 250)
    recorder.signal(signal.SIGKILL)
    killed_at = time.time_ns()
    assert recorder.wait() == -signal.SIGKILL

    read = spawn([*COMMAND, 'export', 'bag', '--output', 'tables'])
    assert read.wait() == 2
    assert 'the recording was cut off' in read.stderr
    recovery = spawn([*COMMAND, 'recover', 'bag'])
    assert recovery.wait() == 0, recovery.stderr
    with Bag(tmp_path / 'bag_recovered') as recovered:
        said_again = [int(each.data) for _, each in recovered.messages('/said')]
        assert recovered.topics['/said'].qos_profiles[0].reliability == QosReliability.RELIABLE
    assert said_again == list(range(1, len(said_again) + 1))
    wanted = [each for each in sent if each < killed_at - 1_000_000_000]
    assert len(said_again) >= len(wanted) > 100
    with AnyReader([tmp_path / 'bag_recovered']) as reader:
        assert reader.message_count >= len(said_again)


def test_command_records_our_topics_of_a_namespace(spawn, ros, tmp_path):
    ours = ros.node.create_publisher(Odometry, '/r1/odom', 1)
    others = [ros.node.create_publisher(Odometry, name, 1) for name in ('/odom', '/r1/other')]
    decisions = ros.node.create_publisher(DiagnosticArray, '/r1/guidance/decision', 1)
    clock = ros.node.create_publisher(Clock, '/clock', 1)
    recorder = spawn([*COMMAND, 'record', '--output', 'bag', '--namespace', '/r1'])
    recorded = (ours, decisions, clock)
    ros.spin_until(lambda: all(heard(each)() for each in recorded))
    assert not any(heard(each)() for each in others)
    for publisher, message in zip(recorded, (Odometry(), DiagnosticArray(), Clock()), strict=True):
        publisher.publish(message)
        publisher.wait_for_all_acked(Duration(seconds=60.0))
    recorder.signal(signal.SIGTERM)
    assert recorder.wait() == 0
    assert 'was to be recorded' not in recorder.stderr
    with Bag(tmp_path / 'bag') as bag:
        counts = {name: each.count for name, each in bag.topics.items()}
        assert bag.software['rclpy'] != 'unknown'
    counts.pop('/parameter_events')
    counts.pop('/diagnostics', None)
    assert counts == {'/r1/odom': 1, '/r1/guidance/decision': 1, '/clock': 1}


def test_command_records_everything_in_pieces(spawn, ros, tmp_path):
    said = ros.node.create_publisher(String, '/said', 1000)
    recorder = spawn(
        [
            *(*COMMAND, 'record', '--output', 'bag', '--all'),
            *('--split-duration', '0.2', '--split-size', '1'),
        ]
    )
    ros.spin_until(heard(said))
    begun = time.monotonic()
    ros.spin_until(lambda: said.publish(String(data='x')) or time.monotonic() - begun > 1.0)
    said.wait_for_all_acked(Duration(seconds=60.0))
    recorder.signal(signal.SIGINT)
    assert recorder.wait() == 0, recorder.stderr
    files = list((tmp_path / 'bag').glob('*.mcap'))
    assert len(files) > 2
    with AnyReader([tmp_path / 'bag']) as reader:
        stamps = [stamp for each, stamp, _ in reader.messages() if each.topic == '/said']
    assert len(stamps) > 10
    assert stamps == sorted(stamps)
    for each in files:
        file = McapReader(each)
        file.open()
        assert {chunk.compression for chunk in file.chunks} == {'zstd'}
        file.close()


def test_full_disk_ends_the_command(spawn, ros, tmp_path):
    said = ros.node.create_publisher(String, '/said', 100)
    recorder = spawn(
        [*COMMAND, 'record', '--output', 'bag', '--topic', '/said', '--compression', 'none']
    )
    ros.spin_until(heard(said))
    resource.prlimit(recorder.pid, resource.RLIMIT_FSIZE, (300_000, 300_000))
    text = String(data='x' * 1000)
    ros.spin_until(lambda: said.publish(text) or recorder.process.poll() is not None)
    assert recorder.wait() == 2
    assert 'cannot write to the bag' in recorder.stderr
    assert 'Traceback' not in recorder.stderr
    with Bag(tmp_path / 'bag') as bag:
        assert bag.topics['/said'].count == len(list(bag.messages('/said'))) > 100
