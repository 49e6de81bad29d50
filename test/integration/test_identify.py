"""`cmpsp identify --drive` with robots that it has to find out about, over DDS."""

import math
import signal
import sys
from pathlib import Path

import pytest
from geometry_msgs.msg import Twist
from nav_msgs.msg import Odometry

from cmpsp_ros.bags import Bag
from cmpsp_ros.bags.identify import identify
from cmpsp_ros.nodes import MODULES
from cmpsp_ros.parameters.files import load_robot

HERE = Path(__file__).parent
IDENTIFY = [sys.executable, '-m', 'cmpsp_ros.cli', 'identify', '--drive', '--yes', '--output']


def last_command(bag):
    with Bag(bag) as opened:
        *_, (_, message) = opened.messages('/cmd_vel')
    twist = getattr(message, 'twist', message)
    return twist.linear.x, twist.angular.z


def test_a_simulated_robot_is_identified(spawn, tmp_path):
    hidden = ['actuation_delay:=0.08', 'wheel_lag:=0.1', 'noise.position_stddev:=0.002']
    flags = [part for each in (*hidden, 'odom_rate:=40.0') for part in ('-p', each)]
    sim = spawn([sys.executable, '-m', MODULES['sim_node'], '--ros-args', *flags])
    done = spawn([*IDENTIFY, tmp_path / 'out'])
    assert done.wait() == 0, done.stderr
    assert sim.process.poll() is None
    assert last_command(tmp_path / 'out' / 'bag') == (0.0, 0.0)
    found = identify([tmp_path / 'out' / 'bag']).estimates
    # A busy machine adds to the delay, but takes nothing away.
    assert 0.17 < found['together'].interval.value < 0.23
    assert found['lag'].interval.low < 0.11
    assert found['lag'].interval.high > 0.09
    assert found['linear_scale'].interval.value == pytest.approx(1.0, abs=0.01)
    assert found['position'].interval.value == pytest.approx(0.002, rel=0.2)
    given = load_robot(str(tmp_path / 'out' / 'robot.yaml'))
    assert 0.17 < given['command_delay'] < 0.25


def test_a_robot_that_shares_nothing_with_this_package_is_identified(spawn, tmp_path):
    """It hears TwistStamped, lags by 0.1 s, and speeds up by 1 m/s^2 at most."""
    robot = spawn([sys.executable, HERE / 'foreign_robot.py', '0', '0', '0', tmp_path / 'path'])
    done = spawn([*IDENTIFY, tmp_path / 'out', '--max-speed', '0.3', '--max-turn', '1.5'])
    assert done.wait() == 0, done.stderr
    robot.end()
    assert 'linear acceleration' in done.stdout
    found = identify([tmp_path / 'out' / 'bag']).estimates
    assert found['linear_acceleration'].interval.value == pytest.approx(1.0, abs=0.1)
    assert found['together'].interval.value == pytest.approx(0.11, abs=0.03)
    assert found['rate'].interval.value == pytest.approx(30.0, rel=0.05)
    assert load_robot(str(tmp_path / 'out' / 'robot.yaml'))['enable_stamped_cmd_vel'] is True


class Runaway:
    """Odometry of a robot that goes faster than it is told, until it says no more."""

    def __init__(self, node, factor):
        self.factor, self.x, self.heard, self.is_silent = factor, 0.0, [], False
        self.odometry = node.create_publisher(Odometry, 'odom', 10)
        node.create_subscription(Twist, 'cmd_vel', self.obey, 10)
        node.create_timer(0.02, self.tick)

    def obey(self, twist):
        self.heard.append((twist.linear.x, twist.angular.z))

    @property
    def moving(self):
        return bool(self.heard) and self.heard[-1][0] > 0.0

    def tick(self):
        if self.is_silent:
            return
        self.x += 0.02 * self.factor * (self.heard[-1][0] if self.heard else 0.0)
        message = Odometry()
        message.pose.pose.position.x = self.x
        message.pose.pose.orientation.w = 1.0
        self.odometry.publish(message)


@pytest.mark.parametrize('fault', ['circle', 'silence', 'signal', 'rival', 'twin'])
def test_the_robot_is_stopped_when_something_is_wrong(spawn, ros, tmp_path, fault):
    robot = Runaway(ros.node, 10.0 if fault == 'circle' else 0.1)
    done = spawn([*IDENTIFY, tmp_path / 'out'])
    ros.spin_until(lambda: robot.moving)
    if fault == 'silence':
        robot.is_silent = True
    elif fault == 'signal':
        done.signal(signal.SIGINT)
    elif fault == 'rival':
        ros.node.create_publisher(Twist, 'cmd_vel', 10)
    elif fault == 'twin':
        ros.node.create_publisher(Odometry, 'odom', 10)
    ros.spin_until(lambda: done.process.poll() is not None)
    said = {
        'circle': 'from its start, wanted 1 m',
        'silence': 'found no odometry on /odom for 0.5',
        'signal': 'interrupted, and the robot was stopped',
        'rival': 'found another publisher of /cmd_vel',
        'twin': 'found 2 publishers of /odom, wanted one robot',
    }
    assert done.wait() == 2
    assert said[fault] in done.stderr
    ros.spin_until(lambda: robot.heard[-1] == (0.0, 0.0))
    assert last_command(tmp_path / 'out' / 'bag') == (0.0, 0.0)
    assert math.isfinite(robot.x)
    assert not (tmp_path / 'out' / 'robot.yaml').exists()
