"""The nodes take the command lines that `ros2 launch` makes of the launch files.

`launch` is not on the Python package index. So the files are read here, by their syntax, for the
expressions that they have; the command lines are put together as `launch_ros` does, and run.
"""

from __future__ import annotations

import ast
import signal
import sys
from pathlib import Path

import pytest
import yaml
from geometry_msgs.msg import Twist
from nav_msgs.msg import Odometry
from rclpy.qos import QoSProfile, ReliabilityPolicy
from std_srvs.srv import Trigger

from cmpsp_ros.bags.reader import Bag
from cmpsp_ros.nodes import MODULES
from cmpsp_ros.nodes.recording.flush_answer import from_json

pytestmark = pytest.mark.integration

LIMIT = 60.0
ROOT = Path(__file__).parents[2]
RECORDED = {'/r1/odom', '/r1/cmd_vel', '/r1/guidance/decision', '/clock'}
BEST_EFFORT = QoSProfile(depth=100, reliability=ReliabilityPolicy.BEST_EFFORT)


class LaunchFile:
    """Expressions of a launch file, and what they are worth with some arguments given."""

    def __init__(self, name, **given):
        tree = ast.parse((ROOT / 'launch' / name).read_text(encoding='utf-8'))
        walked = list(ast.walk(tree))
        self.named = {
            each.targets[0].id: each.value for each in walked if isinstance(each, ast.Assign)
        }
        self.calls = [each for each in walked if isinstance(each, ast.Call)]
        self.arguments = dict(given)
        for call in self.called('DeclareLaunchArgument'):
            self.arguments.setdefault(call.args[0].value, self.of(call, 'default_value'))

    def called(self, name):
        return [each for each in self.calls if getattr(each.func, 'id', '') == name]

    def of(self, call, keyword, missing=None):
        found = [each.value for each in call.keywords if each.arg == keyword]
        return self.value(found[0]) if found else missing

    def value(self, node):
        match node:
            case ast.Constant():
                return node.value
            case ast.Name():
                return self.value(self.named[node.id])
            case ast.List() | ast.Tuple():
                return [self.value(each) for each in node.elts]
            case ast.Dict():
                keys = (each.value for each in node.keys)
                return {key: self.typed(each) for key, each in zip(keys, node.values, strict=True)}
            case ast.Call():
                return self.substituted(node.func.id, [self.value(each) for each in node.args])
        pytest.fail(f'no reading of {ast.unparse(node)}')

    def typed(self, node):
        """What a parameter is: text is read as YAML unless it is said to be text."""
        value = self.value(node)
        is_text = isinstance(node, ast.Call) and node.func.id == 'ParameterValue'
        return yaml.safe_load(value) if isinstance(value, str) and not is_text else value

    def substituted(self, name, values):
        first = values[0]
        match name:
            case 'LaunchConfiguration':
                return self.arguments[first]
            case 'PathJoinSubstitution':
                return '/'.join(map(str, first))
            case 'FindPackageShare':
                assert first == 'cmpsp_ros'
                return ROOT
            case 'NotEqualsSubstitution':
                return first != values[1]
            case 'IfCondition':
                return yaml.safe_load(first) if isinstance(first, str) else first
            case 'ParameterValue':
                return first
        pytest.fail(f'no reading of {name}')

    def commands(self, folder):
        """By executable: its command line, of each node that is to be started."""
        for call in self.called('Node'):
            if not self.of(call, 'condition', True):
                continue
            name, files = self.of(call, 'executable'), []
            for each in self.of(call, 'parameters'):
                path = each
                if isinstance(each, dict):
                    path = folder / f'{name}_{len(files)}.yaml'
                    path.write_text(yaml.dump({'/**': {'ros__parameters': each}}))
                files += ['--params-file', path]
            namespace = self.of(call, 'namespace')
            place = ['-r', f'__ns:=/{namespace}'] if namespace else []
            more = self.of(call, 'arguments')
            module = [sys.executable, '-m', MODULES[name]]
            yield name, [*module, *more, '--ros-args', *place, *files]


def test_what_is_left_out_is_not_started(tmp_path):
    plain = dict(LaunchFile('guidance.launch.py').commands(tmp_path))
    assert set(plain) == {'guidance_node'}
    assert '__ns' not in ' '.join(map(str, plain['guidance_node']))
    full = LaunchFile('guidance.launch.py', record='bag', view='true')
    assert set(dict(full.commands(tmp_path))) == {'guidance_node', 'recorder', 'viewer'}


def test_a_robot_in_a_namespace_drives_in_simulated_time_and_is_recorded(spawn, ros, tmp_path):
    given = {'namespace': 'r1', 'use_sim_time': 'true', 'log_level': 'warn'}
    given['robot_file'] = str(ROOT / 'config' / 'robots' / 'jackal.yaml')
    given['params_file'] = str(ROOT / 'config' / 'case3_wide.yaml')
    bag = tmp_path / 'bag'
    commands = {
        **dict(LaunchFile('demo.launch.py', **given).commands(tmp_path)),
        **dict(LaunchFile('guidance.launch.py', record=str(bag), **given).commands(tmp_path)),
    }
    assert set(commands) == {'sim_node', 'guidance_node', 'recorder'}
    twists, places = [], []
    ros.node.create_subscription(Twist, '/r1/cmd_vel', twists.append, 10)
    ros.node.create_subscription(Odometry, '/r1/odom', places.append, BEST_EFFORT)
    running = {name: spawn(command) for name, command in commands.items()}
    ros.spin_until(lambda: len(twists) > 5 and places[-1].pose.pose.position.x > 0.1, LIMIT)
    # Of the second file, and on the clock of the simulator.
    assert twists[-1].linear.x > 0.5
    assert places[-1].header.stamp.sec < 1000
    flush = ros.node.create_client(Trigger, '/r1/recorder/flush')
    ros.spin_until(flush.service_is_ready, LIMIT)

    def are_recorded():
        """The nodes drive as soon as they can; the recorder takes up to seconds to find them."""
        answer = flush.call_async(Trigger.Request())
        ros.spin_until(answer.done, LIMIT)
        written = from_json(answer.result().message)
        return set(written) >= RECORDED and written['/r1/guidance/decision'].count > 10

    ros.spin_until(are_recorded, LIMIT)
    for each in reversed(running.values()):
        each.signal(signal.SIGINT)
        assert each.wait(LIMIT) == 0, each.stderr
        assert '[INFO]' not in each.stderr
        assert 'Traceback' not in each.stderr
    with Bag(bag) as recorded:
        assert set(recorded.topics) >= RECORDED
        assert recorded.parameters['/r1/guidance']['robot.wheel_radius'] == 0.098
