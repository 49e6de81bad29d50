"""`cmpsp play` by its command line: what was recorded, with its time, to live subscribers."""

import fcntl
import os
import pty
import signal
import subprocess
import sys
import termios
from dataclasses import dataclass, field

import pytest
from geometry_msgs.msg import Twist
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.serialization import serialize_message
from rosgraph_msgs.msg import Clock
from std_msgs.msg import String
from std_srvs.srv import Trigger

from cmpsp_ros.bags import BagWriter
from cmpsp_ros.nodes.recording.qos import for_bag

UNKNOWN = '_NODE_NAME_UNKNOWN_'
PLAY = [sys.executable, '-m', 'cmpsp_ros.cli', 'play']
BEGIN, STEP, COUNT = 1_700_000_000_000_000_000, 10_000_000, 100
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
BEST_EFFORT = QoSProfile(depth=7, reliability=ReliabilityPolicy.BEST_EFFORT)


def twist(number):
    message = Twist()
    message.linear.x = float(number)
    return serialize_message(message)


@pytest.fixture
def bag(tmp_path):
    """A second of numbered commands, and a latched sentence before them."""
    path = tmp_path / 'bag'
    with BagWriter(path) as writer:
        writer.topic('/said', 'std_msgs/msg/String', [for_bag(LATCHED)])
        writer.topic('/cmd_vel', 'geometry_msgs/msg/Twist', [for_bag(QoSProfile(depth=COUNT))])
        writer.topic('/quiet', 'geometry_msgs/msg/Twist', [for_bag(BEST_EFFORT)])
        writer.topic('/rosout', 'rcl_interfaces/msg/Log')
        writer.write('/said', BEGIN, serialize_message(String(data='once')))
        for number in range(COUNT):
            writer.write('/cmd_vel', BEGIN + number * STEP, twist(number))
    return path


@dataclass
class Heard:
    """Messages that a listener gets from the player."""

    numbers: list = field(default_factory=list)
    clock: list = field(default_factory=list)
    said: list = field(default_factory=list)
    raw: list = field(default_factory=list)


@pytest.fixture
def listen(ros):
    """Listen from now on: `listen(topic='/cmd_vel')`."""

    def start(topic='/cmd_vel'):
        heard, subscribe = Heard(), ros.node.create_subscription
        many = QoSProfile(depth=10 * COUNT)
        subscribe(Twist, topic, lambda each: heard.numbers.append(int(each.linear.x)), many)
        subscribe(Twist, topic, heard.raw.append, many, raw=True)
        subscribe(String, '/said', lambda each: heard.said.append(each.data), LATCHED)
        many_ticks = QoSProfile(depth=10_000)
        subscribe(Clock, '/clock', lambda each: heard.clock.append(nanoseconds(each)), many_ticks)
        return heard

    return start


def nanoseconds(message):
    return message.clock.sec * 10**9 + message.clock.nanosec


@pytest.fixture
def call(ros):
    """Call a service of the player: `call('resume')`."""

    def ask(name):
        answer = ros.call(Trigger, f'/player/{name}')
        assert answer.success
        return answer.message

    return ask


@pytest.fixture
def play(spawn, ros, bag):
    """Start the player, paused, and wait until it cannot but be heard: `play(*options)`."""

    def start(*options, topic='/cmd_vel'):
        player = spawn([*PLAY, bag, '--paused', *options])
        ros.spin_until(lambda: ros.node.count_publishers(topic))
        return player

    return start


def test_everything_arrives_as_it_was_and_in_its_time(play, listen, call, ros):
    heard = listen('/elsewhere')
    player = play('--remap', '/cmd_vel:=/elsewhere', '--rate', '2', topic='/elsewhere')
    offers = ros.node.get_publishers_info_by_topic

    def loggers():
        return [each.node_name for each in offers('/rosout')]

    # A publisher is known before the name of its node.
    ros.spin_until(lambda: 'player' in loggers() and UNKNOWN not in loggers())
    # Its own log, and not the recorded one.
    assert loggers().count('player') == 1
    ros.spin_until(lambda: offers('/quiet') and offers('/said'))
    assert offers('/quiet')[0].qos_profile.reliability == ReliabilityPolicy.BEST_EFFORT
    assert offers('/said')[0].qos_profile.durability == DurabilityPolicy.TRANSIENT_LOCAL
    assert not offers('/cmd_vel')
    assert call('resume') == 'playing'
    ros.spin_until(lambda: player.process.poll() is not None)
    assert player.wait() == 0
    assert f'{COUNT + 1} messages of 3 topics played' in player.stderr
    ros.spin_until(lambda: len(heard.numbers) == len(heard.raw) == COUNT)
    assert heard.numbers == list(range(COUNT))
    assert heard.raw == [twist(number) for number in range(COUNT)]
    assert heard.said == ['once']
    assert heard.clock == sorted(heard.clock)
    assert (heard.clock[0], heard.clock[-1]) == (BEGIN, BEGIN + (COUNT - 1) * STEP)


def test_a_part_of_it(play, listen, call, ros):
    heard = listen()
    player = play('--start-offset', '0.3', '--duration', '0.2', '--topics', '/cmd_vel')
    call('resume')
    ros.spin_until(lambda: player.process.poll() is not None)
    ros.spin_until(lambda: heard.numbers and heard.numbers[-1] == 50)
    assert heard.numbers == list(range(30, 51))
    assert heard.said == []


def test_a_pause_holds_the_time_and_loses_nothing(play, listen, call, ros):
    heard = listen()
    player = play()
    call('toggle_paused')
    ros.spin_until(lambda: len(heard.numbers) > 10)
    assert call('pause') == 'paused'
    # Whatever was on its way is here when an answer to a later question is.
    assert call('pause') == 'paused'
    ticks, numbers = len(heard.clock), len(heard.numbers)
    assert numbers < COUNT
    assert call('pause') == 'paused'
    assert (len(heard.clock), len(heard.numbers)) == (ticks, numbers)
    assert call('toggle_paused') == 'playing'
    ros.spin_until(lambda: player.process.poll() is not None)
    ros.spin_until(lambda: len(heard.numbers) == COUNT)
    assert heard.numbers == list(range(COUNT))


def test_a_loop_begins_again_and_a_signal_ends_it(play, listen, call, ros):
    heard = listen()
    player = play('--loop', '--rate', '5')
    call('resume')
    ros.spin_until(lambda: heard.numbers.count(3) == 3)
    assert heard.numbers[: 2 * COUNT] == [*range(COUNT), *range(COUNT)]
    assert any(later < earlier for earlier, later in zip(heard.clock, heard.clock[1:]))  # noqa: B905
    player.signal(signal.SIGINT)
    assert player.wait() == 0
    assert 'Traceback' not in player.stderr


def test_a_recorded_clock_is_played_and_no_other(spawn, tmp_path, listen, call, ros):
    ticks = [5_000_000_000, 5_500_000_000, 5_400_000_000]
    with BagWriter(tmp_path / 'clock') as writer:
        writer.topic('/clock', 'rosgraph_msgs/msg/Clock')
        writer.topic('/cmd_vel', 'geometry_msgs/msg/Twist')
        for number, tick in enumerate(ticks):
            message = Clock()
            message.clock.sec, message.clock.nanosec = divmod(tick, 10**9)
            writer.write('/clock', BEGIN + number * 10 * STEP, serialize_message(message))
    heard = listen()
    player = spawn([*PLAY, tmp_path / 'clock', '--paused'])
    ros.spin_until(lambda: ros.node.count_publishers('/clock'))
    call('resume')
    ros.spin_until(lambda: player.process.poll() is not None)
    ros.spin_until(lambda: len(heard.clock) == 3)
    assert heard.clock == ticks


def test_the_space_key_pauses_and_resumes(bag, ros_domain, listen, ros):
    heard = listen()
    keys, terminal = pty.openpty()

    def own_terminal():
        fcntl.ioctl(0, termios.TIOCSCTTY, 0)

    with subprocess.Popen(
        [str(each) for each in (*PLAY, bag, '--paused')],
        stdin=terminal,
        stderr=subprocess.DEVNULL,
        start_new_session=True,
        preexec_fn=own_terminal,  # noqa: PLW1509
    ) as player:
        try:
            before = termios.tcgetattr(terminal)
            ros.spin_until(lambda: ros.node.count_publishers('/cmd_vel'))
            ros.spin_until(lambda: termios.tcgetattr(terminal) != before)
            assert heard.numbers == []
            os.write(keys, b'x ')
            ros.spin_until(lambda: player.poll() is not None)
            assert player.returncode == 0
            assert termios.tcgetattr(terminal) == before
        finally:
            player.kill()
    os.close(keys)
    os.close(terminal)
    ros.spin_until(lambda: heard.numbers and heard.numbers[-1] == COUNT - 1)


@pytest.mark.parametrize(
    ('options', 'reason'),
    [
        (['--topics', '/nowhere'], 'no topic /nowhere; there is /cmd_vel, /quiet, /rosout, /said'),
        (['--topics', '/quiet'], 'no message to play in /quiet'),
        (['--rate', '0'], '--rate'),
    ],
)
def test_what_cannot_be_played_is_exit_code_2(spawn, bag, options, reason):
    player = spawn([*PLAY, bag, *options])
    assert player.wait() == 2
    assert reason in player.stderr
    assert 'Traceback' not in player.stderr
