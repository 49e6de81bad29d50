"""Publishes 2000 messages at 1 kHz and ends the recorder right after the last: talker.py PID."""

import os
import signal
import sys
import time

import rclpy
from geometry_msgs.msg import Twist
from nav_msgs.msg import Odometry
from rclpy.duration import Duration
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from visualization_msgs.msg import Marker, MarkerArray

COUNT = 2000
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
BEST_EFFORT = QoSProfile(depth=10, reliability=ReliabilityPolicy.BEST_EFFORT)


def publish_and_stop(recorder_pid):
    """Publish `COUNT` messages at 1 kHz and end the recorder right after the last."""
    rclpy.init()
    node = rclpy.create_node('talker', namespace='robot')
    commands = node.create_publisher(Twist, '/cmd_vel', QoSProfile(depth=COUNT))
    odometry = node.create_publisher(Odometry, '/odom', BEST_EFFORT)
    markers = node.create_publisher(MarkerArray, '/markers', LATCHED)
    # Latched before anybody listens.
    markers.publish(MarkerArray(markers=[Marker(id=7)]))
    end = time.monotonic() + 100.0
    while not all(each.get_subscription_count() for each in (commands, odometry, markers)):
        assert time.monotonic() < end, 'nobody listens'
        rclpy.spin_once(node, timeout_sec=0.02)
    begun = time.monotonic()
    for k in range(COUNT):
        twist = Twist()
        twist.linear.x = float(k)
        commands.publish(twist)
        if k % 20 == 0:
            message = Odometry()
            message.pose.pose.position.x = float(k)
            odometry.publish(message)
            rclpy.spin_once(node, timeout_sec=0.0)
        time.sleep(max(0.0, begun + (k + 1) * 1e-3 - time.monotonic()))
    os.kill(recorder_pid, signal.SIGTERM)
    # What a vanished publisher had not handed over would not be the recorder's loss.
    commands.wait_for_all_acked(Duration(seconds=60.0))
    rclpy.shutdown()


if __name__ == '__main__':
    publish_and_stop(int(sys.argv[1]))
