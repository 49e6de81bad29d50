"""Odometry read from bytes, and commands written as bytes, held against rclpy's."""

import math
import struct
from types import SimpleNamespace

import numpy as np
import pytest
from geometry_msgs.msg import Twist, TwistStamped
from hypothesis import given
from hypothesis import strategies as st
from nav_msgs.msg import Odometry
from rclpy.serialization import deserialize_message, serialize_message

from cmpsp_ros.bags.definitions import jazzy
from cmpsp_ros.guidance.messages import OdometryError, OdometryReading
from cmpsp_ros.nodes.guidance.inputs.odometry import read_odometry
from cmpsp_ros.nodes.guidance.outputs.messages import frame_bytes, stamped_bytes, twist_bytes

TYPE = 'nav_msgs/msg/Odometry'


def odometry(
    frame_id: str = 'odom', child: str = 'base_link', numbers: tuple[float, ...] = (1.0, -2.0, 0.5)
) -> Odometry:
    message = Odometry(child_frame_id=child)
    message.header.frame_id = frame_id
    message.header.stamp.sec, message.header.stamp.nanosec = 12, 345678901
    position, q = message.pose.pose.position, message.pose.pose.orientation
    position.x, position.y, heading = numbers
    q.z, q.w = math.sin(heading / 2.0), math.cos(heading / 2.0)
    # Behind all that is read.
    message.pose.covariance[:] = np.arange(36.0)
    message.twist.twist.linear.x = 7.0
    return message


# Rosbags, which replay reads bags by, and rclpy take no zero bytes in strings either.
NAMES = st.text(st.characters(exclude_characters='\0', exclude_categories=['Cs']), max_size=12)
NUMBERS = st.floats(allow_nan=False, width=64)


@given(
    frame_id=NAMES,
    child=NAMES,
    sec=st.integers(-(2**31), 2**31 - 1),
    nanosec=st.integers(0, 2**32 - 1),
    numbers=st.lists(NUMBERS, min_size=7, max_size=7),
)
def test_what_rclpy_reads(
    frame_id: str, child: str, sec: int, nanosec: int, numbers: list[float]
) -> None:
    sent = odometry(frame_id, child)
    sent.header.stamp.sec, sent.header.stamp.nanosec = sec, nanosec
    position, q = sent.pose.pose.position, sent.pose.pose.orientation
    position.x, position.y, position.z, q.x, q.y, q.z, q.w = numbers
    data = serialize_message(sent)
    wanted = deserialize_message(data, Odometry)
    found = read_odometry(data)
    assert repr(found) == repr(OdometryReading.of(wanted))


@pytest.mark.parametrize('little', [True, False])
def test_both_byte_orders(little: bool) -> None:
    sent = odometry('map', 'a')
    data = jazzy().serialize_cdr(
        jazzy().deserialize_cdr(serialize_message(sent), TYPE), TYPE, little_endian=little
    )
    found = read_odometry(bytes(data))
    assert found == OdometryReading.of(sent)


def test_a_message_that_ends_too_early_is_refused() -> None:
    data = serialize_message(odometry())
    # Header 4, stamp 8, strings 4 + 5 and 4 + 10 with what aligns them, and seven numbers.
    needed = 4 + 8 + 9 + 3 + 14 + 6 + 7 * 8
    for length in range(needed):
        with pytest.raises(OdometryError, match=f'found {length} bytes that are no nav_msgs/Odom'):
            read_odometry(data[:length])
    for length in range(needed, len(data) + 1):
        assert read_odometry(data[:length]) == read_odometry(data)


@given(st.binary(max_size=200))
def test_noise_is_refused_or_read(data: bytes) -> None:
    try:
        found = read_odometry(data)
    except OdometryError:
        return
    assert len(found.pose.pose.orientation) == 4


@pytest.mark.parametrize('length', [0, 4, 2**31, 2**32 - 1])
def test_a_string_of_another_length_is_refused(length: int) -> None:
    data = bytearray(serialize_message(odometry()))
    assert struct.unpack_from('<I', data, 12) == (5,)
    struct.pack_into('<I', data, 12, length)
    with pytest.raises(OdometryError, match='no nav_msgs/Odometry'):
        read_odometry(bytes(data))


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
