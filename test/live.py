"""Values and messages that tests of live nodes share."""

import math
import sys
from pathlib import Path

from geometry_msgs.msg import PoseStamped, TransformStamped
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.time import Time

CASE3, UNKNOWN = (
    Path(__file__).parents[1] / 'config' / f'{name}.yaml' for name in ('case3', 'unknown')
)
MS = 1_000_000
PERIOD_NS = 200 * MS
ZERO = (0.0, 0.0)
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
COMMAND = [sys.executable, '-m', 'cmpsp_ros.cli']


def fill_pose(position, orientation, pose):
    """Set two parts of a message to a planar pose."""
    position.x, position.y = map(float, pose[:2])
    orientation.z, orientation.w = math.sin(pose[2] / 2.0), math.cos(pose[2] / 2.0)


def transform(parent, child, pose, stamp=0):
    """A transform of a planar pose."""
    message = TransformStamped(child_frame_id=child)
    message.header.frame_id, message.header.stamp = parent, Time(nanoseconds=stamp).to_msg()
    fill_pose(message.transform.translation, message.transform.rotation, pose)
    return message


def pose_stamped(stamp, frame_id, pose):
    """A planar pose."""
    message = PoseStamped()
    message.header.frame_id, message.header.stamp = frame_id, Time(nanoseconds=stamp).to_msg()
    fill_pose(message.pose.position, message.pose.orientation, pose)
    return message
