"""A robot of somebody else: it shares no code with this package, and knows ROS topics alone.

It hears TwistStamped commands, publishes odometry of `base_footprint` at 30 Hz, best effort; its
wheels lag by 0.1 s and speed up by 1 m/s^2 at most, or by what the last argument says. Usage:
foreign_robot.py X Y HEADING PATH_FILE [ACCELERATION]
"""

import math
import signal
import sys
import threading
from pathlib import Path

import rclpy
from geometry_msgs.msg import TwistStamped
from nav_msgs.msg import Odometry
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.signals import SignalHandlerOptions

HALF_TRACK, LAG = 0.055, 0.1
STEP, MESSAGE_PERIOD, TIMEOUT = 0.005, 1.0 / 30.0, 0.5
BEST_EFFORT = QoSProfile(depth=5, reliability=ReliabilityPolicy.BEST_EFFORT)


class ForeignRobot(Node):
    """Drives in small steps of real time."""

    def __init__(self, x, y, heading, acceleration=1.0):
        super().__init__('base')
        self.acceleration = acceleration
        self.x, self.y, self.heading = x, y, heading
        self.wanted, self.wheels, self.path = (0.0, 0.0), [0.0, 0.0], []
        self.heard = self.driven_to = self.seconds()
        self.create_subscription(TwistStamped, 'cmd_vel', self.obey, BEST_EFFORT)
        self.odometry = self.create_publisher(Odometry, 'odom', BEST_EFFORT)
        self.create_timer(STEP, self.drive)
        self.create_timer(MESSAGE_PERIOD, self.publish)

    def seconds(self):
        return self.get_clock().now().nanoseconds / 1e9

    def obey(self, message):
        speed, turn = message.twist.linear.x, HALF_TRACK * message.twist.angular.z
        self.wanted, self.heard = (speed + turn, speed - turn), self.seconds()

    def drive(self):
        now = self.seconds()
        while self.driven_to + STEP <= now:
            stays_out = self.driven_to - self.heard > TIMEOUT
            for side, wanted in enumerate((0.0, 0.0) if stays_out else self.wanted):
                change = (wanted - self.wheels[side]) * -math.expm1(-STEP / LAG)
                most = self.acceleration * STEP
                self.wheels[side] += min(max(change, -most), most)
            right, left = self.wheels
            turned = (right - left) / (2.0 * HALF_TRACK) * STEP
            along = self.heading + turned / 2.0
            self.x += (right + left) / 2.0 * STEP * math.cos(along)
            self.y += (right + left) / 2.0 * STEP * math.sin(along)
            self.heading += turned
            self.driven_to += STEP
            self.path.append((self.driven_to, self.x, self.y, self.heading))

    def publish(self):
        self.drive()
        message = Odometry()
        whole = math.floor(self.driven_to)
        message.header.stamp.sec = whole
        message.header.stamp.nanosec = round((self.driven_to - whole) * 1e9)
        message.header.frame_id, message.child_frame_id = 'odom', 'base_footprint'
        message.pose.pose.position.x, message.pose.pose.position.y = self.x, self.y
        message.pose.pose.orientation.z = math.sin(self.heading / 2.0)
        message.pose.pose.orientation.w = math.cos(self.heading / 2.0)
        self.odometry.publish(message)


def main():
    stopping = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: stopping.set())
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    robot = ForeignRobot(*map(float, sys.argv[1:4]), *map(float, sys.argv[5:]))
    while not stopping.is_set():
        rclpy.spin_once(robot, timeout_sec=0.1)
    rows = (f'{t!r} {x!r} {y!r} {heading!r}\n' for t, x, y, heading in robot.path)
    Path(sys.argv[4]).write_text(''.join(rows), encoding='utf-8')
    robot.destroy_node()
    rclpy.try_shutdown()


if __name__ == '__main__':
    main()
