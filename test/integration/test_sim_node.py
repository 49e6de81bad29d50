"""The simulator as a process over DDS, driven by a small client."""

from __future__ import annotations

import math
import signal
import sys
import time
from itertools import pairwise

import numpy as np
import pytest
from geometry_msgs.msg import Twist, TwistStamped
from nav_msgs.msg import Odometry
from rcl_interfaces.msg import Parameter, ParameterValue
from rcl_interfaces.srv import DescribeParameters, GetParameters, SetParameters
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.time import Time
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger

from cmpsp_ros.robot.differential_drive import DifferentialDrive

pytestmark = pytest.mark.integration

MS = 1_000_000
PERIOD_NS = 20 * MS
CONTROL_NS = 200 * MS
BEST_EFFORT = QoSProfile(depth=100, reliability=ReliabilityPolicy.BEST_EFFORT)
LOCKSTEP = {'lockstep': 'true', 'publish_clock': 'true'}


def stamp(message):
    return Time.from_msg(getattr(message, 'header', None) and message.header.stamp).nanoseconds


def place(message):
    position, turn = message.pose.pose.position, message.pose.pose.orientation
    return np.array([position.x, position.y, 2.0 * math.atan2(turn.z, turn.w)])


def twist(linear, angular=0.0):
    message = Twist()
    message.linear.x, message.angular.z = float(linear), float(angular)
    return message


class Client:
    """Hears everything the simulator says, and may answer its odometry."""

    def __init__(self, ros, prefix='', kind=Twist):
        self.ros, self.node, self.kind = ros, ros.node, kind
        self.odometry, self.truth, self.wheels, self.clocks, self.events = [], [], [], [], []
        self.steps_left, self.answer = 0, None
        subscribe = self.node.create_subscription
        subscribe(Odometry, f'{prefix}/odom', self.on_odometry, 100)
        subscribe(Odometry, f'{prefix}/sim/truth', self.truth.append, 1000)
        subscribe(JointState, f'{prefix}/sim/wheel_speeds', self.wheels.append, 1000)
        subscribe(Clock, '/clock', self.on_clock, BEST_EFFORT)
        self.commands = self.node.create_publisher(kind, f'{prefix}/cmd_vel', 1)
        self.resetter = self.node.create_client(Trigger, f'{prefix}/sim/reset')

    def on_clock(self, message):
        self.clocks.append(Time.from_msg(message.clock).nanoseconds)

    def on_odometry(self, message):
        is_new = not self.odometry or stamp(self.odometry[-1]) != stamp(message)
        self.odometry.append(message)
        if self.steps_left and is_new and stamp(message) % CONTROL_NS == 0:
            self.steps_left -= 1
            self.send(self.answer(len(self.events)), message.header.stamp)
            self.events.append(stamp(message))

    def send(self, message, at=None):
        if self.kind is TwistStamped:
            message = TwistStamped(twist=message)
            message.header.stamp = at
        self.commands.publish(message)

    def until(self, condition, timeout=20.0):
        return self.ros.spin_until(condition, timeout)

    def connect(self):
        """Wait until both directions are joined."""
        self.until(lambda: self.commands.get_subscription_count() and self.odometry)
        # Publishers see a subscription before that subscription sees them.
        self.until(lambda: self.truth or self.resetter.service_is_ready())

    def call(self, client, request):
        self.until(client.service_is_ready)
        answer = client.call_async(request)
        self.until(answer.done)
        return answer.result()

    def parameter_client(self, kind, name):
        return self.node.create_client(kind, f'/sim/{name}')

    def command_until(self, message, condition):
        """Repeat a command, as a controller does, until the robot shows the effect."""
        timer = self.node.create_timer(0.02, lambda: self.send(message))
        try:
            return self.until(condition)
        finally:
            self.node.destroy_timer(timer)


@pytest.fixture
def simulate(spawn):
    """Start a simulator: `simulate(key=value, remaps=[...])`."""

    def start(parameters=None, *more):
        given = [f'{key}:={value}' for key, value in (parameters or {}).items()]
        flags = [flag for each in given for flag in ('-p', each)]
        command = [sys.executable, '-m', 'cmpsp_ros.nodes.sim_node', '--ros-args', *flags, *more]
        return spawn(command)

    return start


def speed(message):
    return message.twist.twist.linear.x


def test_odometry_lies_on_an_exact_grid_and_keeps_its_rate(simulate, ros):
    before = time.time_ns()
    simulate()
    client = Client(ros)
    client.connect()
    first, begun = stamp(client.odometry[-1]), time.monotonic()
    client.until(lambda: stamp(client.odometry[-1]) >= first + 100 * PERIOD_NS)
    took = time.monotonic() - begun
    stamps = [stamp(message) for message in client.odometry]
    assert all((late - early) % PERIOD_NS == 0 and late > early for early, late in pairwise(stamps))
    assert took == pytest.approx(2.0, abs=1.0)
    assert before < stamps[0] < time.time_ns()
    assert client.odometry[-1].header.frame_id == 'odom'
    assert client.odometry[-1].child_frame_id == 'base_link'
    assert np.allclose(place(client.odometry[-1]), [0.0, -9.25, 0.0], atol=0.0)
    assert not client.clocks


def test_a_twist_that_is_no_number_is_refused_and_the_last_one_expires(simulate, ros):
    running = simulate({'cmd_vel_timeout': 1.0})
    client = Client(ros)
    client.connect()
    client.command_until(twist(0.2), lambda: speed(client.odometry[-1]) > 0.19)
    client.command_until(twist(math.nan), lambda: 'cmd_vel refused: twist (nan' in running.stderr)
    client.until(lambda: speed(client.truth[-1]) == 0.0)
    grid = stamp(client.odometry[0]) % PERIOD_NS
    # Between two instants of odometry the truth is told at changes only.
    changes = [message for message in client.truth if stamp(message) % PERIOD_NS != grid]
    *_, last_valid, stop = changes
    assert speed(last_valid) == pytest.approx(0.2)
    assert speed(stop) == 0.0
    assert stamp(stop) - stamp(last_valid) == 1000 * MS


def test_the_path_is_drawn_again_from_the_truth_alone(simulate, ros):
    simulate({'cmd_vel_timeout': 0.1})
    client = Client(ros)
    client.connect()
    client.command_until(twist(0.3, 1.0), lambda: len([t for t in client.truth if speed(t)]) > 20)
    client.command_until(twist(9.0, -3.0), lambda: speed(client.truth[-1]) > 1.0)
    client.until(lambda: speed(client.truth[-1]) == 0.0)
    truth, robot = client.truth, DifferentialDrive()
    for early, late in pairwise(truth):
        speeds = robot.wheel_speeds(
            np.array([early.twist.twist.linear.x, early.twist.twist.angular.z])
        )
        assert np.abs(speeds).max() <= 51.0 * (1.0 + 1e-12)
        duration = np.array([(stamp(late) - stamp(early)) / 1e9])
        end = robot.roll_out(place(early), speeds[None], duration)[1]
        assert np.allclose(end, place(late), atol=1e-9)
    wheels = [max(map(abs, message.velocity)) for message in client.wheels]
    assert max(wheels) == 51.0
    assert client.wheels[-1].name == ['wheel_right_joint', 'wheel_left_joint']


def test_a_reset_leads_back_to_the_initial_pose_while_time_goes_on(simulate, ros):
    simulate()
    client = Client(ros)
    client.connect()
    client.command_until(twist(1.0), lambda: place(client.odometry[-1])[0] > 0.1)
    before = stamp(client.odometry[-1])
    assert client.call(client.resetter, Trigger.Request()).success
    client.until(lambda: place(client.odometry[-1])[0] == 0.0)
    assert stamp(client.odometry[-1]) > before
    assert speed(client.odometry[-1]) == 0.0


def test_simulated_time_begins_at_zero_and_goes_before_odometry(simulate, ros):
    simulate({'publish_clock': 'true', 'real_time_factor': 4.0, 'noise.position_stddev': 0.01})
    client = Client(ros)
    client.connect()
    client.until(lambda: len(client.odometry) > 100 and len(client.clocks) > 100)
    stamps = [stamp(message) for message in client.odometry]
    assert all(each % PERIOD_NS == 0 for each in stamps)
    assert stamps[0] < 20_000 * MS
    assert set(client.clocks) & set(stamps)
    covariance = client.odometry[-1].pose.covariance
    assert covariance[0] == covariance[7] == pytest.approx(1e-4)
    assert np.std([place(message)[0] for message in client.odometry]) == pytest.approx(0.01, 0.5)


def run_lockstep(simulate, ros, steps, kind=Twist, **more):
    stamped = 'true' if kind is TwistStamped else 'false'
    running = simulate({**LOCKSTEP, 'enable_stamped_cmd_vel': stamped, **more})
    client = Client(ros, kind=kind)
    client.until(client.commands.get_subscription_count)
    client.steps_left, client.answer = steps, lambda step: twist(0.2 + 0.01 * step, 0.02)
    client.until(lambda: client.odometry)
    begun = time.monotonic()
    client.until(lambda: len(client.events) == steps)
    return running, client, time.monotonic() - begun


@pytest.mark.parametrize('kind', [Twist, TwistStamped])
def test_lockstep_waits_for_each_answer_and_is_as_fast_as_they_come(simulate, ros, kind):
    _, client, took = run_lockstep(simulate, ros, 51, kind)
    assert client.events == [step * CONTROL_NS for step in range(51)]
    assert took < 10.0
    client.until(lambda: stamp(client.truth[-1]) == 51 * CONTROL_NS)
    client.until(lambda: stamp(client.odometry[-1]) == 51 * CONTROL_NS)
    robot, pose = DifferentialDrive(), np.array([0.0, -9.25, 0.0])
    for step in range(51):
        speeds = robot.wheel_speeds(np.array([0.2 + 0.01 * step, 0.02]))
        pose = robot.roll_out(pose, speeds[None], np.array([0.2]))[1]
    assert np.allclose(place(client.odometry[-1]), pose, atol=1e-12)
    assert {stamp(message) for message in client.truth} == set(
        range(0, 51 * CONTROL_NS + 1, PERIOD_NS)
    )


def test_lockstep_repeats_exactly_also_with_noise_and_delay(simulate, ros):
    runs = []
    for _ in range(2):
        running, client, _ = run_lockstep(
            simulate,
            ros,
            11,
            **{'noise.position_stddev': 0.1, 'noise.seed': 7, 'actuation_delay': 0.05},
        )
        client.until(lambda client=client: stamp(client.odometry[-1]) == 11 * CONTROL_NS)
        runs.append({stamp(message): place(message).tolist() for message in client.odometry})
        running.signal(signal.SIGINT)
        assert running.wait() == 0
        ros.node.destroy_publisher(client.commands)
        for subscription in list(ros.node.subscriptions):
            if subscription.topic_name == '/odom':
                ros.node.destroy_subscription(subscription)
    assert runs[0] == runs[1]


def test_the_truth_and_the_time_go_on_while_odometry_is_lost(simulate, ros):
    simulate(
        {
            **LOCKSTEP,
            'noise.dropout_windows': '[0.0, 0.05, 0.3, 0.45]',
            'noise.bias': '[1.0, 0.0, 0.0]',
        }
    )
    client = Client(ros)
    client.connect()
    # It stands still at the first odometry that is not lost, and later too.
    for instant in (60, 260, 460, 660):
        client.until(lambda instant=instant: stamp(client.odometry[-1]) == instant * MS)
        client.send(twist(0.5))
    client.until(lambda: stamp(client.odometry[-1]) == 860 * MS)
    heard = {stamp(message) // MS for message in client.odometry}
    assert heard == {*range(60, 300, 20), *range(460, 861, 20)}
    client.until(lambda: stamp(client.truth[-1]) == 860 * MS)
    driven = {stamp(message) // MS: place(message)[0] for message in client.truth}
    assert {*range(60, 861, 20)} <= set(driven)
    client.until(lambda: {*range(60, 861, 20)} <= {each // MS for each in client.clocks})
    assert driven[860] == pytest.approx(0.4, abs=1e-12)
    assert place(client.odometry[-1])[0] == pytest.approx(1.4, abs=1e-12)


def test_the_truth_of_lagging_and_slipping_wheels_can_be_drawn_again(simulate, ros):
    disturbed = {'wheel_lag': 0.05, 'wheel_slip': '[0.1, 0.05]', 'actuation_delay': 0.03}
    _, client, _ = run_lockstep(simulate, ros, 6, **disturbed)
    client.until(lambda: stamp(client.truth[-1]) == 6 * CONTROL_NS)
    truth = {stamp(message): message for message in client.truth}
    robot = DifferentialDrive()
    stamps = sorted(truth)
    assert max(end - begin for begin, end in pairwise(stamps)) <= PERIOD_NS
    for begin, end in pairwise(stamps):
        moved = truth[begin].twist.twist
        speeds = robot.wheel_speeds(np.array([moved.linear.x, moved.angular.z]))[None]
        pose = robot.roll_out(place(truth[begin]), speeds, np.array([(end - begin) / 1e9]))[1]
        assert np.allclose(place(truth[end]), pose, atol=1e-12)


def test_lockstep_asks_again_complains_once_and_goes_on(simulate, ros):
    running = simulate({**LOCKSTEP, 'lockstep_timeout': 0.3})
    client = Client(ros)
    client.connect()
    client.until(lambda: len(client.odometry) > 5 and 'still waiting' in running.stderr)
    assert {stamp(message) for message in client.odometry} == {0}
    client.until(lambda: len(client.clocks) > 5)
    assert set(client.clocks) == {0}
    count = len(client.odometry)
    client.until(lambda: len(client.odometry) > count + 5)
    assert running.stderr.count('still waiting') == 1
    client.send(twist(0.1))
    client.until(lambda: stamp(client.odometry[-1]) == CONTROL_NS)
    assert 'lockstep goes on after' in running.stderr


def test_lockstep_takes_only_the_answer_whose_stamp_is_that_of_the_odometry(simulate, ros):
    simulate({**LOCKSTEP, 'enable_stamped_cmd_vel': 'true'})
    client = Client(ros, kind=TwistStamped)
    client.connect()
    client.send(twist(1.0), Time(nanoseconds=1).to_msg())
    count = len(client.odometry)
    client.until(lambda: len(client.odometry) > count + 3)
    assert stamp(client.odometry[-1]) == 0
    client.send(twist(0.5), Time(nanoseconds=0).to_msg())
    client.until(lambda: stamp(client.odometry[-1]) == CONTROL_NS)
    assert place(client.odometry[-1])[0] == pytest.approx(0.1, abs=1e-12)


def test_lockstep_goes_on_with_the_last_valid_twist_when_the_answer_is_no_number(simulate, ros):
    running = simulate(LOCKSTEP)
    client = Client(ros)
    client.connect()
    client.send(twist(0.5))
    client.until(lambda: stamp(client.odometry[-1]) == CONTROL_NS)
    for instant in (2, 3, 4):
        client.send(twist(math.nan))
        client.until(lambda instant=instant: stamp(client.odometry[-1]) == instant * CONTROL_NS)
    assert 'cmd_vel refused' in running.stderr
    # 0.5 m/s until the time-out of 0.5 s of simulated time.
    assert place(client.odometry[-1])[0] == pytest.approx(0.25, abs=1e-12)


def test_a_reset_in_lockstep_asks_again_from_the_initial_pose(simulate, ros):
    simulate(LOCKSTEP)
    client = Client(ros)
    client.connect()
    client.send(twist(0.5))
    client.until(lambda: stamp(client.odometry[-1]) == CONTROL_NS)
    assert client.call(client.resetter, Trigger.Request()).success
    client.until(lambda: place(client.odometry[-1])[0] == 0.0)
    assert stamp(client.odometry[-1]) == CONTROL_NS
    client.send(twist(0.5))
    client.until(lambda: stamp(client.odometry[-1]) == 2 * CONTROL_NS)
    assert place(client.odometry[-1])[0] == pytest.approx(0.1, abs=1e-12)


def test_two_robots_live_in_namespaces(simulate, ros):
    simulate({'initial_pose': '[0.0, -9.5, 0.0]'}, '-r', '__ns:=/r1')
    simulate({'initial_pose': '[0.0, -10.5, 0.0]'}, '-r', '__ns:=/r2')
    one, other = Client(ros, '/r1'), Client(ros, '/r2')
    one.connect()
    other.connect()
    assert place(one.odometry[-1])[1] == -9.5
    assert place(other.odometry[-1])[1] == -10.5
    one.command_until(twist(0.5), lambda: place(one.odometry[-1])[0] > 0.01)
    assert place(other.odometry[-1])[0] == 0.0


@pytest.mark.parametrize(
    ('parameters', 'said'),
    [
        ({'odom_rat': 50.0}, ['odom_rat:', 'did you mean odom_rate?']),
        ({'odom_rate': "'fast'"}, ['odom_rate:', "'fast'"]),
        ({'odom_rate': 1e-9}, ['odom_rate:', '1e-09']),
        ({'real_time_factor': 1e9}, ['real_time_factor:', '1000000000.0']),
        ({'noise.position_stddev': -1.0}, ['noise.position_stddev:', '-1.0']),
        ({'noise.dropout': 1.0}, ['noise.dropout:', '1.0']),
        ({'noise.dropout_windows': '[2.0, 1.0]'}, ['noise.dropout_windows:', 'pairs of times']),
        ({'wheel_slip': '[0.1]'}, ['wheel_slip:', 'a list of 2 numbers']),
        ({'wheel_lag': -0.1}, ['wheel_lag:', '-0.1']),
        ({'actuation_jitter': -0.1}, ['actuation_jitter:', '-0.1']),
        (
            {'lockstep': 'true', 'noise.dropout_windows': '[1.0, 2.0]'},
            ['noise.dropout_windows:', 'for lockstep'],
        ),
        ({'lockstep': 'true', 'odom_rate': 30.0}, ['control_period, odom_rate:', '30.0 Hz']),
        ({'initial_pose': '[0.0, 0.0, 0.0]'}, ['initial_pose:', 'road.center']),
        ({'obstacles.names': '[rock]'}, ['obstacles.rock.center:', 'found nothing']),
        (
            {
                'obstacles.names': '[rock]',
                'obstacles.rock.center': '[0.0, -9.0]',
                'obstacles.rock.radius': 0.5,
            },
            ['initial_pose:', 'obstacle rock'],
        ),
    ],
)
def test_what_cannot_be_simulated_ends_with_its_key_and_nothing_published(
    simulate, parameters, said
):
    running = simulate(parameters)
    assert running.wait() == 1
    assert 'Traceback' not in running.stderr
    for words in said:
        assert words in running.stderr


def test_integers_for_doubles_empty_lists_and_keys_of_the_guidance_are_taken(
    simulate, ros, tmp_path
):
    file = tmp_path / 'all.yaml'
    file.write_text(
        '/**:\n  ros__parameters:\n    odom_rate: 25\n    obstacles: {names: []}\n'
        '    weights: {road_center: 15}\n    use_sim_time: false\n'
    )
    simulate(None, '--params-file', str(file))
    client = Client(ros)
    client.connect()
    names = ['odom_rate', 'obstacles.names']
    got = client.call(
        client.parameter_client(GetParameters, 'get_parameters'),
        GetParameters.Request(names=names),
    )
    assert got.values[0].type == 3  # a double
    assert got.values[0].double_value == 25.0
    assert got.values[1].type == 9  # strings
    described = client.call(
        client.parameter_client(DescribeParameters, 'describe_parameters'),
        DescribeParameters.Request(names=names),
    )
    assert described.descriptors[0].description.startswith('Odometry messages in a second')
    assert 'a number > 0' in described.descriptors[0].additional_constraints


def test_parameters_change_live_as_one_valid_set_or_not_at_all(simulate, ros):
    simulate()
    client = Client(ros)
    client.connect()
    setter = client.parameter_client(SetParameters, 'set_parameters')

    def change(key, value):
        parameter = Parameter(name=key, value=ParameterValue(type=3, double_value=value))
        return client.call(setter, SetParameters.Request(parameters=[parameter])).results[0]

    refused = change('cmd_vel_timeout', -1.0)
    assert not refused.successful
    assert 'cmd_vel_timeout: found -1.0' in refused.reason
    fixed = change('odom_rate', 10.0)
    assert not fixed.successful
    assert 'until a restart' in fixed.reason
    assert change('noise.position_stddev', 0.01).successful
    client.until(lambda: place(client.odometry[-1])[0] != 0.0)
    assert change('noise.position_stddev', 0.0).successful
    client.until(lambda: place(client.odometry[-1])[0] == 0.0)
    assert change('cmd_vel_timeout', 0.0).successful
    client.command_until(twist(0.1), lambda: speed(client.odometry[-1]) > 0.0)
    last = stamp(client.odometry[-1])
    client.until(lambda: stamp(client.odometry[-1]) > last + 700 * MS)
    assert speed(client.odometry[-1]) > 0.0


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize('times', [1, 2])
@pytest.mark.parametrize('lockstep', ['true', 'false'])
def test_a_signal_ends_it_in_good_order(simulate, ros, number, times, lockstep):
    running = simulate({'lockstep': lockstep})
    client = Client(ros)
    client.connect()
    for _ in range(times):
        running.signal(number)
    assert running.wait() == 0
    assert 'Traceback' not in running.stderr
