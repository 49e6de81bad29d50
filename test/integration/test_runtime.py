"""Real processes, real signals: how a node ends."""

import signal
import sys
import time
from pathlib import Path

import pytest
from geometry_msgs.msg import Twist
from lifecycle_msgs.msg import State, Transition
from lifecycle_msgs.srv import ChangeState, GetState
from rclpy.lifecycle import LifecycleNode
from rclpy.node import Node

from cmpsp_ros.nodes.common import StartupError, run
from cmpsp_ros.nodes.common.topic import Listener as Input
from cmpsp_ros.nodes.guidance.lifecycle import guard_change_state

SIGNALS = [signal.SIGINT, signal.SIGTERM]


class Driver(Node):
    """Publishes a twist, and a zero twist at the end."""

    def __init__(self):
        super().__init__('driver')
        self.publisher = self.create_publisher(Twist, 'cmd_vel', 1)
        self.create_timer(0.02, lambda: self.publish(1.0))

    def publish(self, speed):
        twist = Twist()
        twist.linear.x = speed
        self.publisher.publish(twist)

    def stop(self):
        self.publish(0.0)
        print('stopped', flush=True)


class Idle(Node):
    def __init__(self):
        super().__init__('idle')
        print('ready', flush=True)


class Listener(Node):
    def __init__(self):
        super().__init__('listener')
        self.create_subscription(Twist, 'cmd_vel', lambda _: print('heard', flush=True), 10)


class Attentive(Node):
    """Hears all commands that wait before their turn, whenever its timer falls due."""

    def __init__(self):
        super().__init__('attentive')
        self.listener = Input(self)
        commands = self.create_subscription(Twist, 'cmd_vel', self.on_command, 1000)
        self.listener._subscriptions.append(commands)
        self.create_timer(0.05, self.on_timer)

    def on_timer(self):
        self.listener.drain()
        print('timer', flush=True)

    def on_command(self, message):
        print(f'heard {message.linear.x:g}', flush=True)
        if message.linear.x == 0.0:
            time.sleep(0.1)
        if message.linear.x < 0.0:
            raise ZeroDivisionError('no way')


class Slow(Node):
    """Takes its time to be made."""

    def __init__(self):
        super().__init__('slow')
        print('begun', flush=True)
        end = time.monotonic() + 0.5
        while time.monotonic() < end:
            pass

    def stop(self):
        print('stopped', flush=True)


class Misconfigured(Node):
    def __init__(self):
        super().__init__('misconfigured')
        raise StartupError('parameter gain:\n expected a positive number, got -1')


class Broken(Node):
    def __init__(self):
        super().__init__('broken')
        raise KeyError('gone')


class Failing(Driver):
    """Raises out of a callback."""

    def publish(self, speed):
        super().publish(speed)
        if speed:
            raise ZeroDivisionError('no way')


class FailingToStop(Idle):
    def stop(self):
        raise OSError('disk full')


class Managed(LifecycleNode):
    def __init__(self):
        super().__init__('managed')
        guard_change_state(self)


@pytest.fixture
def start(spawn):
    """Start one of this file's nodes as a process."""
    return lambda node, *args: spawn([sys.executable, Path(__file__), node.__name__, *args])


def fatal_lines(process):
    """Return the messages of level FATAL; there must be no traceback beside them."""
    assert 'Traceback' not in process.stderr
    said = [line.split(']: ', 1)[1] for line in process.stderr.splitlines() if '[FATAL]' in line]
    # The executor names the kind of callback out of which an exception came.
    return [each for each in said if not each.startswith('Exception in ')]


@pytest.mark.smoke
@pytest.mark.parametrize('times', [1, 2])
@pytest.mark.parametrize('number', SIGNALS)
def test_signal_is_answered_by_stop(start, ros, number, times):
    heard = []
    ros.node.create_subscription(Twist, 'cmd_vel', lambda each: heard.append(each.linear.x), 10)
    process = start(Driver)
    ros.spin_until(lambda: heard)
    for _ in range(times):
        process.signal(number)
    assert process.wait() == 0
    assert process.stdout == 'stopped\n'
    assert fatal_lines(process) == []
    ros.spin_until(lambda: heard[-1] == 0.0)


@pytest.mark.parametrize('number', SIGNALS)
def test_signal_during_construction(start, wait_until, number):
    process = start(Slow)
    wait_until(lambda: process.stdout)
    process.signal(number)
    process.signal(number)
    assert process.wait() == 0
    assert process.stdout == 'begun\nstopped\n'
    assert fatal_lines(process) == []


def test_frozen_subscriber_delays_the_exit_a_little_only(start, wait_until):
    listener, process = start(Listener), start(Driver)
    wait_until(lambda: listener.stdout)
    listener.signal(signal.SIGSTOP)
    process.signal(signal.SIGINT)
    try:
        assert process.wait() == 0
    finally:
        listener.signal(signal.SIGCONT)
    assert '/cmd_vel: a subscriber has not confirmed the last message' in process.stderr


@pytest.mark.parametrize(
    ('node', 'arguments', 'said'),
    [
        (Misconfigured, [], 'parameter gain: expected a positive number, got -1'),
        (Broken, [], "KeyError: 'gone'"),
        (Idle, ['--ros-args', '-p', 'no value'], 'no value'),
    ],
)
def test_a_start_that_fails_is_told_in_one_line(start, node, arguments, said):
    process = start(node, *arguments)
    assert process.wait() == 1
    (line,) = fatal_lines(process)
    assert said in line


def test_exception_in_callback(start):
    process = start(Failing)
    assert process.wait() == 1
    assert fatal_lines(process) == ['ZeroDivisionError: no way']
    assert process.stdout == 'stopped\n'


def test_traceback_at_debug_level(start):
    process = start(Failing, '--ros-args', '--log-level', 'failing:=debug', '--log-level', 'debug')
    assert process.wait() == 1
    assert 'Traceback' in process.stderr


def test_exception_in_stop(start, wait_until):
    process = start(FailingToStop)
    wait_until(lambda: process.stdout)
    process.signal(signal.SIGINT)
    assert process.wait() == 1
    assert fatal_lines(process) == ['OSError: disk full']


@pytest.mark.parametrize('node', [Idle, Attentive])
def test_idle_process_leaves_the_core_alone(start, wait_until, node):
    process = start(node)
    wait_until(lambda: process.stdout)
    stat = Path(f'/proc/{process.pid}/stat')

    def ticks():
        return sum(int(each) for each in stat.read_text().rsplit(')', 1)[1].split()[11:13])

    before, end = ticks(), time.monotonic() + 1.0
    wait_until(lambda: time.monotonic() > end)
    assert ticks() - before < 20, 'hundredths of a second in one second'


def test_caught_up_with_nothing_is_heard_twice_nor_lost(start, ros):
    process = start(Attentive)
    publisher = ros.node.create_publisher(Twist, 'cmd_vel', 1000)
    ros.spin_until(publisher.get_subscription_count)
    ros.spin_until(lambda: process.stdout.count('timer') > 2)
    twist = Twist()
    for k in range(300):
        twist.linear.x = float(k)
        publisher.publish(twist)
    ros.spin_until(lambda: 'heard 299' in process.stdout)
    said = process.stdout.splitlines()
    assert [each for each in said if each != 'timer'] == [f'heard {k}' for k in range(300)]
    count = len(said)
    ros.spin_until(lambda: process.stdout.splitlines()[count:].count('timer') > 2)
    twist.linear.x = -1.0
    publisher.publish(twist)
    assert process.wait() == 1
    assert fatal_lines(process) == ['ZeroDivisionError: no way']


def test_impossible_transition_does_not_kill(start, ros):
    process = start(Managed)

    def changed(number):
        request = ChangeState.Request(transition=Transition(id=number))
        return ros.call(ChangeState, '/managed/change_state', request).success

    assert not changed(99)
    assert not changed(Transition.TRANSITION_ACTIVATE)
    assert changed(Transition.TRANSITION_CONFIGURE)
    assert changed(Transition.TRANSITION_ACTIVATE)
    state = ros.call(GetState, '/managed/get_state').current_state
    assert state.id == State.PRIMARY_STATE_ACTIVE
    process.signal(signal.SIGINT)
    assert process.wait() == 0
    assert process.stderr.count('refused') == 2


if __name__ == '__main__':
    sys.exit(run(globals()[sys.argv[1]], name=sys.argv[1].lower()))
