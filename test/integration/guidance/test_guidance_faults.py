"""Faults of all kinds stop the robot, each with its reason."""

import math
import secrets
import signal

import pytest
import rclpy
from diagnostic_msgs.msg import DiagnosticStatus
from live import PERIOD_NS, ZERO
from rclpy.executors import SingleThreadedExecutor
from rclpy.parameter import Parameter
from rclpy.serialization import serialize_message
from rclpy.time import Time
from rosgraph_msgs.msg import Clock

from cmpsp_ros.guidance import GuidanceLaw
from cmpsp_ros.mpsp.jit import allocation_free
from cmpsp_ros.nodes.guidance.node import GuidanceNode
from cmpsp_ros.parameters import config_directory, guidance_settings


def spoil_position(message):
    message.pose.pose.position.x = math.nan


def spoil_orientation(message):
    message.pose.pose.orientation.z = math.inf


def leave_frame(message):
    message.header.frame_id = 'map'


def grow_old(message):
    message.header.stamp.sec -= 100


def lose_orientation(message):
    message.pose.pose.orientation.z = message.pose.pose.orientation.w = 0.0


def go_far(message):
    message.pose.pose.position.x = 1e300


FAULTS = [
    (spoil_position, 'not finite'),
    (go_far, 'wanted one on Earth'),
    (spoil_orientation, 'orientation of length inf'),
    (leave_frame, "frame 'map', wanted 'odom'"),
    (lose_orientation, 'orientation of length 0'),
]


@pytest.mark.smoke
def test_odometry_that_cannot_be_used_stops_the_robot_until_the_next_that_can(
    fault, start_active, client, make_odometry
):
    running = start_active({'odom_timeout': 60.0, 'final_time': 20.0})
    stamp, pose = client.now(), (0.0, -9.25, 0.0)
    # The first odometry of all may be a bad one; later what is old is out of order.
    for spoil, reason in [(grow_old, 's old (odom_timeout 60.0 s)'), FAULTS[0], *FAULTS]:
        bad = make_odometry(stamp, pose)
        spoil(bad)
        decision, command = client.decide(bad)
        assert command == ZERO
        assert reason in decision['reason']
        fault.assert_decided(decision)
        assert float(decision['wheel_speed_right']) == float(decision['wheel_speed_left']) == 0.0
        client.until_health(level=DiagnosticStatus.ERROR, said=reason, fallback_level='stop')
        # Even between two control instants.
        stamp += PERIOD_NS // 4
        decision, _ = client.recover(stamp, pose)
        assert decision['fallback_level'] == 'nominal'
        stamp = int(decision['stamp'])
        client.until_health(level=DiagnosticStatus.OK, fallback_level='nominal')
        stamp += PERIOD_NS
    assert 'Traceback' not in running.stderr


def test_bytes_that_are_no_odometry_stop_the_robot_until_odometry_comes(
    fault, start_active, client, make_odometry
):
    running = start_active({'odom_timeout': 60.0})
    stamp, pose = client.now(), (0.0, -9.25, 0.0)
    client.decide(make_odometry(stamp, pose))
    good = make_odometry(stamp + PERIOD_NS, pose)
    client.odometry.publish(serialize_message(good)[:60])
    reason = 'Odometry cannot be read: found 60 bytes that are no nav_msgs/Odometry in CDR.'
    client.until(lambda: client.decisions[-1]['reason'] == reason)
    assert client.commands[-1] == ZERO
    fault.assert_decided(client.decisions[-1])
    client.recover(stamp + PERIOD_NS, pose)
    assert 'Traceback' not in running.stderr


def test_bad_odometry_that_goes_on_is_answered_once_a_control_period(
    start_active, client, make_odometry
):
    start_active({'odom_timeout': 60.0})
    client.decide(make_odometry(client.now(), (0.0, -9.25, 0.0)))
    bad = make_odometry(client.now(), (math.nan, -9.25, 0.0))
    begun = client.now()
    timer = client.node.create_timer(0.01, lambda: client.odometry.publish(bad))
    client.until(lambda: len(client.commands) > 5)
    took = client.now() - begun
    client.node.destroy_timer(timer)
    assert set(client.commands[1:]) == {ZERO}
    assert (len(client.commands) - 2) * PERIOD_NS <= took


def test_odometry_that_stops_stops_the_robot_until_it_comes_back(fault, start_driving, client):
    running = start_driving()
    client.until_health(level=DiagnosticStatus.OK)
    client.park()
    client.until(lambda: client.commands[-1] == ZERO)
    reason = 'No usable odometry for more than 0.5 s (odom_timeout).'
    client.until(lambda: client.decisions[-1]['reason'] == reason)
    client.until_health(level=DiagnosticStatus.ERROR, said=reason)
    fault.assert_decided(client.decisions[-1])
    count = len(client.commands)
    client.until(lambda: len(client.commands) > count + 2)
    assert set(client.commands[count:]) == {ZERO}
    client.drive()
    client.until_driving()
    client.until_health(level=DiagnosticStatus.OK, fallback_level='nominal')
    assert 'Traceback' not in running.stderr


def test_a_run_that_begins_again_stops_the_robot_first(fault, start_driving, client):
    """Odometry may have died: then nothing else would stop it."""
    start_driving()
    client.park()
    assert client.commands[-1][0] > 0.5
    assert client.reset().success
    reason = 'The run began again.'
    client.until(lambda: any(each['reason'] == reason for each in client.decisions))
    stop = next(each for each in client.decisions if each['reason'] == reason)
    fault.assert_decided(stop)
    assert (stop['run'], stop['halted']) == ('1', 'true')
    client.until(lambda: client.commands[-1] == ZERO)


def test_one_stamp_from_the_far_future_does_not_end_the_run(
    fault, start_active, client, make_odometry
):
    start_active({'odom_timeout': 60.0})
    stamp, pose = client.now(), (0.0, -9.25, 0.0)
    client.decide(make_odometry(stamp, pose))
    decision, command = client.decide(make_odometry(stamp + 1_000_000 * PERIOD_NS, pose))
    assert command == ZERO
    assert decision['finished'] == 'false'
    fault.assert_decided(decision)
    client.recover(stamp + PERIOD_NS, pose)


def test_simulated_time_that_begins_again_is_noticed(fault, start_active, client, make_odometry):
    start_active({'use_sim_time': True})
    clock = client.node.create_publisher(Clock, '/clock', 1)
    client.until(clock.get_subscription_count)

    def tick(stamp):
        clock.publish(Clock(clock=Time(nanoseconds=stamp).to_msg()))

    for stamp in (8 * 10**9, 8 * 10**9 + PERIOD_NS):
        tick(stamp)
        client.decide(make_odometry(stamp, (0.0, -9.25, 0.0)))
    count, sent = len(client.commands), []

    def start_again():
        sent.append(len(sent) * 20_000_000)
        tick(sent[-1])
        client.send(sent[-1])

    timer = client.node.create_timer(0.02, start_again)
    # At the beginning of the new time, not when it reaches the old one.
    client.until(lambda: len(client.commands) > count or len(sent) > 150)
    assert len(client.commands) > count
    client.node.destroy_timer(timer)
    client.until(lambda: len(client.decisions) > count)
    assert client.decisions[count]['step'] == '0'
    fault.assert_decided(client.decisions[count])


@pytest.mark.parametrize(
    ('number', 'times'),
    [
        (signal.SIGINT, 1),
        (signal.SIGINT, 2),
        pytest.param(signal.SIGTERM, 1, marks=pytest.mark.smoke),
        (signal.SIGTERM, 2),
    ],
)
def test_a_signal_while_it_drives_leaves_a_robot_that_stands(start_driving, client, number, times):
    running = start_driving()
    for _ in range(times):
        running.signal(number)
    client.until(lambda: running.process.poll() is not None)
    assert running.wait() == 0
    client.until(lambda: client.commands[-1] == ZERO)
    assert 'Traceback' not in running.stderr
    assert 'FATAL' not in running.stderr


@pytest.fixture
def node(ros_domain):
    """The guidance node in this process, spun by hand."""
    course = ['--params-file', str(config_directory() / 'case3.yaml'), '-p', 'autostart:=true']
    rclpy.init(args=['--ros-args', *course, '-p', 'odom_timeout:=60.0'], domain_id=ros_domain)
    made = GuidanceNode()
    executor = SingleThreadedExecutor()
    executor.add_node(made)
    yield executor
    made.stop()
    executor.shutdown()
    made.destroy_node()
    rclpy.try_shutdown()


@pytest.fixture
def both(node, client):
    """Let the node and its client work; the node is active."""

    def both():
        node.spin_once(timeout_sec=0.01)
        client.ros.executor.spin_once(timeout_sec=0.01)

    return both


def test_a_live_change_is_computed_once(node, monkeypatch):
    """The robot drives on without a new command for as long as that takes."""
    (guidance,) = node.get_nodes()
    computed = []

    def count(values):
        computed.append(values['weights.road_center'])
        return guidance_settings(values)

    monkeypatch.setattr('cmpsp_ros.nodes.guidance.node.guidance_settings', count)
    for value in (0.5, 0.25):
        (result,) = guidance.set_parameters([Parameter('weights.road_center', value=value)])
        assert result.successful
    assert computed == [0.5, 0.25]
    (result,) = guidance.set_parameters([Parameter('weights.road_center', value=-1.0)])
    assert not result.successful


def test_a_kernel_compiled_while_active_is_an_error(fault, both, client, wait_until):
    wait_until(lambda: client.latest('state') == 'active', step=both)
    # No cache has it.
    number = secrets.randbits(60)
    allocation_free(lambda x: x + number)(1)
    wait_until(lambda: 'compiler' in client.latest('said'), step=both)
    fault.assert_told(client.health[-1])


def test_an_exception_in_the_law_stops_the_robot(
    fault, both, client, make_odometry, wait_until, monkeypatch
):
    def decide(stamp):
        count = len(client.decisions)
        client.odometry.publish(make_odometry(stamp, (0.0, -9.25, 0.0)))
        wait_until(lambda: len(client.decisions) > count, step=both)
        wait_until(lambda: len(client.commands) > count, step=both)
        return client.decisions[-1], client.commands[-1]

    wait_until(
        lambda: client.odometry.get_subscription_count() and client.latest('state') == 'active',
        step=both,
    )
    wait_until(lambda: int(client.latest('command_subscribers')) > 0, step=both)
    begin = client.now()
    _, command = decide(begin)
    assert command[0] > 0.5
    with monkeypatch.context() as patch:
        patch.setattr(GuidanceLaw, 'step', lambda *_: 1 / 0)
        decision, command = decide(begin + 200_000_000)
    assert command == (0.0, 0.0)
    fault.assert_decided(decision)
    assert decision['reason'] == 'The guidance law failed: ZeroDivisionError: division by zero'
    decision, command = decide(begin + 400_000_000)
    assert decision['fallback_level'] == 'nominal'
    assert command[0] > 0.5
    with monkeypatch.context() as patch:
        patch.setattr(GuidanceLaw, 'after_step', lambda *_: 1 / 0)
        decide(begin + 600_000_000)
        wait_until(lambda: client.decisions[-1]['fallback_level'] == 'stop', step=both)
    wanted = 'The search of the grid failed: ZeroDivisionError: division by zero'
    assert client.decisions[-1]['reason'] == wanted
    wait_until(lambda: client.commands[-1] == (0.0, 0.0), step=both)
