"""Odometry: poses out of it, and what is refused."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cmpsp_ros.guidance.messages import OdometryError, OdometryReading
from cmpsp_ros.guidance.messages.poses import check_age
from cmpsp_ros.sensing import stamp_of

Odometry = pytest.importorskip('nav_msgs.msg').Odometry
Time = pytest.importorskip('rclpy.time').Time

SECOND = 1_000_000_000


def odometry(x=1.0, y=2.0, quaternion=(0.0, 0.0, 0.0, 1.0), frame_id='odom'):
    message = Odometry()
    message.header.frame_id = frame_id
    message.pose.pose.position.x, message.pose.pose.position.y = x, y
    turn = message.pose.pose.orientation
    turn.x, turn.y, turn.z, turn.w = quaternion
    return message


def pose_of(message):
    return OdometryReading.of(message).pose_in('odom')


def yaw(heading, scale=1.0):
    return 0.0, 0.0, scale * math.sin(heading / 2.0), scale * math.cos(heading / 2.0)


@given(heading=st.floats(-1e3, 1e3), x=st.floats(-1e6, 1e6), y=st.floats(-1e6, 1e6))
def test_a_pose_is_read_with_its_heading_wrapped(heading, x, y):
    pose = pose_of(odometry(x, y, yaw(heading)))
    assert pose[:2].tolist() == [x, y]
    assert -math.pi <= pose[2] <= math.pi
    assert math.cos(pose[2] - heading) == pytest.approx(1.0)
    assert math.sin(pose[2] - heading) == pytest.approx(0.0, abs=1e-12)


@given(heading=st.floats(-3.1, 3.1), tilt=st.floats(-1.0, 1.0))
def test_a_quaternion_may_be_negated_or_tilted(heading, tilt):
    turn = np.array(yaw(heading))
    assert pose_of(odometry(quaternion=(-turn).tolist()))[2] == pytest.approx(heading)
    z, w = turn[2:]
    sine, cosine = math.sin(tilt / 2.0), math.cos(tilt / 2.0)
    rolled = w * sine, z * sine, z * cosine, w * cosine
    assert pose_of(odometry(quaternion=rolled))[2] == pytest.approx(heading)


@given(heading=st.floats(-3.1, 3.1), scale=st.floats(0.991, 1.009))
def test_a_quaternion_accepted_with_rounding_has_the_same_heading(heading, scale):
    pose = pose_of(odometry(quaternion=yaw(heading, scale)))
    assert pose[2] == pytest.approx(heading, abs=1e-9)


@pytest.mark.parametrize(
    ('message', 'said'),
    [
        (odometry(frame_id='map'), "frame 'map', wanted 'odom'"),
        (odometry(frame_id=''), "frame '', wanted 'odom'"),
        (odometry(x=math.nan), 'not finite'),
        (odometry(y=-math.inf), 'not finite'),
        (odometry(x=1e300, y=-2e8), r'a position of 1e\+300, -2e\+08 m, wanted one on Earth'),
        (odometry(quaternion=(0.0, math.nan, 0.0, 1.0)), 'not finite'),
        (odometry(quaternion=(0.0, 0.0, 0.0, 0.0)), 'length 0'),
        (odometry(quaternion=(0.0, 0.0, 0.0, 0.98)), 'length 0.98'),
        (odometry(quaternion=(0.0, 0.0, 1e200, 1.0)), 'length inf'),
        (odometry(quaternion=(0.0, 0.0, math.inf, math.inf)), 'length inf'),
    ],
)
def test_odometry_that_cannot_be_used_is_refused_with_what_was_found(message, said):
    with pytest.raises(OdometryError, match=said):
        pose_of(message)


@pytest.mark.parametrize('stamp', [0, 1_700_000_000_123_456_789])
def test_a_stamp_is_read_to_the_nanosecond(stamp):
    message = odometry()
    message.header.stamp = Time(nanoseconds=stamp).to_msg()
    assert stamp_of(message) == stamp


@pytest.mark.parametrize(
    ('now', 'said'),
    [
        (10.6, '0.600 s old .odom_timeout 0.5 s'),
        (9.4, '0.600 s ahead of the clock'),
        (0.0, '10.000 s ahead of the clock'),
    ],
)
def test_odometry_of_another_time_is_refused(now, said):
    with pytest.raises(OdometryError, match=said):
        check_age('Odometry is', 'odom_timeout', 10 * SECOND, int(now * SECOND), 0.5, OdometryError)


@pytest.mark.parametrize('now', [9.6, 10.0, 10.4])
def test_odometry_of_this_time_passes(now):
    check_age('Odometry is', 'odom_timeout', 10 * SECOND, int(now * SECOND), 0.5, OdometryError)
