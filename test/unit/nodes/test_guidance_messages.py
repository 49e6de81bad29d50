"""Odometry to poses, decisions to messages."""

from __future__ import annotations

import math
import struct

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticStatus
from hypothesis import given
from hypothesis import strategies as st
from nav_msgs.msg import Odometry
from rclpy.time import Time

from cmpsp_ros.guidance.decision import Decision, Plan, Rung
from cmpsp_ros.guidance.horizon import Horizon
from cmpsp_ros.nodes.guidance_messages import (
    OdometryError,
    decision_message,
    joint_state_message,
    level_of,
    path_message,
    pose_of,
    stamped_twist_message,
    twist_message,
)

FLOATS = st.floats() | st.sampled_from([5e-324, -0.0, 0.1 + 0.2, 1e308, math.inf, math.nan])
NUMBERS = ('time_left', 'miss', 'margin', 'worst_margin', 'slack')


def bits(number):
    return b'nan' if math.isnan(number) else struct.pack('d', number)


def odometry(x=1.0, y=2.0, quaternion=(0.0, 0.0, 0.0, 1.0), frame_id='odom'):
    message = Odometry()
    message.header.frame_id = frame_id
    message.pose.pose.position.x, message.pose.pose.position.y = x, y
    turn = message.pose.pose.orientation
    turn.x, turn.y, turn.z, turn.w = quaternion
    return message


def yaw(heading, scale=1.0):
    return 0.0, 0.0, scale * math.sin(heading / 2.0), scale * math.cos(heading / 2.0)


def decision(**changes):
    values = {
        'stamp': 12_345_678_901_234_567,
        'step': 7,
        'rung': Rung.NOMINAL,
        'reason': 'Well.',
        'wheel_speeds': np.array([45.1, 44.2]),
        'twist': np.array([1.5, 0.1 + 0.2]),
        'time_left': 8.6,
        'plan': None,
        'miss': 1e-9,
        'margin': 0.1,
        'worst_margin': 0.05,
    }
    return Decision(**{**values, **changes})


def values_of(message):
    return {each.key: each.value for each in message.values}


@given(heading=st.floats(-1e3, 1e3), x=st.floats(-1e6, 1e6), y=st.floats(-1e6, 1e6))
def test_a_pose_is_read_with_its_heading_wrapped(heading, x, y):
    pose = pose_of(odometry(x, y, yaw(heading)), 'odom')
    assert pose[:2].tolist() == [x, y]
    assert -math.pi <= pose[2] <= math.pi
    assert math.cos(pose[2] - heading) == pytest.approx(1.0)
    assert math.sin(pose[2] - heading) == pytest.approx(0.0, abs=1e-12)


@given(heading=st.floats(-3.1, 3.1), tilt=st.floats(-1.0, 1.0))
def test_a_quaternion_may_be_negated_or_tilted(heading, tilt):
    turn = np.array(yaw(heading))
    assert pose_of(odometry(quaternion=(-turn).tolist()), 'odom')[2] == pytest.approx(heading)
    z, w = turn[2:]
    sine, cosine = math.sin(tilt / 2.0), math.cos(tilt / 2.0)
    rolled = w * sine, z * sine, z * cosine, w * cosine
    assert pose_of(odometry(quaternion=rolled), 'odom')[2] == pytest.approx(heading)


@given(heading=st.floats(-3.1, 3.1), scale=st.floats(0.991, 1.009))
def test_a_quaternion_accepted_with_rounding_has_the_same_heading(heading, scale):
    pose = pose_of(odometry(quaternion=yaw(heading, scale)), 'odom')
    assert pose[2] == pytest.approx(heading, abs=1e-9)


@pytest.mark.parametrize(
    ('message', 'said'),
    [
        (odometry(frame_id='map'), "frame 'map', wanted 'odom'"),
        (odometry(frame_id=''), "frame '', wanted 'odom'"),
        (odometry(x=math.nan), 'not finite'),
        (odometry(y=-math.inf), 'not finite'),
        (odometry(quaternion=(0.0, math.nan, 0.0, 1.0)), 'not finite'),
        (odometry(quaternion=(0.0, 0.0, 0.0, 0.0)), 'length 0'),
        (odometry(quaternion=(0.0, 0.0, 0.0, 0.98)), 'length 0.98'),
        (odometry(quaternion=(0.0, 0.0, 1e200, 1.0)), 'length inf'),
        (odometry(quaternion=(0.0, 0.0, math.inf, math.inf)), 'length inf'),
    ],
)
def test_odometry_that_cannot_be_used_is_refused_with_what_was_found(message, said):
    with pytest.raises(OdometryError, match=said):
        pose_of(message, 'odom')


@given(numbers=st.tuples(*[FLOATS] * 5), wheels=st.tuples(FLOATS, FLOATS), phase=FLOATS)
def test_every_number_of_a_decision_reads_back_bit_for_bit(numbers, wheels, phase):
    given_ = dict(zip(NUMBERS, numbers, strict=True))
    made = decision(**given_, wheel_speeds=np.array(wheels), phases={'solve': phase})
    message = decision_message(made, '/guidance: decision')
    values = values_of(message)
    for key, number in given_.items():
        assert bits(float(values[key])) == bits(number)
    assert bits(float(values['wheel_speed_right'])) == bits(wheels[0])
    assert bits(float(values['wheel_speed_left'])) == bits(wheels[1])
    assert bits(float(values['solve_ms'])) == bits(phase)
    assert int(values['stamp']) == made.stamp
    assert int(values['step']) == 7


def test_numpy_numbers_are_written_as_plain_ones():
    made = decision(slack=np.float64(0.1) + 0.2, active_rows=np.int64(3), qp_iterations=np.int32(4))
    values = values_of(decision_message(made, ''))
    assert (values['slack'], values['active_rows']) == ('0.30000000000000004', '3')
    assert values['qp_iterations'] == '4'


def test_a_decision_carries_its_name_level_and_reason():
    message = decision_message(decision(rung=Rung.ELASTIC, reason='Tight.'), '/r1/guidance: it')
    assert (message.name, message.message) == ('/r1/guidance: it', 'Tight.')
    assert message.level == DiagnosticStatus.WARN
    assert values_of(message)['rung'] == 'elastic'
    assert values_of(message)['finished'] == 'false'


@pytest.mark.parametrize(
    ('rung', 'level'),
    [
        (Rung.NOMINAL, DiagnosticStatus.OK),
        (Rung.ELASTIC, DiagnosticStatus.WARN),
        (Rung.SHIFTED, DiagnosticStatus.WARN),
        (Rung.STOP, DiagnosticStatus.ERROR),
    ],
)
def test_a_stop_is_an_error_unless_the_run_is_over(rung, level):
    assert level_of(decision(rung=rung)) == level
    assert level_of(decision(rung=rung, finished=True)) == DiagnosticStatus.OK


def test_a_command_is_the_decision_s_twist_in_plain_floats():
    made = decision()
    twist = twist_message(made)
    assert (twist.linear.x, twist.angular.z) == (1.5, 0.1 + 0.2)
    assert type(twist.linear.x) is type(twist.angular.z) is float
    assert (twist.linear.y, twist.angular.x) == (0.0, 0.0)
    stamp = Time(nanoseconds=made.stamp).to_msg()
    stamped = stamped_twist_message(made, stamp)
    assert stamped.twist == twist
    assert Time.from_msg(stamped.header.stamp).nanoseconds == made.stamp
    assert stamped.header.frame_id == 'base_link'
    joints = joint_state_message(made, ('right', 'left'), stamp)
    assert joints.name == ['right', 'left']
    assert joints.velocity.tolist() == [45.1, 44.2]
    assert Time.from_msg(joints.header.stamp).nanoseconds == made.stamp


def test_every_pose_of_a_path_has_the_time_when_the_robot_should_be_there():
    edges = np.array([1_010_000_000, 1_200_000_000, 1_400_000_000, 1_500_000_000])
    poses = np.column_stack([np.arange(4.0), -np.arange(4.0), np.linspace(0.0, 7.0, 4)])
    stamp = 1_700_000_000_123_456_789
    path = path_message(Plan(Horizon(edges), np.zeros((4, 2)), poses), 'odom', stamp)
    assert path.header.frame_id == 'odom'
    assert Time.from_msg(path.header.stamp).nanoseconds == stamp
    times = [Time.from_msg(each.header.stamp).nanoseconds for each in path.poses]
    assert times == [stamp, stamp + 190_000_000, stamp + 390_000_000, stamp + 490_000_000]
    for each, (x, y, heading) in zip(path.poses, poses.tolist(), strict=True):
        assert each.header.frame_id == 'odom'
        assert (each.pose.position.x, each.pose.position.y) == (x, y)
        turn = each.pose.orientation
        assert (turn.x, turn.y) == (0.0, 0.0)
        assert math.cos(2.0 * math.atan2(turn.z, turn.w) - heading) == pytest.approx(1.0)
        numbers = (each.pose.position.x, turn.z, turn.w)
        assert all(type(number) is float for number in numbers)
