"""A client of the simulator, and what its messages say."""

import math

import numpy as np
from geometry_msgs.msg import Twist, TwistStamped
from nav_msgs.msg import Odometry
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.time import Time
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger

MS = 1_000_000
PERIOD_NS = 20 * MS
CONTROL_NS = 200 * MS
BEST_EFFORT = QoSProfile(depth=100, reliability=ReliabilityPolicy.BEST_EFFORT)


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
        self.prefix = prefix

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

    def until(self, condition):
        return self.ros.spin_until(condition)

    def connect(self):
        """Wait until both directions are joined."""
        self.until(lambda: self.commands.get_subscription_count() and self.odometry)
        # Publishers see a subscription before that subscription sees them.
        resetter = self.ros.client(Trigger, f'{self.prefix}/sim/reset')
        self.until(lambda: self.truth or resetter.service_is_ready())

    def reset(self):
        return self.ros.call(Trigger, f'{self.prefix}/sim/reset').success

    def command_until(self, message, condition):
        """Repeat a command, as a controller does, until the robot shows the effect."""
        timer = self.node.create_timer(0.02, lambda: self.send(message))
        try:
            return self.until(condition)
        finally:
            self.node.destroy_timer(timer)


def speed(message):
    return message.twist.twist.linear.x
