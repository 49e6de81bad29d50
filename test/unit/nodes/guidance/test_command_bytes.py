"""Commands in the bytes in which they leave, held against rclpy's."""

import math
from types import SimpleNamespace

import numpy as np
import pytest
from geometry_msgs.msg import Twist, TwistStamped
from rclpy.serialization import deserialize_message, serialize_message

from cmpsp_ros.nodes.guidance.outputs.messages import frame_bytes, stamped_bytes, twist_bytes

LATEST = (2**31 - 1) * 10**9 + 999_999_999
TWISTS = [(0.0, 0.0), (1.785, -0.25), (-1e-300, math.pi), (math.nan, math.inf)]


def decision(twist, stamp=0):
    return SimpleNamespace(twist=np.array(twist), stamp=stamp)


@pytest.mark.parametrize('twist', TWISTS)
def test_a_twist_is_what_rclpy_writes(twist):
    message = Twist()
    message.linear.x, message.angular.z = twist
    assert twist_bytes(decision(twist)) == serialize_message(message)


@pytest.mark.parametrize('twist', TWISTS)
@pytest.mark.parametrize('stamp', [0, 1, 1_787_000_000_123_456_789, LATEST])
@pytest.mark.parametrize('frame_id', ['', 'b', 'base_link', 'r1/base_link', 'base_fußpunkt'])
def test_a_stamped_twist_is_what_rclpy_writes(twist, stamp, frame_id):
    message = TwistStamped()
    message.header.frame_id = frame_id
    message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp, 10**9)
    message.twist.linear.x, message.twist.angular.z = twist
    data = stamped_bytes(decision(twist, stamp), frame_bytes(frame_id))
    read = deserialize_message(data, TwistStamped)
    assert read.header == message.header
    # Part by part: rclpy leaves what lies between two of them as it finds it.
    assert serialize_message(read.twist) == serialize_message(message.twist)
