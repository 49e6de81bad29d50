"""How a recording ends, and what a recorder refuses to begin."""

from __future__ import annotations

import json
import resource
import signal
import time
from pathlib import Path

import pytest
from geometry_msgs.msg import Twist
from recorder_process import RECORDER, heard
from rosbags.rosbag2 import Reader
from std_msgs.msg import String

from cmpsp_ros.bags import Bag

pytestmark = pytest.mark.integration


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


def test_full_disk_ends_the_recording(record, ros, bag):
    recorder = record('compression:=none')
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
    assert json.loads(custom['cmpsp_ros.software'])['rclpy'] != 'unknown'
