"""A guidance node as a process, and a client that stands in for its robot."""

import signal
import sys
import time
from xml.etree import ElementTree as ET

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import Twist, TwistStamped
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState, GetState
from live import CASE3, PERIOD_NS, fill_pose
from nav_msgs.msg import Odometry
from nav_msgs.msg import Path as PathMessage
from rcl_interfaces.msg import Parameter, ParameterValue
from rcl_interfaces.srv import SetParameters
from rclpy.time import Time
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger

from cmpsp_ros.bags import Names
from cmpsp_ros.bags.replay.replay import replay
from cmpsp_ros.nodes import MODULES
from cmpsp_ros.robots.motion import arc_ends

START = (0.0, -9.25, 0.0)


def odometry(stamp, pose, frame_id='odom'):
    message = Odometry()
    message.header.stamp = Time(nanoseconds=stamp).to_msg()
    message.header.frame_id = frame_id
    fill_pose(message.pose.pose.position, message.pose.pose.orientation, pose)
    return message


def parameter_value(value):
    if isinstance(value, float):
        return ParameterValue(type=3, double_value=value)
    return ParameterValue(type=8, double_array_value=value)


class Client:
    """Hears everything that a guidance node says, and gives it odometry."""

    def __init__(self, ros, prefix='', kind=Twist):
        self.ros, self.node, self.prefix, self.kind = ros, ros.node, prefix, kind
        self.commands, self.messages, self.decisions = [], [], []
        self.wheels, self.paths, self.health, self.recorded = [], [], [], {}
        listen, self.base = self.node.create_subscription, f'{prefix}/guidance'
        listen(kind, f'{prefix}/cmd_vel', self.on_command, 100)
        listen(DiagnosticArray, f'{self.base}/decision', self.on_decision, 1000)
        listen(JointState, f'{self.base}/wheel_speeds', self.wheels.append, 1000)
        listen(PathMessage, f'{self.base}/predicted_path', self.paths.append, 100)
        listen(DiagnosticArray, '/diagnostics', self.on_diagnostics, 100)
        self.odometry = self.node.create_publisher(Odometry, f'{prefix}/odom', 50)
        self.sent = []
        self.timer = None

    def on_command(self, message):
        self.messages.append(message)
        twist = message.twist if self.kind is TwistStamped else message
        self.commands.append((twist.linear.x, twist.angular.z))

    def on_decision(self, message):
        (status,) = message.status
        values = {each.key: each.value for each in status.values}
        assert values['stamp'] == str(Time.from_msg(message.header.stamp).nanoseconds)
        self.decisions.append({**values, 'reason': status.message, 'level': status.level})

    def on_diagnostics(self, message):
        for status in message.status:
            if status.name == f'{self.base}: guidance':
                values = {each.key: each.value for each in status.values}
                self.health.append({**values, 'said': status.message, 'level': status.level})
            elif status.name == '/recorder: recorder':
                self.recorded = {each.key: each.value for each in status.values}

    def until(self, condition, *bound):
        return self.ros.spin_until(condition, *bound)

    def connect(self):
        """Wait until nothing of an active node can be missed, in either direction."""
        self.until(self.odometry.get_subscription_count)
        # What a publisher sends before it knows a subscription does not reach that.
        told = ('command', 'decision', 'path', 'wheel')
        self.until(lambda: all(int(self.latest(f'{each}_subscribers', '0')) for each in told))
        # Publishers see a subscription before that subscription sees them.
        count = self.node.count_publishers
        topics = ('decision', 'wheel_speeds', 'predicted_path')
        self.until(lambda: all(count(f'{self.base}/{topic}') for topic in topics))

    def latest(self, key, default=''):
        return self.health[-1].get(key, default) if self.health else default

    def until_health(self, *bound, **wanted):
        """Wait for diagnostics that hold all of these values, or words of the sentence."""

        def said():
            health = self.health[-1] if self.health else {}
            words, rest = wanted.get('said', ''), {k: v for k, v in wanted.items() if k != 'said'}
            fits = all(health.get(key) == value for key, value in rest.items())
            return health if fits and words in health.get('said', '') else None

        return self.until(said, *bound)

    def teller(self, kind, topic, qos=10):
        """A function that publishes a message, once somebody listens."""
        publisher = self.node.create_publisher(kind, topic, qos)

        def tell(message):
            self.until(publisher.get_subscription_count)
            publisher.publish(message)

        return tell

    def send(self, stamp, pose=START, frame_id='odom'):
        message = odometry(stamp, pose, frame_id)
        self.odometry.publish(message)
        self.sent.append(stamp)
        return message

    def decide(self, message, condition=lambda decision: True):
        """Publish odometry and wait for what is decided and commanded on it."""
        before, commands = len(self.decisions), len(self.commands)
        self.odometry.publish(message)
        self.until(lambda: len(self.decisions) > before and len(self.commands) > commands)
        assert condition(self.decisions[-1]), self.decisions[-1]
        return self.decisions[-1], self.commands[-1]

    def recover(self, stamp, pose=START, frame_id='odom'):
        """Publish odometry until the robot goes on after a fault; what is decided then.

        A control period of it is enough, but a late node takes only the newest of what waits.
        """
        self.send(stamp, pose, frame_id)
        end = 0.0

        def goes_on():
            nonlocal stamp, end
            if time.monotonic() > end:
                stamp, end = stamp + PERIOD_NS, time.monotonic() + 5.0
                self.send(stamp, pose, frame_id)
            return self.decisions[-1]['stamp'] == str(stamp) and self.commands[-1] != (0.0, 0.0)

        self.until(goes_on)
        return self.decisions[-1], self.commands[-1]

    def drive(self):
        """Be a robot in real time from now on: obey the commands, publish odometry at 50 Hz."""
        clock = self.node.get_clock()
        self.pose, self.driven_to = np.array(START), clock.now().nanoseconds

        def tick():
            now = clock.now().nanoseconds
            twist = np.array([self.commands[-1] if self.commands else (0.0, 0.0)])
            duration = np.array([(now - self.driven_to) / 1e9])
            self.pose, self.driven_to = arc_ends(self.pose[None], twist, duration)[0], now
            self.send(now, self.pose)

        self.timer = self.node.create_timer(0.02, tick)

    def park(self):
        """Publish no more odometry."""
        self.node.destroy_timer(self.timer)

    def until_driving(self):
        count = len(self.commands)
        self.until(lambda: any(speed > 0.5 for speed, _ in self.commands[count:]))

    def call(self, kind, name, request):
        return self.ros.call(kind, f'{self.base}/{name}', request)

    def change_state(self, name_or_id):
        number = name_or_id
        if isinstance(name_or_id, str):
            number = getattr(Transition, f'TRANSITION_{name_or_id.upper()}')
        request = ChangeState.Request(transition=Transition(id=number))
        return self.call(ChangeState, 'change_state', request).success

    @property
    def state(self):
        return self.call(GetState, 'get_state', GetState.Request()).current_state.label

    def set_parameter(self, key, value):
        parameter = Parameter(name=key, value=parameter_value(value))
        request = SetParameters.Request(parameters=[parameter])
        return self.call(SetParameters, 'set_parameters', request).results[0]

    def reset(self):
        return self.call(Trigger, 'reset', Trigger.Request())

    def now(self):
        return self.node.get_clock().now().nanoseconds


@pytest.fixture
def client(ros):
    """A client of the node `/guidance`."""
    return Client(ros)


@pytest.fixture
def make_client(ros):
    """Make another client: `make_client(prefix='', kind=Twist)`."""
    return lambda **how: Client(ros, **how)


@pytest.fixture
def make_odometry():
    """Make a message: `make_odometry(stamp, pose, frame_id='odom')`."""
    return odometry


@pytest.fixture
def verdicts():
    """JUnit verdicts of an audit: `verdicts(path)`, each outcome by its check's short name."""

    def read(path):
        suite = ET.parse(path).getroot()
        said = {}
        for case in suite.iter('testcase'):
            outcome = next((each.tag for each in case), 'passed')
            said[case.get('classname').removeprefix('audit.')] = outcome
        assert suite.get('tests') == str(len(said))
        return said

    return read


@pytest.fixture
def start_node(spawn):
    """Start a node with case 3, and let it set off unless told otherwise.

    `start_node('guidance_node', {key: value}, *ros_arguments)`.
    """

    def start(name='guidance_node', parameters=None, *more):
        always = {'autostart': True}
        if name == 'guidance_node':
            # Odometry of these tests does not follow the commands.
            always['safety.max_prediction_error'] = 0.0
        given = {**always, **(parameters or {})}
        flags = [
            part
            for key, each in given.items()
            for part in ('-p', f'{key}:={str(each).lower() if isinstance(each, bool) else each}')
        ]
        module = MODULES[name]
        command = [sys.executable, '-m', module, '--ros-args', '--params-file', CASE3]
        return spawn([*command, *flags, *more])

    return start


@pytest.fixture
def start_active(start_node, client):
    """Start a guidance node and wait until it is active and heard: `start_active(parameters)`."""

    def start(parameters=None):
        running = start_node('guidance_node', parameters)
        client.connect()
        client.until_health(state='active')
        return running

    return start


@pytest.fixture
def start_driving(start_node, client):
    """Start a guidance node and drive until it is on its way: `start_driving(parameters)`."""

    def start(parameters=None):
        running = start_node('guidance_node', parameters)
        client.connect()
        client.drive()
        client.until_driving()
        return running

    return start


class Recording:
    """A recorder at work, and the bag that it writes."""

    def __init__(self, client, process, bag):
        self.client, self.process, self.bag = client, process, bag

    def until_all_is_heard(self, *topics):
        """Wait until no message of a node that is connected can be missed."""
        listeners = self.client.node.get_subscriptions_info_by_topic
        for topic in ('/odom', '/cmd_vel', '/parameter_events', '/guidance/decision', *topics):
            self.client.until(
                lambda topic=topic: any(each.node_name == 'recorder' for each in listeners(topic))
            )
        # What changes before the recorder knows the parameters, it cannot know.
        self.client.until(lambda: '/guidance/parameters messages' in self.client.recorded)

    def replayed(self):
        """End the recorder, and replay its bag without a difference."""
        self.process.signal(signal.SIGINT)
        assert self.process.wait() == 0, self.process.stderr
        outcome = replay(self.bag, Names.under(''))
        assert outcome.first is None, outcome.first
        return outcome


@pytest.fixture
def record(client, spawn, tmp_path):
    """Start a recorder: `record(*its parameters)`."""

    def start(*parameters):
        bag = tmp_path / 'bag'
        flags = [part for each in (f'output:={bag}', *parameters) for part in ('-p', each)]
        command = [sys.executable, '-m', MODULES['recorder'], '--ros-args', *flags]
        return Recording(client, spawn(command), bag)

    return start
