"""Odometry read from bytes: what rclpy reads from them, or a refusal."""

from __future__ import annotations

import math
import struct

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from nav_msgs.msg import Odometry
from rclpy.serialization import deserialize_message, serialize_message

from cmpsp_ros.bags.definitions import jazzy
from cmpsp_ros.guidance.messages import OdometryError, OdometryReading
from cmpsp_ros.nodes.guidance.inputs.odometry import read_odometry

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
