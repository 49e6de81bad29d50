"""The nodes take the command lines that `ros2 launch` makes of the launch files.

`launch` is not on the Python package index. So what the files decide is run by itself; the command
lines are put together as `launch_ros` does, and run.
"""

import json
import signal
import sys
from pathlib import Path

import pytest
import yaml
from geometry_msgs.msg import Twist
from nav_msgs.msg import Odometry
from rclpy.qos import QoSProfile, ReliabilityPolicy

from cmpsp_ros.bags import Bag, Names
from cmpsp_ros.bags.replay.replay import replay
from cmpsp_ros.nodes import MODULES
from cmpsp_ros.nodes.common.topics import HEALTH
from cmpsp_ros.nodes.recording.received import from_values

ROOT = Path(__file__).parents[2]
RECORDED = {'/r1/odom', '/r1/cmd_vel', '/r1/guidance/decision', '/clock'}
BEST_EFFORT = QoSProfile(depth=100, reliability=ReliabilityPolicy.BEST_EFFORT)


@pytest.fixture
def commands(launch_file, tmp_path):
    """By executable: the command line that launch_ros makes of each node to be started."""

    def made(name, **arguments):
        loaded = launch_file(ROOT / 'launch' / name)
        defaults = {key: default for key, (default, _) in loaded['ARGUMENTS'].items()}
        found = {}
        for node in loaded['nodes']({**defaults, **arguments}):
            files = []
            for each in node['parameters']:
                path = each
                if isinstance(each, dict):
                    path = tmp_path / f'{node["executable"]}_{len(files)}.yaml'
                    path.write_text(yaml.dump({'/**': {'ros__parameters': each}}))
                files += ['--params-file', path]
            place = ['-r', f'__ns:=/{node["namespace"]}'] if node['namespace'] else []
            names = [part for old, new in node['remappings'] for part in ('-r', f'{old}:={new}')]
            module = [sys.executable, '-m', MODULES[node['executable']]]
            more = ['--ros-args', *place, *names, *files]
            found[node['executable']] = [*module, *node['arguments'], *more]
        return found

    return made


def test_what_is_left_out_is_not_started(commands):
    plain = commands('guidance.launch.py', params_file='course.yaml')
    assert set(plain) == {'guidance_node'}
    assert '__ns' not in ' '.join(map(str, plain['guidance_node']))
    full = commands('guidance.launch.py', params_file='course.yaml', record='bag', view='true')
    assert set(full) == {'guidance_node', 'recorder', 'viewer'}


def test_a_robot_in_a_namespace_drives_in_simulated_time_and_is_recorded(
    spawn, ros, tmp_path, commands
):
    given = {'namespace': 'r1', 'use_sim_time': 'true', 'log_level': 'warn', 'autostart': 'true'}
    given['robot_file'] = str(ROOT / 'config' / 'robots' / 'jackal.yaml')
    given['params_file'] = str(ROOT / 'config' / 'case3_wide.yaml')
    bag = tmp_path / 'bag'
    started = {
        **commands('guidance.launch.py', record=str(bag), **given),
        **commands('demo.launch.py', **given),
    }
    assert set(started) == {'sim_node', 'guidance_node', 'recorder'}
    twists, places = [], []
    ros.node.create_subscription(Twist, '/r1/cmd_vel', twists.append, 10)
    ros.node.create_subscription(Odometry, '/r1/odom', places.append, BEST_EFFORT)
    running = {name: spawn(command) for name, command in started.items()}
    ros.spin_until(lambda: len(twists) > 5 and places[-1].pose.pose.position.x > 0.1)
    # Of the second file, and on the clock of the simulator.
    assert twists[-1].linear.x > 0.5
    assert places[-1].header.stamp.sec < 1000
    said = {}

    def hear(message):
        for each in message.status:
            said[each.name] = {value.key: value.value for value in each.values}

    ros.node.create_subscription(HEALTH.type, HEALTH.name, hear, HEALTH.qos)

    def are_recorded():
        written = from_values(said.get('/r1/recorder: recorder', {}))
        return set(written) >= RECORDED and written['/r1/guidance/decision'].count > 10

    ros.spin_until(are_recorded)
    assert 'no recorder' not in running['guidance_node'].stderr
    for each in reversed(running.values()):
        each.signal(signal.SIGINT)
        assert each.wait() == 0, each.stderr
        assert '[INFO]' not in each.stderr
        assert 'Traceback' not in each.stderr
    with Bag(bag) as recorded:
        assert set(recorded.topics) >= RECORDED
        assert recorded.parameters['/r1/guidance']['robot.wheel_radius'] == 0.098
    # It has begun when the recorder listened, and so it can be replayed.
    outcome = replay(bag, Names.under('/r1'))
    assert (outcome.first, outcome.skipped) == (None, 0)


OPEN = """
import os, subprocess, sys, time
subprocess.Popen([*sys.argv[1:], '-p', f'stop_with_process:={os.getpid()}'])
time.sleep(600)
"""


def test_however_the_launch_ends_the_robot_stops(spawn, ros):
    course = ['--params-file', ROOT / 'config/case3.yaml', '-p', 'autostart:=true']
    launch = spawn([
        sys.executable, '-c', OPEN,
        sys.executable, '-m', MODULES['guidance_node'], '--ros-args', *course,
    ])  # fmt: skip
    simulator = spawn([sys.executable, '-m', MODULES['sim_node'], '--ros-args', *course])
    twists = []
    ros.node.create_subscription(Twist, '/cmd_vel', twists.append, 10)
    ros.spin_until(lambda: len(twists) > 3 and twists[-1].linear.x > 0.5)
    launch.signal(signal.SIGKILL)
    ros.spin_until(lambda: twists[-1] == Twist())
    ros.spin_until(lambda: not ros.node.count_publishers('/cmd_vel'))
    assert 'has ended, and so does this node' in launch.stderr
    assert simulator.process.poll() is None


OPEN_ALL = """
import json, os, subprocess, sys, time
for each in json.loads(sys.argv[1]):
    subprocess.Popen([*each, '-p', f'stop_with_process:={os.getpid()}'])
time.sleep(600)
"""


def is_gone(pid):
    # One that was adopted may wait for ever to be buried.
    path = Path(f'/proc/{pid}/stat')
    return not path.exists() or path.read_text().rsplit(')', 1)[1].split()[0] in 'XZ'


@pytest.mark.parametrize('number', [signal.SIGKILL, signal.SIGTERM])
def test_a_launch_that_is_killed_leaves_nothing_behind(
    spawn, ros, tmp_path, commands, wait_until, number
):
    bag = tmp_path / 'bag'
    given = {'params_file': str(ROOT / 'config/case3.yaml'), 'autostart': 'true'}
    started = {
        **commands('guidance.launch.py', record=str(bag), view='true', **given),
        **commands('demo.launch.py', **given),
    }
    every = [[str(part) for part in each] for each in started.values()]
    launch = spawn([sys.executable, '-c', OPEN_ALL, json.dumps(every)])
    twists = []
    ros.node.create_subscription(Twist, '/cmd_vel', twists.append, 10)
    ros.spin_until(lambda: len(twists) > 3 and twists[-1].linear.x > 0.5)
    nodes = Path(f'/proc/{launch.pid}/task/{launch.pid}/children').read_text().split()
    assert len(nodes) == 4
    launch.signal(number)
    wait_until(lambda: all(map(is_gone, nodes)))
    assert 'Traceback' not in launch.stderr
    # The recorder is the last to go: the bag is whole, and has the robot stop.
    with Bag(bag) as recorded:
        (*_, (_, last)) = recorded.messages('/cmd_vel')
        (*_, (_, truth)) = recorded.messages('/sim/truth')
    assert (last.linear.x, last.angular.z) == (0.0, 0.0)
    assert (truth.twist.twist.linear.x, truth.twist.twist.angular.z) == (0.0, 0.0)


def test_after_a_launch_that_has_ended_it_does_not_set_off(spawn, wait_until):
    course = ['--params-file', ROOT / 'config/case3.yaml', '-p', 'autostart:=true']
    gone = spawn([sys.executable, '-c', 'pass'])
    assert gone.wait() == 0
    more = ['-p', f'stop_with_process:={gone.pid}']
    running = spawn([sys.executable, '-m', MODULES['guidance_node'], '--ros-args', *course, *more])
    assert running.wait() == 0
    assert 'nominal' not in running.stderr
