"""How a recording ends, and what a recorder refuses to begin."""

from __future__ import annotations

import json
import re
import signal
import time
from pathlib import Path

import pytest
from geometry_msgs.msg import Twist
from recorder_process import RECORDER, heard
from rosbags.rosbag2 import Reader

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
