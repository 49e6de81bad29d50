"""Latency through the real guidance node, over DDS."""

import json
import sys
from pathlib import Path

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticStatus, KeyValue
from geometry_msgs.msg import TwistStamped
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.time import Time

from benchmarks.common import BenchError
from benchmarks.over_dds.latency import measure_latency
from cmpsp_ros.nodes.common import SIM_ODOM
from cmpsp_ros.nodes.common.topics import DECISION
from cmpsp_ros.parameters import load_parameter_file
from cmpsp_ros.parameters.files import write_parameter_file

PERIOD_NS = 20_000_000


def values(**pairs: object) -> list[KeyValue]:
    return [KeyValue(key=key, value=str(value)) for key, value in pairs.items()]


@pytest.fixture
def short(tmp_path: Path) -> Path:
    """Case 3 with a goal that is near."""
    values = load_parameter_file('case3')
    values |= {'final_time': 2.0, 'goal.position': [2.8, -9.6], 'obstacles.names': []}
    values = {key: value for key, value in values.items() if not key.startswith('obstacles.')}
    path = tmp_path / 'short.yaml'
    write_parameter_file(path, values)
    return path


@pytest.fixture
def probe(spawn, tmp_path: Path, short: Path):
    """Start the probe: `probe(key=value)`."""

    def start(**parameters):
        given = {'parameters': short, 'output': tmp_path / 'out.json', **parameters}
        pairs = [f'{key}:={value}' for key, value in given.items() if value]
        flags = [flag for pair in pairs for flag in ('-p', pair)]
        probe = [sys.executable, '-m', 'benchmarks.over_dds.latency_probe']
        return spawn([*probe, '--ros-args', *flags])

    return start


def test_a_whole_run_is_measured(short: Path):
    found = measure_latency(str(short), 1)
    assert found.runs == 1
    assert len(found.total) == len(found.own)
    assert 2 <= len(found.total) <= 10
    assert (found.own > 0.0).all()
    # A command may be answered before it is published to all, the end of its own time.
    assert np.median(found.total) > 0.5 * np.median(found.own)
    # It started 2.8 m away.
    assert found.miss < 2.0
    assert len(found.jitter) == len(found.total) - 1
    assert min(found.resident_active, found.resident_end) > 10.0


def test_odometry_keeps_its_grid_and_commands_move_the_robot(probe, ros, tmp_path: Path):
    odometry = []
    listened = QoSProfile(depth=100, reliability=ReliabilityPolicy.BEST_EFFORT)
    ros.node.create_subscription(SIM_ODOM.type, 'odom', odometry.append, listened)
    commands = ros.node.create_publisher(TwistStamped, 'cmd_vel', 10)
    decisions = ros.node.create_publisher(DECISION.type, '/guidance/decision', 100)
    running = probe()

    ros.spin_until(lambda: odometry and commands.get_subscription_count())
    ros.spin_until(decisions.get_subscription_count)
    first = odometry[0].pose.pose.position
    assert (first.x, first.y) == (0.0, -9.25)

    def drive():
        message = TwistStamped()
        message.header.stamp = odometry[-1].header.stamp
        message.twist.linear.x = 1.0
        commands.publish(message)
        return odometry[-1].pose.pose.position.x > 0.1

    ros.spin_until(drive)
    stamps = np.array([Time.from_msg(each.header.stamp).nanoseconds for each in odometry])
    assert (np.diff(stamps) % PERIOD_NS == 0).all()
    assert (np.diff(stamps) > 0).all()

    def decision(**entries):
        return DECISION.type(status=[DiagnosticStatus(values=values(**entries))])

    decisions.publish(decision(stamp=stamps[0], finished='false', halted='false', step_ms=0.25))
    over = decision(stamp=stamps[-1], finished='true', halted='false')
    ros.spin_until(lambda: decisions.publish(over) or (tmp_path / 'out.json').exists())
    found = json.loads((tmp_path / 'out.json').read_text())
    assert len(found['total_ms']) == len(found['own_ms']) <= 1
    last = odometry[len(stamps) - 1].pose.pose.position
    assert found['miss_m'] == pytest.approx(np.hypot(last.x - 2.8, last.y + 9.6))
    assert running.process.poll() is None


@pytest.mark.parametrize(
    ('parameters', 'said'),
    [
        ({'output': ''}, 'parameter output: expected a file to write to'),
        ({'parameters': 'cas3'}, 'did you mean case3?'),
    ],
)
def test_it_refuses_to_start(probe, parameters, said):
    running = probe(**parameters)
    assert running.wait() == 1
    assert said in running.stderr
    assert 'Traceback' not in running.stderr


def test_a_preset_that_the_node_refuses(tmp_path: Path):
    path = tmp_path / 'bad.yaml'
    write_parameter_file(path, load_parameter_file('case3') | {'goal.position': [0.0, 0.0]})
    with pytest.raises(BenchError, match='latency: '):
        measure_latency(str(path), 1)
